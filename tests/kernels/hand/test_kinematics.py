"""Kinematics against products of transforms, and bounds of how far points move, with the hand or past a part."""

from typing import Any, NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel, Side
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, HandArrays, motion_bounds
from hhsim.kernels.hand.pose import HAND_POSE, update_kinematics
from hhsim.kernels.parts.surface import part_dtype, passing

HANDS: dict[Side, HandArrays] = {
    "right": HandModel.default("right").arrays(),
    "left": HandModel.default("left").arrays(),
}
sides = st.sampled_from(["right", "left"])
seeds = st.integers(0, 2**32 - 1)


class Pose(NamedTuple):
    """One configuration of the hand; the palm's orientation as a scipy rotation."""

    position: FloatArray
    rotation: Rotation
    flexion: FloatArray
    abduction: FloatArray


def random_pose(random: np.random.Generator) -> Pose:
    """Angles beyond the joint limits too: the kinematics do not know them."""
    return Pose(
        random.uniform(-1.0, 1.0, 3),
        Rotation.random(rng=random),
        random.uniform(-2.0, 3.0, (5, 3)),
        random.uniform(-1.0, 1.0, 5),
    )


def place(hand: HandArrays, pose: Pose) -> Any:
    """The pose's record, with what the kernels make of it."""
    at = np.zeros(1, HAND_POSE).view(np.recarray)[0]
    at.position[:], at.flexion[:], at.abduction[:] = pose.position, pose.flexion, pose.abduction
    at.orientation[:] = pose.rotation.as_quat(scalar_first=True)
    update_kinematics(hand, at)
    return at


def moved(pose: Pose, step: FloatArray, abduction_step: FloatArray, share: float) -> Pose:
    """The pose after a share of a step (δp, δφ, δθ), the palm turned by exp(share δφ) from the left."""
    return Pose(
        pose.position + share * step[:3],
        Rotation.from_rotvec(share * step[3:6]) * pose.rotation,
        pose.flexion + share * step[6:].reshape(5, 3),
        pose.abduction + share * abduction_step,
    )


def transform(rotation: Rotation | FloatArray, translation: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix() if isinstance(rotation, Rotation) else rotation
    matrix[:3, 3] = translation
    return matrix


def product_of_transforms(hand: HandArrays, pose: Pose) -> FloatArray:
    """Joints by T_world_palm T_palm_finger R_abduction Π R_x(-θ) T(0, L, 0); in a finger y is distal, z dorsal."""
    joints = np.empty((5, 4, 3))
    palm = transform(pose.rotation, pose.position)
    for f in range(5):
        x = np.cross(hand.distal[f], hand.dorsal[f])
        frame = palm @ transform(np.stack([x, hand.distal[f], hand.dorsal[f]], axis=1), hand.base[f])
        turn = hand.abduction_sign[0] * pose.abduction[f]
        chain = frame @ transform(Rotation.from_euler("z", turn), np.zeros(3))
        joints[f, 0] = chain[:3, 3]
        for k in range(3):
            chain = chain @ transform(Rotation.from_euler("x", -pose.flexion[f, k]), np.zeros(3))
            chain = chain @ transform(np.eye(3), np.array([0.0, hand.length[f, k], 0.0]))
            joints[f, k + 1] = chain[:3, 3]
    return joints


@given(seeds, sides)
@settings(max_examples=60)
def test_joints_are_the_product_of_transforms(seed: int, side: Side) -> None:
    hand, pose = HANDS[side], random_pose(np.random.default_rng(seed))
    out = place(hand, pose)
    np.testing.assert_allclose(out.joints, product_of_transforms(hand, pose), atol=2e-15)
    bones = np.diff(out.joints, axis=1)
    np.testing.assert_allclose(out.direction * hand.length[:, :, None], bones, atol=1e-15)
    for axis in (out.axis, out.abduction_axis):
        np.testing.assert_allclose(np.linalg.norm(axis, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.einsum("fki,fi->fk", out.direction, out.axis), 0.0, atol=1e-14)


def body_points(hand: HandArrays, pose: Pose, share: FloatArray) -> list[FloatArray]:
    """Points of each body in the world: on the axes of the phalanges at these shares, and the palm's sphere centres."""
    joints = place(hand, pose).joints
    points = [joints[f, k] + share[:, None] * (joints[f, k + 1] - joints[f, k]) for f in range(5) for k in range(3)]
    palm = np.stack([hand.palm_x, hand.palm_y, hand.palm_z], axis=1)
    return [*points, pose.position + pose.rotation.apply(palm)]


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
    motion_bounds(hand, place(hand, pose), step, abduction_step, 0.0, bound)
    share = np.concatenate([[0.0, 1.0], random.uniform(0.0, 1.0, 6)])
    start = body_points(hand, pose, share)
    for moment in (1.0, *random.uniform(0.0, 1.0, 5)):
        now = body_points(hand, moved(pose, step, abduction_step, moment), share)
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
