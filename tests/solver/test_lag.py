"""Ticks that end on their way, and hands that begin where they cannot be: bounded forces, honest lag, finite poses."""

import math

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import bumpy_ball, random_targets, record_clearance

from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_LAG, STATUS_SNAP, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

HAND = HandModel.default()
METHODS = ("coupled", "progressive")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_forces_never_exceed_what_the_coupling_can_pull(method: str, seed: int) -> None:
    tree = bumpy_ball(1200)
    options = SolverOptions(method=method)
    motion = random_targets(HAND, 2400, seed)
    record = HandSolver(HAND, tree.arrays(), options).run(*motion)
    assert (record.status & STATUS_LAG > 0).any(), "the scene hardly provokes"
    # Each joint's torque acts on contacts that are at least a sixth of a phalanx away from it, or on several at once.
    palm = np.linalg.norm(record.palm_wrench[:, :3], axis=1) + np.linalg.norm(record.palm_wrench[:, 3:], axis=1) / 0.02
    torque = options.stiffness.flexion * np.abs(motion[2] - record.flexion).sum(axis=(1, 2))
    assert (np.linalg.norm(record.total, axis=1) <= palm + torque / 0.005).all()


@pytest.mark.parametrize("method", METHODS)
def test_lag_is_no_farther_than_the_users_hand(method: str) -> None:
    tree = bumpy_ball(300)
    motion = random_targets(HAND, 1200, 4)
    record = HandSolver(HAND, tree.arrays(), SolverOptions(method=method)).run(*motion)
    haptic = np.array([HAND.joints(*motion.at(t)) for t in range(1200)])
    far = np.linalg.norm(haptic - record.joints, axis=3).max(axis=(1, 2))
    lagging = record.status & (STATUS_LAG | STATUS_STUCK) > 0
    assert lagging.any()
    assert (record.lag[lagging] > 0.0).all()
    assert (record.lag[lagging] <= far[lagging] + 1e-9).all()
    # A hand that snaps has a way left, too.
    snaps = record.status & STATUS_SNAP > 0
    assert (record.lag[~lagging & ~snaps] == 0.0).all()
    assert (record.lag[snaps] <= far[snaps] + 1e-9).all()


@pytest.mark.parametrize("value", [math.nan, 1e7])
def test_a_hand_waits_for_its_first_sound_sample_where_that_is(value: float) -> None:
    tree = bumpy_ball(300)
    motion = still(np.array([0.0, 0.0, 0.3]), ticks=6)
    motion[0][:2] = value
    record = HandSolver(HAND, tree.arrays(), SolverOptions()).run(*motion)
    assert (record.status[:2] & STATUS_INPUT_INVALID > 0).all()
    assert not (record.status & STATUS_START_INSIDE).any()
    np.testing.assert_allclose(record.position, np.tile([0.0, 0.0, 0.3], (6, 1)), atol=1e-12)
    assert record_clearance(HAND, tree, record).min() > 0.0


@pytest.mark.parametrize(
    ("method", "limits"),
    sampled(
        [
            (method, limits)
            for limits in ({"budget": 5000}, {"budget": 20000}, {"linearisations": 1}, {"linearisations": 3})
            for method in METHODS
        ],
        lambda place, case: case == ("progressive", {"budget": 5000}),
    ),
)
def test_any_budget_gets_there_in_the_end(method: str, limits: dict[str, int]) -> None:
    # Small budgets end a tick in the middle of what it tries; begun anew as it began, the next would end there too.
    tree = bumpy_ball(300)
    hold = 2000
    motion = random_targets(HAND, 4 * hold, 4, hold=hold)
    record = HandSolver(HAND, tree.arrays(), SolverOptions(method=method, **limits)).run(*motion)  # type: ignore[arg-type]
    assert record_clearance(HAND, tree, record).min() >= 0.0
    # Each target is held for longer than the way to it takes.
    arrived = record.status & (STATUS_STUCK | STATUS_LAG) == 0
    nowhere = np.concatenate([[False], (np.diff(record.joints, axis=0) == 0.0).all(axis=(1, 2, 3))]) & ~arrived
    assert not arrived.all(), "the budget is no hindrance"
    longest = max(map(len, "".join("x" if s else " " for s in nowhere).split()), default=0)
    assert longest <= 5
    # What was not given the time to find a step is on its way, and no tick is stuck for it.
    assert "budget" not in limits or not (record.status & STATUS_STUCK).any()
    assert arrived[hold - 1 :: hold].all()
