"""Penetration depths against brute force over all pairs, with the axis parameter found by search and not by formula."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.penetration import HandSurface, PlacedHands, clearances
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.sphere_tree import TreeArrays

FREE = 1.0
"""A limit [m] that no distance in these scenes reaches."""


def tree_of(center: FloatArray, radius: FloatArray, groups: int = 4) -> TreeArrays:
    """A tree of two levels over the given leaves, in the order in which they come."""
    members = [m for m in np.array_split(np.arange(radius.size), groups) if m.size]
    nodes = [center.mean(axis=0), *(center[m].mean(axis=0) for m in members)]
    sets = [np.arange(radius.size), *members]
    reach = [float((np.linalg.norm(center[m] - c, axis=1) + radius[m]).max()) for c, m in zip(nodes, sets)]
    first_leaf = 1 + len(members)
    first = [1, *(first_leaf + m[0] for m in members), *([-1] * radius.size)]
    count = [len(members), *(m.size for m in members), *([0] * radius.size)]
    xyz = np.vstack([nodes, center])
    return TreeArrays(
        np.ascontiguousarray(xyz[:, 0]),
        np.ascontiguousarray(xyz[:, 1]),
        np.ascontiguousarray(xyz[:, 2]),
        np.concatenate([reach, radius]),
        np.array(first, dtype=np.int64),
        np.array(count, dtype=np.int64),
        first_leaf,
    )


def round_cone_distance(
    center: FloatArray, radius: FloatArray, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> FloatArray:
    """Least of |c - x(s)| - r(s) over 0 <= s <= 1, convex in s, by golden sections."""
    low, high = np.zeros(radius.size), np.ones(radius.size)
    golden = (np.sqrt(5.0) - 1.0) / 2.0

    def value(s: FloatArray) -> FloatArray:
        axis = a + s[:, None] * (b - a)
        distance: FloatArray = np.linalg.norm(center - axis, axis=1) - (radius_a + s * (radius_b - radius_a)) - radius
        return distance

    for _ in range(60):
        left, right = high - golden * (high - low), low + golden * (high - low)
        lower = value(left) < value(right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    return np.minimum(value(0.5 * (low + high)), np.minimum(value(np.zeros_like(low)), value(np.ones_like(low))))


def brute_force(
    phalanx_radius: FloatArray,
    palm: FloatArray,
    palm_radius: FloatArray,
    leaves: FloatArray,
    leaf_radius: FloatArray,
    joints: FloatArray,
    pose: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(palm (T,), finger (T, 5)) least signed distances; pose (T, 3, 4) is [rotation | position]."""
    ticks = len(joints)
    palm_out, finger_out = np.full(ticks, np.inf), np.full((ticks, 5), np.inf)
    for t in range(ticks):
        for p, r in zip(palm @ pose[t, :, :3].T + pose[t, :, 3], palm_radius):
            palm_out[t] = min(palm_out[t], (np.linalg.norm(leaves - p, axis=1) - leaf_radius - r).min())
        for f in range(5):
            for k in range(3):
                ends, radii = joints[t, f, k : k + 2], phalanx_radius[f, k : k + 2]
                distance = round_cone_distance(leaves, leaf_radius, ends[0], ends[1], radii[0], radii[1])
                finger_out[t, f] = min(finger_out[t, f], distance.min())
    return palm_out, finger_out


def run_clearances(
    phalanx_radius: FloatArray,
    palm: FloatArray,
    palm_radius: FloatArray,
    tree: TreeArrays,
    joints: FloatArray,
    pose: FloatArray,
    limit: float,
) -> tuple[FloatArray, FloatArray]:
    x, y, z = np.ascontiguousarray(palm.T)
    rotation, position = np.ascontiguousarray(pose[:, :, :3]), np.ascontiguousarray(pose[:, :, 3])
    palm_out, finger_out = np.full(len(joints), np.inf), np.full((len(joints), 5), np.inf)
    shape, placed = HandSurface(phalanx_radius, x, y, z, palm_radius), PlacedHands(joints, position, rotation)
    clearances(tree, shape, placed, limit, palm_out, finger_out)
    return palm_out, finger_out


@st.composite
def scenes(
    draw: st.DrawFn,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Crowded scenes, about half penetrating, with phalanges of length 0, radius 0 and spheres inside each other."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    ticks, leaves, palms = draw(st.integers(0, 4)), draw(st.integers(1, 60)), draw(st.integers(0, 8))
    spread = draw(st.sampled_from([0.02, 0.1, 0.4]))
    step = rng.choice([0.0, 0.003, 0.03], size=(ticks, 5, 4, 1)) * rng.normal(size=(ticks, 5, 4, 3))
    joints = spread * rng.normal(size=(ticks, 5, 1, 3)) + np.cumsum(step, axis=2)
    phalanx_radius = np.sort(rng.choice([0.0, 0.005, 0.01, 0.02], size=(5, 4)), axis=1)[:, ::-1].copy()
    rotation = Rotation.random(ticks, rng=rng).as_matrix() if ticks else np.zeros((0, 3, 3))
    pose = np.concatenate([rotation, spread * rng.normal(size=(ticks, 3, 1))], axis=2)
    palm, palm_radius = 0.03 * rng.normal(size=(palms, 3)), rng.uniform(0.0, 0.015, size=palms)
    center, radius = 0.03 * rng.normal(size=(leaves, 3)), rng.uniform(0.0, 0.01, size=leaves)
    return phalanx_radius, palm, palm_radius, center, radius, joints, pose


@settings(max_examples=25)
@given(scenes(), st.sampled_from([0.0, 0.01, FREE]))
def test_clearances_equal_brute_force(
    scene: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], limit: float
) -> None:
    phalanx_radius, palm, palm_radius, center, radius, joints, pose = scene
    palm_out, finger_out = run_clearances(
        phalanx_radius, palm, palm_radius, tree_of(center, radius), joints, pose, limit
    )
    palm_expected, finger_expected = brute_force(phalanx_radius, palm, palm_radius, center, radius, joints, pose)
    np.testing.assert_allclose(palm_out, np.minimum(palm_expected, limit), atol=1e-12)
    np.testing.assert_allclose(finger_out, np.minimum(finger_expected, limit), atol=1e-12)


