"""Method `paper` tick by tick: where it is right, where it fails and how that is told, and that it is the paper's."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from sphere_scenes import CURL, UNTIMED, brute_pairs, bumpy_ball, random_targets, record_clearance, sphere_tree

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
BALL = bumpy_ball(300)
INDEX = 1
MINIMIZE: Any = minimize


def paper(hand: HandModel, tree: SphereTree, motion: HandConfiguration, **options: object) -> TickRecord:
    record = HandSolver(hand, tree.arrays(), SolverOptions(method="paper", **options)).run(*motion)  # type: ignore[arg-type]
    for name in UNTIMED:
        assert np.isfinite(getattr(record, name)).all(), name
    return record


def under_the_index(hand: HandModel, flexion: FloatArray, radius: float) -> SphereTree:
    """One sphere that touches the pad of the index's distal phalanx from below."""
    joints = hand.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], flexion, np.zeros(5))[INDEX]
    u = (joints[3] - joints[2]) / np.linalg.norm(joints[3] - joints[2])
    below = np.cross(u, [1.0, 0.0, 0.0])
    below *= -np.sign(below[2]) / np.linalg.norm(below)
    middle = 0.4 * joints[2] + 0.6 * joints[3]
    return sphere_tree((middle + (hand.radius[INDEX, 2] + radius) * below)[None], np.array([radius]))


@pytest.mark.parametrize("hand", [RIGHT, LEFT], ids=["right", "left"])
@pytest.mark.parametrize("radius", [0.003, 0.02, 0.04])
def test_a_single_contact_converges_to_the_known_optimum(hand: HandModel, radius: float) -> None:
    # The index bends against one sphere; the palm is free. scipy minimises the coupling over the true distance.
    free = np.zeros((5, 3))
    free[INDEX] = [0.2, 0.3, 0.2]
    bent = free.copy()
    bent[INDEX] = [0.45, 0.6, 0.4]
    tree = under_the_index(hand, free, radius)
    start, goal = still(np.zeros(3), flexion=0.7 * free), still(np.zeros(3), flexion=bent)
    record = paper(hand, tree, start.line(goal, 299).hold(60))
    assert not record.status.any()
    np.testing.assert_array_equal(record.position, 0.0)

    def gap(angles: FloatArray) -> float:
        posed = bent.copy()
        posed[INDEX] = angles
        pairs = brute_pairs(hand, tree.leaf_center, tree.leaf_radius, still(np.zeros(3), flexion=posed))
        return 1e3 * float(pairs[3 * INDEX : 3 * INDEX + 3].min())

    best = MINIMIZE(
        lambda angles: float(((angles - bent[INDEX]) ** 2).sum()),
        record.flexion[-1, INDEX] + 1e-3,
        method="SLSQP",
        constraints={"type": "ineq", "fun": gap},
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert best.success
    assert abs(gap(record.flexion[-1, INDEX])) < 1e-6
    np.testing.assert_allclose(record.flexion[-1, INDEX], best.x, atol=2e-5)
    # And on the way, too: a linearisation that looks half a millimetre ahead is good to its second order.
    assert record_clearance(hand, tree, record).min() > -1e-5


def test_random_targets_make_it_penetrate_and_it_says_so() -> None:
    # The stress of algorithm.md: what the project's own methods stand, this one does not, and the record must show it.
    record = paper(RIGHT, BALL, random_targets(RIGHT, 3000, 0))
    clearance = record_clearance(RIGHT, BALL, record)
    assert clearance.min() < -1e-3
    assert (record.status & STATUS_STUCK).any()
    stuck = record.status & STATUS_STUCK > 0
    assert record.lag[stuck].max() > 0.0 and not record.lag[~stuck].any()
    assert (record.flexion >= RIGHT.flexion_min - 1e-6).all() and (record.flexion <= RIGHT.flexion_max + 1e-6).all()


def test_a_part_that_has_no_solution_stays_until_the_haptic_one_is_free() -> None:
    # A jump to the middle of a ball is not seen coming. Out again, palm and fingers follow.
    inside = still([0.0, -0.03, 0.0], flexion=CURL, ticks=20)
    motion = sequence(still([0.0, 0.0, 0.3], ticks=5), inside, still([0.0, 0.0, 0.3], ticks=5))
    record = paper(RIGHT, BALL, motion)
    assert (record.status[6:25] & STATUS_STUCK).all()
    assert not record.status[25:].any()
    np.testing.assert_array_equal(record.position[25:], motion.position[25:])
    np.testing.assert_array_equal(record.flexion[25:], motion.flexion[25:])
