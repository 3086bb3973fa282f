"""Only what a scene needs: fingers, work and tree level that a scene asks for, and what is told of it."""

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import bumpy_ball, random_targets, record_clearance

from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.surface import COUNT_PAIR_TESTS
from hhsim.kernels.tick.state import STATUS_LAG, WORK_BODIES, WORK_LINEARISATIONS, WORK_UNITS
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.metrics import penetration
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.triangle_tree import coarsest_sphere_tree

HAND = HandModel.default()
BALL = bumpy_ball(1200)
METHODS = ("coupled", "progressive")


def closing(ticks: int = 400, depth: float = 0.02) -> HandConfiguration:
    """The hand comes down on the ball with curled fingers, deeper than it can; `depth` is where it ends [m]."""
    curled = np.full((5, 3), 0.6)
    start, end = still([0.0, -0.06, 0.16], flexion=curled), still([0.0, -0.06, depth], flexion=curled)
    return start.line(end, ticks - 1)


@pytest.mark.parametrize(
    ("method", "fingers"),
    sampled(
        [(method, fingers) for fingers in (("index",), ("thumb", "middle"), ()) for method in METHODS],
        lambda place, _: place in (0, 3, 4),
    ),
)
def test_fingers_that_a_scene_does_not_use_follow_the_users_hand(method: str, fingers: tuple[str, ...]) -> None:
    motion = closing()
    options = SolverOptions(method=method, fingers=fingers)
    record = HandSolver(HAND, BALL.arrays(), options).run(*motion)
    clearance = record_clearance(HAND, BALL, record)
    used = options.modelled()
    assert used.sum() == 3 * len(fingers) + 1
    assert clearance[:, used].min() >= 0.0
    assert clearance[:, ~used].min() < -1e-3, "the others go through"
    unused = [f for f, finger in enumerate(FINGERS) if finger not in fingers]
    np.testing.assert_allclose(record.flexion[:, unused], motion.flexion[:, unused], atol=1e-12)
    shown = PlacedHand(record.joints, record.position, record.orientation)
    depth = penetration(BALL.arrays(), hand_shape(HAND), shown, [finger in fingers for finger in FINGERS])
    assert depth.depth.max() == 0.0
    assert np.isnan(depth.finger[:, unused]).all()
    assert not np.isnan(depth.finger[:, [f for f in range(5) if f not in unused]]).any()
    whole = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method)).run(*motion)
    assert record.work[:, COUNT_PAIR_TESTS].sum() < whole.work[:, COUNT_PAIR_TESTS].sum()
    assert record.work[:, WORK_BODIES].max() <= 3 * len(fingers) + 1


@pytest.mark.parametrize("method", sampled(METHODS, lambda place, method: method == "coupled"))
def test_a_budget_ends_the_tick_and_leaves_lag_and_nothing_worse(method: str) -> None:
    motion = random_targets(HAND, 700, 4)
    free = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method, budget=UNLIMITED)).run(*motion)
    assert free.work[:, WORK_UNITS].max() > 200_000
    before = np.inf
    for budget in (100_000, 30_000, 1):
        record = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method, budget=budget)).run(*motion)
        again = HandSolver(HAND, BALL.arrays(), SolverOptions(method=method, budget=budget)).run(*motion)
        np.testing.assert_array_equal(record.joints, again.joints)
        assert record_clearance(HAND, BALL, record).min() >= 0.0
        units = record.work[:, WORK_UNITS]
        # A tick overshoots by the linearisation that it is in.
        assert units.max() < free.work[:, WORK_UNITS].max()
        assert units.sum() < before
        before = units.sum()
        if budget == 1:
            assert record.work[:, WORK_LINEARISATIONS].max() == 1
    assert (record.status & STATUS_LAG > 0).sum() > (free.status & STATUS_LAG > 0).sum()


def test_the_coarsest_level_within_the_budget_is_chosen() -> None:
    mesh = load_object("cube").mesh
    bound = {level: cached_sphere_tree(mesh, TreeOptions(level=level)).errors[-1].bound for level in (1, 2, 3)}
    for level in (1, 2, 3):
        tree = coarsest_sphere_tree(mesh, 1.001 * bound[level])
        assert (tree.depth, tree.errors[-1].bound) == (level, bound[level])
    with pytest.raises(InputError, match="it must be positive and finite"):
        coarsest_sphere_tree(mesh, 0.0)
