"""Pairs of two hands: distances against an independent kernel, rows against finite differences."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import sphere_tree

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.hand_pairs import HAND_PAIRS, hand_reach, hands_nearest, write_hand_row
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.hand.pose import copy_configuration, move, update_kinematics
from hhsim.metrics.metrics import distance_of_hands
from hhsim.motion.analytic_motion import random_targets
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import zeroed

HANDS = HandModel.default("right"), HandModel.default("left")
ARRAYS = tuple(hand.arrays() for hand in HANDS)
STEP = 1e-6
"""Of a finite difference [m, rad]."""


@pytest.fixture(scope="module")
def scene() -> tuple[Any, Any]:
    """State of each hand, and the record of their pairs."""
    air = sphere_tree(np.full((1, 3), 50.0), np.array([0.01])).arrays()
    pairs = zeroed(HAND_PAIRS)[0]
    pairs.reach[:] = [hand_reach(arrays) for arrays in ARRAYS]
    return tuple(HandSolver(hand, air, SolverOptions()).workspace.states[0] for hand in HANDS), pairs


def place(states: Any, seed: int) -> list[HandConfiguration]:
    random = np.random.default_rng(seed)
    found = [random_targets(hand, 2, random, hold=1).at(slice(1, 2)) for hand in HANDS]
    found[1] = found[1]._replace(position=found[1].position + random.normal(0.0, 0.08, 3))
    for arrays, state, at in zip(ARRAYS, states, found):
        for name in HandConfiguration._fields:
            state.pose[name][:] = getattr(at, name)[0]
        update_kinematics(arrays, state.pose)
    return found


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_least_distance_is_that_of_all_pairs(scene: Any, seed: int) -> None:
    states, pairs = scene
    placed = [forward_kinematics(hand, *at) for hand, at in zip(HANDS, place(states, seed))]
    wanted = float(distance_of_hands(HANDS, placed)[0])
    assert hands_nearest(ARRAYS, states, 10.0, pairs) == pytest.approx(wanted, abs=1e-12)
    assert hands_nearest(ARRAYS, states, wanted - 1e-9, pairs) == np.inf


@given(seed=st.integers(0, 2**32 - 1), first=st.integers(0, 30), second=st.integers(0, 30))
@settings(max_examples=40, deadline=None)
def test_a_row_is_the_rate_of_the_distance(scene: Any, seed: int, first: int, second: int) -> None:
    states, pairs = scene
    place(states, seed)
    write_hand_row(ARRAYS, states, first, second, 0, pairs)
    row = np.array(pairs.gradient[0]), np.array(pairs.spread[0])
    for h in range(2):
        pose = states[h].pose
        start = pose.copy()
        for j in range(DOF + 5):
            step, spread = np.zeros(DOF), np.zeros(5)
            (step if j < DOF else spread)[j % DOF] = 1.0
            found = []
            for way in (STEP, -STEP):
                copy_configuration(start, pose)
                move(pose, step, spread, way)
                update_kinematics(ARRAYS[h], pose)
                write_hand_row(ARRAYS, states, first, second, 1, pairs)
                found.append(float(pairs.distance[1]))
            rate = row[0][DOF * h + j] if j < DOF else row[1][h, j - DOF]
            # Where two phalanges are parallel, or one axis passes through the other, the rate jumps.
            assert (found[0] - found[1]) / (2 * STEP) == pytest.approx(rate, abs=2e-5)
        copy_configuration(start, pose)
        update_kinematics(ARRAYS[h], pose)
