"""Detection of method `paper` against the paper's Eq. 3 to 7 and 13, transcribed and asked of every pair."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paper_frustum import Frustum, frustum_excess, frustum_of
from sphere_scenes import cloud, palm_spheres, random_hand, set_pose

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.frustum import FRUSTUM, SHAPE, frustum_shapes, place_frustum
from hhsim.kernels.tick.paper import PAPER_STATE
from hhsim.kernels.tick.paper_detection import ON_FRUSTUM, ON_SPHERE, detect, finger_is_free, palm_is_free
from hhsim.solver.options import Stiffness
from hhsim.solver.workspace import tick_state, zeroed
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
GROWTH = 5e-4
DOUBT = 1e-12
"""Pairs this near to a threshold [m, or relative for squares] may be called either way."""


def range_excess(cone: Frustum, k: FloatArray, radius: FloatArray, tip: bool, closed: bool) -> FloatArray:
    """How far k is outside of its range in Eq. 7, or in Eq. 13 [m], negative inside, shape (L,)."""
    length = float(np.linalg.norm(cone.e - cone.d))
    sine = math.sin(math.atan2(cone.r1 - cone.r2, length))
    low = -radius / length * (sine if tip or closed else 1.0)
    high = 1.0 - radius * sine / length if closed else 1.0 + radius / length
    return np.maximum(low - k, k - high) * length


def scene(seed: int, closed: bool) -> tuple[HandModel, SphereTree, HandConfiguration, Any, Any]:
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    tree = cloud(random, int(random.integers(1, 400)), spread=0.12)
    at = random_hand(random, hand, 0.03)
    state, paper = tick_state(Stiffness().diagonal())[0], zeroed(PAPER_STATE)[0]
    paper.closed = closed
    set_pose(hand, state.pose, at)
    frustum_shapes(hand.arrays(), paper.shapes)
    return hand, tree, at, state, paper


@given(st.integers(0, 2**32 - 1), st.booleans())
@settings(max_examples=40)
def test_every_pair_of_the_equations_and_no_other_is_found(seed: int, closed: bool) -> None:
    hand, tree, at, state, paper = scene(seed, closed)
    detect(hand.arrays(), hand.palm_tree.arrays(), tree.arrays(), GROWTH, state, paper)
    assert not paper.full.any()
    joints = hand.joints(at.position[0], at.orientation[0], at.flexion[0], at.abduction[0])
    center, radius = tree.leaf_center, tree.leaf_radius + GROWTH
    candidates = state.candidates

    ball = np.concatenate([palm_spheres(hand.palm_tree.leaf_center, at.position, at.orientation)[0], joints[:, 0]])
    ball_radius = np.concatenate([hand.palm_tree.leaf_radius, hand.radius[:, 0]])
    local = np.concatenate([hand.palm_tree.leaf_center, hand.base])
    gap = np.linalg.norm(ball[:, None] - center, axis=2) - ball_radius[:, None] - radius
    found = np.zeros(gap.shape, int)
    for i in range(candidates.count[15]):
        hand_center = np.array([candidates.hand_x[i], candidates.hand_y[i], candidates.hand_z[i]])
        object_center = np.array([candidates.object_x[i], candidates.object_y[i], candidates.object_z[i]])
        row = np.flatnonzero((local == hand_center).all(axis=1) & (ball_radius == candidates.hand_radius[i]))
        column = np.flatnonzero((center == object_center).all(axis=1))
        found[row, column] += 1
    sure = np.abs(gap) > DOUBT
    np.testing.assert_array_equal(found[sure], (gap <= 0.0)[sure])

    for f in range(5):
        for k in range(3):
            body = 3 * f + k
            cone = frustum_of(hand, joints, f, k)
            excess, along = frustum_excess(cone, center, radius)
            outside = range_excess(cone, along, radius, k == 2, closed)
            apart = np.linalg.norm(center - joints[f, k + 1], axis=1) - hand.radius[f, k + 1] - radius
            frustum = (excess <= 0.0) & (outside <= 0.0)
            kind = np.zeros(tree.leaf_count, int)
            count = candidates.count[body]
            leaves = candidates.leaf[body, :count] - tree.leaf_start
            assert len(set(leaves.tolist())) == count
            kind[leaves] = paper.kind[body, :count]
            sure = (np.abs(excess) > DOUBT) & (np.abs(outside) > DOUBT)
            np.testing.assert_array_equal((kind & ON_FRUSTUM > 0)[sure], frustum[sure])
            sure = np.abs(apart) > DOUBT
            np.testing.assert_array_equal((kind & ON_SPHERE > 0)[sure], (apart <= 0.0)[sure])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_freedom_is_what_the_ungrown_hand_has(seed: int) -> None:
    hand, tree, _, state, paper = scene(seed, True)
    arrays, palm, leaves = hand.arrays(), hand.palm_tree.arrays(), tree.arrays()
    free = palm_is_free(arrays, palm, leaves, state.pose, state, paper)
    fingers = [finger_is_free(arrays, leaves, state.pose, f, state, paper) for f in range(5)]
    detect(arrays, palm, leaves, 0.0, state, paper)
    assert free == (state.candidates.count[15] == 0)
    assert fingers == [not state.candidates.count[3 * f : 3 * f + 3].any() for f in range(5)]


@pytest.mark.parametrize("hand", [RIGHT, LEFT], ids=["right", "left"])
def test_frustum_and_spheres_are_the_round_cone(hand: HandModel) -> None:
    joints = hand.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.full((5, 3), 0.3), np.zeros(5))
    state = tick_state(Stiffness().diagonal())[0]
    placed = np.zeros(1, FRUSTUM).view(np.recarray)[0]
    shapes = np.empty((15, SHAPE))
    frustum_shapes(hand.arrays(), shapes)
    at = HandConfiguration(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.full((1, 5, 3), 0.3), np.zeros((1, 5)))
    set_pose(hand, state.pose, at)
    for f in range(5):
        for k in range(3):
            cone = frustum_of(hand, joints, f, k)
            place_frustum(shapes, state.pose, f, k, placed)
            np.testing.assert_allclose(placed.end, cone.e, atol=1e-15)
            assert placed.radius == pytest.approx(cone.r2, abs=1e-15)
            assert placed.length == pytest.approx(np.linalg.norm(cone.e - cone.d), abs=1e-15)
            assert placed.length * placed.tangent == pytest.approx(cone.r1 - cone.r2, abs=1e-15)
            # Each bottom is a circle on its joint's sphere, and the side is tangent to that.
            for center, radius, bottom, size in (
                (joints[f, k], hand.radius[f, k], cone.d, cone.r1),
                (joints[f, k + 1], hand.radius[f, k + 1], cone.e, cone.r2),
            ):
                assert math.hypot(np.linalg.norm(bottom - center), size) == pytest.approx(radius, abs=1e-15)


def test_a_large_sphere_beyond_a_joint_is_in_contact_by_the_printed_range_alone() -> None:
    # Ahead of the middle phalanx of a bent finger, 5 mm from anything: Eq. 7 has it inside the cone's extension.
    flexion = np.zeros((1, 5, 3))
    flexion[0, 2] = [0.0, 0.0, 1.5]
    at = HandConfiguration(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), flexion, np.zeros((1, 5)))
    joints = RIGHT.joints(at.position[0], at.orientation[0], flexion[0], at.abduction[0])
    u = (joints[2, 2] - joints[2, 1]) / np.linalg.norm(joints[2, 2] - joints[2, 1])
    radius = 0.02
    up = np.array([0.0, -u[2], u[1]])
    center = joints[2, 2] + 0.98 * radius * u + 0.97 * (radius + RIGHT.radius[2, 2]) * up
    gap = np.linalg.norm(center - joints[2, 2]) - radius - RIGHT.radius[2, 2]
    assert gap > 5e-3
    tree = SphereTree(np.repeat(center[None], 2, axis=0), np.full(2, radius), np.arange(2), np.array([-1, 0]))
    for closed, expected in ((False, 1), (True, 0)):
        state, paper = tick_state(Stiffness().diagonal())[0], zeroed(PAPER_STATE)[0]
        paper.closed = closed
        set_pose(RIGHT, state.pose, at)
        frustum_shapes(RIGHT.arrays(), paper.shapes)
        detect(RIGHT.arrays(), RIGHT.palm_tree.arrays(), tree.arrays(), GROWTH, state, paper)
        assert state.candidates.count[7] == expected
