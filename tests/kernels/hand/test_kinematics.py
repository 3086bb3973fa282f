"""Kinematics against products of transforms, and bounds of how far points move, with the hand or past a part."""

from typing import Any

import numpy as np
from contact_scenes import body_frames, moved, posed
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import PALM, palm_spheres

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel, Side
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, motion_bounds
from hhsim.kernels.parts.surface import part_dtype, passing

HANDS: dict[Side, HandModel] = {"right": HandModel.default("right"), "left": HandModel.default("left")}
sides = st.sampled_from(["right", "left"])
seeds = st.integers(0, 2**32 - 1)


def random_pose(random: np.random.Generator) -> HandConfiguration:
    """Angles beyond the joint limits too: the kinematics do not know them."""
    return HandConfiguration(
        random.uniform(-1.0, 1.0, (1, 3)),
        Rotation.random(1, rng=random).as_quat(scalar_first=True),
        random.uniform(-2.0, 3.0, (1, 5, 3)),
        random.uniform(-1.0, 1.0, (1, 5)),
    )


@given(seeds, sides)
@settings(max_examples=60)
def test_joints_are_the_product_of_transforms(seed: int, side: Side) -> None:
    hand, pose = HANDS[side], random_pose(np.random.default_rng(seed))
    out, frames = posed(hand, pose), body_frames(hand, pose)[:PALM].reshape(5, 3, 4, 4)
    bones = frames[..., :3, 1] * hand.length[:, :, None]
    np.testing.assert_allclose(out.joints[:, :3], frames[..., :3, 3], atol=2e-15)
    np.testing.assert_allclose(out.joints[:, 1:], frames[..., :3, 3] + bones, atol=2e-15)
    np.testing.assert_allclose(out.direction * hand.length[:, :, None], np.diff(out.joints, axis=1), atol=1e-15)
    for axis in (out.axis, out.abduction_axis):
        np.testing.assert_allclose(np.linalg.norm(axis, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.einsum("fki,fi->fk", out.direction, out.axis), 0.0, atol=1e-14)


def body_points(hand: HandModel, pose: HandConfiguration, share: FloatArray) -> list[FloatArray]:
    """Points of each body in the world: on the axes of the phalanges at these shares, and the palm's sphere centres."""
    joints = posed(hand, pose).joints
    points = [joints[f, k] + share[:, None] * (joints[f, k + 1] - joints[f, k]) for f in range(5) for k in range(3)]
    return [*points, *palm_spheres(hand.palm_tree.leaf_center, pose.position, pose.orientation)]


@given(
    seeds, sides, st.sampled_from([1e-4, 0.03, 1.0]), st.sampled_from(["all", "palm", "turn", "flexion", "abduction"])
)
@settings(max_examples=80)
def test_no_point_moves_farther_than_its_bound(seed: int, side: Side, size: float, part: str) -> None:
    hand, random = HANDS[side], np.random.default_rng(seed)
    pose = random_pose(random)
    step, abduction_step = size * random.uniform(-1.0, 1.0, DOF), size * random.uniform(-1.0, 1.0, 5)
    keep = {"all": slice(0, DOF), "palm": slice(0, 3), "turn": slice(3, 6), "flexion": slice(6, DOF)}
    mask = np.zeros(DOF)
    if part in keep:
        mask[keep[part]] = 1.0
    step = step * mask
    if part not in ("all", "abduction"):
        abduction_step = np.zeros(5)
    bound = np.full(BODY_COUNT, np.nan)
    motion_bounds(hand.arrays(), posed(hand, pose), step, abduction_step, 0.0, bound)
    share = np.concatenate([[0.0, 1.0], random.uniform(0.0, 1.0, 6)])
    start = body_points(hand, pose, share)
    for moment in (1.0, *random.uniform(0.0, 1.0, 5)):
        now = body_points(hand, moved(pose, moment * step, moment * abduction_step), share)
        for body in range(BODY_COUNT):
            travelled = np.linalg.norm(now[body] - start[body], axis=1).max()
            assert travelled <= moment * bound[body] * (1.0 + 1e-12) + 1e-15


@given(st.integers(0, 2**32 - 1))
def test_a_point_passes_a_part_by_what_it_moves_in_its_frame(seed: int) -> None:
    random = np.random.default_rng(seed)
    here, there = Rotation.random(2, rng=random)
    place, goal, point = random.normal(0.0, 0.1, (3, 3))
    part: Any = np.zeros(1, part_dtype()).view(np.recarray)[0]
    part.position[:], part.rotation[:] = place, here.as_matrix()
    way = np.concatenate([goal, there.as_quat(scalar_first=True)])
    wanted = np.linalg.norm(here.inv().apply(point - place) - there.inv().apply(point - goal))
    assert abs(passing(part, way, point) - wanted) < 1e-15 + 1e-12 * wanted