@pytest.fixture(scope="module")
def hand() -> HandModel:
    return HandModel.default()


def random_hands(hand: HandModel, ticks: int, seed: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    pose, joints = np.empty((ticks, 3, 4)), np.empty((ticks, 5, 4, 3))
    for t in range(ticks):
        x, y, z, w = Rotation.random(rng=rng).as_quat()
        flexion = rng.uniform(hand.flexion_min, hand.flexion_max)
        abduction = rng.uniform(hand.abduction_min, hand.abduction_max)
        pose[t, :, 3] = rng.normal(size=3) * 0.06
        pose[t, :, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
        joints[t] = hand.joints(pose[t, :, 3].copy(), np.array([w, x, y, z]), flexion, abduction)
    return joints, pose


def penetration_depths(
    hand: HandArrays,
    tree: TreeArrays,
    joints: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    palm: FloatArray,
    finger: FloatArray,
) -> None:
    """Clearances of a whole hand, none looked for beyond 0, as depths; written to palm (T,) and finger (T, 5)."""
    spheres = (hand.palm_x, hand.palm_y, hand.palm_z, hand.palm_radius)
    shape, placed = HandSurface(hand.radius, *spheres), PlacedHands(joints, position, rotation)
    clearances(tree, shape, placed, 0.0, palm, finger)
    palm[:], finger[:] = 0.0 - palm, 0.0 - finger


def test_depths_of_the_real_hand_equal_brute_force(hand: HandModel) -> None:
    rng = np.random.default_rng(1)
    center = rng.normal(size=(200, 3))
    center *= 0.035 / np.linalg.norm(center, axis=1)[:, None]
    radius = rng.uniform(0.002, 0.006, size=200)
    joints, pose = random_hands(hand, 12, 2)
    palm_out, finger_out = np.full(12, np.nan), np.full((12, 5), np.nan)
    rotation, position = np.ascontiguousarray(pose[:, :, :3]), np.ascontiguousarray(pose[:, :, 3])
    tree, arrays = tree_of(center, radius, groups=8), hand.arrays()
    penetration_depths(arrays, tree, joints, position, rotation, palm_out, finger_out)
    palm = hand.palm_tree
    palm_distance, finger_distance = brute_force(
        hand.radius, palm.leaf_center, palm.leaf_radius, center, radius, joints, pose
    )
    assert (palm_distance < 0.0).any()
    assert (palm_distance > 0.0).any()
    assert (finger_distance < 0.0).any()
    assert (finger_distance > 0.0).any()
    np.testing.assert_allclose(palm_out, np.maximum(-palm_distance, 0.0), atol=1e-12)
    np.testing.assert_allclose(finger_out, np.maximum(-finger_distance, 0.0), atol=1e-12)
    assert not np.signbit(palm_out).any()
    assert not np.signbit(finger_out).any()


def test_known_depths(hand: HandModel) -> None:
    # A ball of 30 mm, 1 mm into the tip of the straight index finger, ahead of it on its axis.
    flexion, abduction = np.zeros((5, 3)), np.zeros(5)
    joints = hand.joints(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), flexion, abduction)[None]
    tip, last = joints[0, 1, 3], joints[0, 1, 2]
    axis = (tip - last) / np.linalg.norm(tip - last)
    center = tip + axis * (hand.radius[1, 3] + 0.03 - 0.001)
    palm_out, finger_out = np.empty(1), np.empty((1, 5))
    tree = tree_of(center[None], np.array([0.03]), groups=1)
    penetration_depths(hand.arrays(), tree, joints, np.zeros((1, 3)), np.eye(3)[None], palm_out, finger_out)
    assert finger_out[0, 1] == pytest.approx(0.001, abs=1e-12)
    assert palm_out[0] == 0.0
    assert finger_out[0, 0] == finger_out[0, 4] == 0.0


@pytest.mark.parametrize("finger", range(5))
def test_nan_is_not_freedom(hand: HandModel, finger: int) -> None:
    joints, pose = random_hands(hand, 3, 5)
    joints[1, finger, 2, 1] = np.nan
    pose[2, 0, 3] = np.nan
    rotation, position = np.ascontiguousarray(pose[:, :, :3]), np.ascontiguousarray(pose[:, :, 3])
    palm_out, finger_out = np.empty(3), np.empty((3, 5))
    tree = tree_of(np.zeros((1, 3)), np.array([0.05]), groups=1)
    penetration_depths(hand.arrays(), tree, joints, position, rotation, palm_out, finger_out)
    assert np.isnan(palm_out).tolist() == [False, False, True]
    expected = np.zeros((3, 5), dtype=bool)
    expected[1, finger] = True
    np.testing.assert_array_equal(np.isnan(finger_out), expected)
