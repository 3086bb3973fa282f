"""Rows of the program against finite differences of true distances, limits and clamps against what they mean."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import RIGHT, ROOT, moved, pair_of, row_matrix, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, brute_pairs, set_pose, tick_state

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.linearise import LIMIT_ROWS, build_rows, limit_start
from hhsim.kernels.hand.kinematics import DOF
from hhsim.motion.analytic_motion import still
from hhsim.trees.sphere_tree import SphereTree

STEP = 1e-6
"""Of the central differences [m, rad]: rounding of 1e-16 m / 1e-6, curvature of 1e-12 · 1e3 1/m."""
ACCURACY = 2e-7


def smooth_contacts(state: Any, tree: SphereTree) -> list[int]:
    """Contacts not so deep that a difference could cross the axis of a body, where the distance has a crease."""
    count = state.contacts.start[-1]
    return [i for i in range(count) if state.contacts.distance[i] > -0.9 * tree.leaf_radius[pair_of(state, tree, i)[1]]]


def rates(hand: HandModel, tree: SphereTree, at: HandConfiguration, step: FloatArray, turn: FloatArray) -> FloatArray:
    """How fast all distances change along a step and a turn of the abduction, as `brute_pairs`."""
    ahead, behind = (
        brute_pairs(hand, tree.leaf_center, tree.leaf_radius, moved(at, width * step, width * turn))
        for width in (STEP, -STEP)
    )
    return (ahead - behind) / (2.0 * STEP)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_rows_are_the_gradients_of_the_true_distances(seed: int) -> None:
    hand, tree, at, state = scene(seed)
    build_rows(hand.arrays(), state.pose, state.contacts, 5e-7, False, state.problem)
    matrix = row_matrix(state)
    difference = np.array([rates(hand, tree, at, direction, np.zeros(5)) for direction in np.eye(DOF)])
    for i in smooth_contacts(state, tree):
        np.testing.assert_allclose(matrix[i], difference[(slice(None), *pair_of(state, tree, i))], atol=ACCURACY)


@given(st.integers(0, 2**32 - 1), st.floats(-0.3, 0.3))
@settings(max_examples=25)
def test_right_hand_sides_hold_offset_distance_and_abduction(seed: int, angle: float) -> None:
    hand, tree, at, state = scene(seed)
    offset = 5e-7
    distance = brute_pairs(hand, tree.leaf_center, tree.leaf_radius, at)
    rate = [rates(hand, tree, at, np.zeros(DOF), turn) for turn in np.eye(5)]
    state.problem.abduction_step[:] = angle * np.linspace(-1.0, 1.0, 5)
    build_rows(hand.arrays(), state.pose, state.contacts, offset, False, state.problem)
    for i in smooth_contacts(state, tree):
        body, leaf = pair_of(state, tree, i)
        follows = 0.0 if body >= PALM else rate[body // 3][body, leaf] * state.problem.abduction_step[body // 3]
        assert state.problem.rhs[i] == pytest.approx(offset - distance[body, leaf] - follows, abs=ACCURACY)


def about_limits(seed: int, beyond: float) -> tuple[np.random.Generator, Any, FloatArray, FloatArray, FloatArray]:
    """A hand, its flexion [rad], and where each joint may go: one beyond its limits by no more than it is."""
    random, state = np.random.default_rng(seed), tick_state(ROOT**2)
    flexion = random.uniform(RIGHT.flexion_min - beyond, RIGHT.flexion_max + beyond)
    set_pose(RIGHT, state.pose, still(np.zeros(3), flexion=flexion))
    return random, state, flexion, np.minimum(flexion, RIGHT.flexion_min), np.maximum(flexion, RIGHT.flexion_max)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.4]))
@settings(max_examples=40)
def test_limit_rows_say_what_the_limits_say(seed: int, beyond: float) -> None:
    random, state, flexion, low, high = about_limits(seed, beyond)
    state.contacts.start[:] = 0
    state.problem.common[:] = np.nan
    state.problem.block[:] = np.nan
    build_rows(RIGHT.arrays(), state.pose, state.contacts, 5e-7, False, state.problem)
    assert limit_start(state.contacts, 5) == LIMIT_ROWS
    step = random.normal(0.0, 1.0, (5, 3))
    reached = flexion + step
    for f in range(5):
        rows = slice(limit_start(state.contacts, f), limit_start(state.contacts, f + 1))
        assert (state.problem.common[:, rows] == 0.0).all()
        block, rhs = state.problem.block[:, rows], state.problem.rhs[rows]
        assert (rhs <= 0.0).all(), "standing still is allowed"
        holds = block.T @ (step[f] * ROOT[6 + 3 * f : 9 + 3 * f]) >= rhs
        assert holds.all() == bool(((reached[f] >= low[f]) & (reached[f] <= high[f])).all())
