"""One tick: what it takes, what it does without contact, what it never does, and the bits that it reports."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import bumpy_ball, object_tree, random_targets, record_clearance

from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import (
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_START_INSIDE,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_TOUCHING,
)
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import TOUCH, SolverOptions
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default("right")
BALL = bumpy_ball(300)
METHODS = ("coupled", "progressive")
FREE = [0.0, 0.0, 0.4]


def solver_at(tree: SphereTree, start: HandConfiguration, **options: Any) -> HandSolver:
    """A solver whose graphic hand is at the first configuration of a motion, free of the object."""
    solver = HandSolver(HAND, tree.arrays(), SolverOptions(**options))
    record = solver.run(*start.part(0, 1))
    assert record.status[0] == 0
    return solver


@given(st.integers(0, 2**32 - 1), st.sampled_from(METHODS))
@settings(max_examples=30)
def test_in_free_space_the_hand_goes_all_the_way(seed: int, method: str) -> None:
    random = np.random.default_rng(seed)
    target = random_targets(HAND, 1, seed, sweep=True)
    target = target._replace(position=random.normal(0.0, 0.02, (1, 3)) + [[0.0, 0.0, 0.5]])
    solver = solver_at(BALL, still(FREE), method=method)
    record = solver.run(*target)
    assert record.status[0] == 0
    assert record.lag[0] == 0.0
    np.testing.assert_allclose(record.position, target.position, atol=1e-15)
    np.testing.assert_allclose(record.flexion, target.flexion, atol=1e-12)
    np.testing.assert_allclose(record.abduction, target.abduction, atol=1e-12)
    same = np.abs(np.sum(record.orientation * target.orientation, axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    np.testing.assert_allclose(record.joints[0], HAND.joints(*target.at(0)), atol=1e-12)


BAD = {
    "NaN position": ("position", (1,), np.nan),
    "infinite position": ("position", (2,), np.inf),
    "position nowhere near": ("position", (1,), 1e200),
    "position too far": ("position", (1,), -1e7),
    "NaN quaternion": ("orientation", (0,), np.nan),
    "zero quaternion": ("orientation", (slice(None),), 0.0),
    "NaN flexion": ("flexion", (3, 1), np.nan),
    "infinite flexion": ("flexion", (4, 2), -np.inf),
    "NaN abduction": ("abduction", (2,), np.nan),
    "two infinities that cancel": ("flexion", (0, slice(0, 2)), np.array([np.inf, -np.inf])),
}


@pytest.mark.parametrize("method", (*METHODS, "penalty"))
@pytest.mark.parametrize("name", BAD)
def test_input_that_is_none_is_held(name: str, method: str) -> None:
    channel, index, value = BAD[name]
    motion = still([0.0, -0.045, 0.052], flexion=0.4, ticks=6)
    motion = sequence(still(FREE), motion)
    bad = motion._replace(**{channel: getattr(motion, channel).copy()})
    getattr(bad, channel)[(slice(2, 4), *index)] = value
    fine, found = (HandSolver(HAND, BALL.arrays(), SolverOptions(method=method)).run(*moved) for moved in (motion, bad))
    np.testing.assert_array_equal(
        found.status & STATUS_INPUT_INVALID > 0, [False, False, True, True, False, False, False]
    )
    for kept in ("position", "orientation", "flexion", "abduction", "joints", "total"):
        np.testing.assert_array_equal(getattr(found, kept), getattr(fine, kept))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("tree", "position"),
    # In the middle thousands of palm pairs overlap: more than the tick's lists are made for.
    [(BALL, [0.0, -0.02, 0.02]), (object_tree("sphere", 3), [0.0, 0.0, 0.0])],
    ids=["inside", "in the middle"],
)
def test_starting_inside_begins_at_a_free_place(tree: SphereTree, position: list[float], method: str) -> None:
    motion = still(position, flexion=0.5, ticks=300)
    record = HandSolver(HAND, tree.arrays(), SolverOptions(method=method)).run(*motion)
    inside = record.status & STATUS_START_INSIDE > 0
    assert inside[0]
    assert not inside[1:].any()
    assert 0.0 <= record_clearance(HAND, tree, record).min() < 1e-5
    # As near as it can come: it ends in contact, and no further away than the ball is wide.
    assert record.work[-1, WORK_TOUCHING] > 0
    assert np.linalg.norm(record.position[-1] - motion.position[-1]) < 0.08


@pytest.mark.parametrize("method", METHODS)
def test_what_a_tick_counts(method: str) -> None:
    goal = still([0.0, -0.045, 0.052], flexion=0.5)
    motion = still(FREE).line(goal, 199).hold(50)
    record = solver_at(BALL, motion, method=method).run(*motion)
    clearance = record_clearance(HAND, BALL, record)
    touched = clearance.min(axis=1) <= TOUCH
    np.testing.assert_array_equal(record.work[:, WORK_TOUCHING] > 0, touched)
    assert touched[-1]
    assert record.work[-1, WORK_CANDIDATES] >= record.work[-1, WORK_TOUCHING]
    assert (record.work[:, WORK_LINEARISATIONS] <= SolverOptions().linearisations).all()
    lag = record.status & STATUS_LAG > 0
    np.testing.assert_array_equal(record.lag[lag] > 0.0, True)
    assert not record.status[-1]
