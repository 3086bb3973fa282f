"""Ticks that end on their way, and hands that begin where they cannot be: bounded forces, honest lag, finite poses."""

import math

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import bumpy_ball, random_targets, record_clearance

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_LAG, STATUS_SNAP, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.catalogue import load_object
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.triangle_tree import tree_of_any

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


def test_what_does_not_touch_bears_no_force_on_the_way() -> None:
    tree = bumpy_ball(300)
    record = HandSolver(HAND, tree.arrays(), SolverOptions()).run(*random_targets(HAND, 2400, 7))
    clearance = record_clearance(HAND, tree, record).min(axis=1)
    free = (record.status & STATUS_LAG > 0) & (clearance > 2e-5)
    assert free.any()
    assert (np.linalg.norm(record.total[free], axis=1) == 0.0).all()


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


@pytest.mark.parametrize(
    ("limits", "flexion", "most"),
    [({"linearisations": 1}, 0.7, 0.8), ({"linearisations": 2}, 1.15, 0.2), ({"budget": 5000}, 1.15, 0.3)],
)
def test_a_hand_that_moves_fast_is_followed_at_every_tick(limits: dict[str, int], flexion: float, most: float) -> None:
    # Fingertips at 2 and at 4 m/s, faster than so few linearisations can follow. Every other step was taken back, and
    # the hand stayed where it was: it had as far to go as the user had gone.
    opened = still(np.array([0.0, -0.045, 0.056]), flexion=0.2)
    closed = still(np.array([0.0, -0.045, 0.050]), flexion=flexion)
    motion = opened.line(closed, 39)
    record = HandSolver(HAND, bumpy_ball(300).arrays(), SolverOptions(**limits)).run(*motion)  # type: ignore[arg-type]
    lagging = record.status & (STATUS_STUCK | STATUS_LAG) > 0
    assert lagging.sum() > 30
    assert not (record.status & STATUS_STUCK).any()
    assert (np.diff(record.joints, axis=0) != 0.0).any(axis=(1, 2, 3)).all()
    way = np.linalg.norm(HAND.joints(*(v[-1] for v in motion)) - HAND.joints(*motion.at(0)), axis=-1).max()
    assert record.lag.max() < most * way


def test_a_palm_between_two_places_that_lead_past_each_other_comes_to_rest() -> None:
    # Each linearisation of the palm at the cylinder's side led by a millimetre past the optimum to the other's place.
    cylinder = load_object("cylinder")
    tree = tree_of_any(cylinder.mesh, cylinder.level)
    surface = contact_surface("mesh", cylinder.mesh, tree)
    solver = HandSolver(HAND, surface.arrays, SolverOptions(surface="mesh"))
    targets = RandomTargets(HAND, sum(b"cylinder"), StressOptions(), center=tree.center[0], height=0.0)
    motion = targets.take(150).hold(20)
    record = solver.run(*motion)
    assert (record.status[:150] & STATUS_LAG > 0).any(), "the scene hardly provokes"
    assert not (record.status[-10:] & (STATUS_LAG | STATUS_STUCK)).any()
    assert np.abs(np.diff(record.joints[-10:], axis=0)).max() < 1e-9
