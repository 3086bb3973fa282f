"""Forces by the paper's equations recomputed from poses, and programs of real ticks by another solver."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import LEFT, RIGHT, body_frames
from scipy.optimize import minimize_scalar
from sphere_scenes import (
    CURL,
    PALM,
    brute_pairs,
    bumpy_ball,
    engine_of,
    palm_spheres,
    prepared,
    random_targets,
    solve_prepared,
)

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import TOUCH, UNBOUNDED, UNLIMITED, SolverOptions, Stiffness
from hhsim.solver.qp import dense_problem, solve
from hhsim.solver.solver import HandSolver
from hhsim.trees.sphere_tree import SphereTree

BALL = bumpy_ball(400)
OVER_THE_BALL = np.array([0.0, -0.045, 0.058])


Pressed = tuple[HandConfiguration, HandConfiguration, TickRecord]


def press(hand: HandModel, flat: bool = False, **options: Any) -> Pressed:
    """From above, fingers straight, to a hand inside the ball, curled about it or flat, until nothing moves any more.

    Returns:
        The user's hand, the shown one, and the record of the hold.
    """
    if flat:
        goal = still([-0.02, 0.015, 0.045], abduction=0.02)
    else:
        goal = still(OVER_THE_BALL - [0.0, 0.0, 0.006], flexion=CURL, abduction=0.02)
    start = still(goal.position[0] + [0.0, 0.0, 0.1], abduction=0.02)
    solver = HandSolver(hand, BALL.arrays(), SolverOptions(**options))
    solver.run(*start.line(goal, 299))
    record = solver.run(*goal.hold(399))
    return goal, HandConfiguration.of(record).part(399), record


@pytest.mark.parametrize("flat", [False, True], ids=["curled", "flat"])
@pytest.mark.parametrize("method", ["coupled", "progressive"])
def test_fingertip_forces_are_those_of_figure_9(method: str, flat: bool) -> None:
    *ends, record = press(RIGHT, flat, method=method)
    haptic, graphic = (RIGHT.joints(*at.at(0)) for at in ends)
    pressed = 0
    for f in range(5):
        found = record.fingertip_normal[-1, f]
        if not record.phalanx[-1, f].any():
            assert not found.any()
            continue
        apart = graphic[f, 3] - haptic[f, 3]
        direction = (graphic[f, 3] - graphic[f, 2]) / np.linalg.norm(graphic[f, 3] - graphic[f, 2])
        across = apart - (apart @ direction) * direction
        expected = Stiffness().contact * np.linalg.norm(apart) * across / np.linalg.norm(across)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        pressed += 1
    assert pressed == 0 if flat else pressed >= 3


@pytest.mark.parametrize("hand", [RIGHT, LEFT], ids=["right", "left"])
def test_paper_forces_are_equation_14_over_the_spheres_in_touch(hand: HandModel) -> None:
    haptic, graphic, record = press(hand, force="paper")
    distance = brute_pairs(hand, BALL.leaf_center, BALL.leaf_radius, graphic)
    there, wanted = body_frames(hand, graphic), body_frames(hand, haptic)
    force = np.zeros((16, 3))
    touching = np.argwhere(distance <= TOUCH)
    assert len(touching) >= 3
    for row, leaf in touching:
        body = min(row, PALM)
        normal, point = nearest_on_hand(hand, BALL, graphic, row, leaf)
        same_point = (wanted[body] @ np.linalg.solve(there[body], [*point, 1.0]))[:3]
        force[body] += Stiffness().contact * np.linalg.norm(point - same_point) * normal
    np.testing.assert_allclose(record.phalanx[-1].reshape(15, 3), force[:PALM], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(record.total[-1], force.sum(axis=0), rtol=1e-6, atol=1e-6)


def nearest_on_hand(
    hand: HandModel, tree: SphereTree, at: HandConfiguration, row: int, leaf: int
) -> tuple[FloatArray, FloatArray]:
    """Normal from object to hand, and the hand's point nearest to a leaf: the axis is searched by golden section."""
    center = tree.leaf_center[leaf]
    if row >= PALM:
        middle = palm_spheres(hand.palm_tree.leaf_center, at.position, at.orientation)[0, row - PALM]
        radius = float(hand.palm_tree.leaf_radius[row - PALM])
    else:
        f, k = divmod(row, 3)
        joints = hand.joints(*at.at(0))[f, k : k + 2]
        radii = hand.radius[f, k : k + 2]

        def distance(share: float) -> float:
            x = joints[0] + share * (joints[1] - joints[0])
            return float(np.linalg.norm(center - x) - (radii[0] + share * (radii[1] - radii[0])))

        share = float(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10}).x)
        share = min((share, 0.0, 1.0), key=distance)
        middle = joints[0] + share * (joints[1] - joints[0])
        radius = float(radii[0] + share * (radii[1] - radii[0]))
    normal = (middle - center) / np.linalg.norm(middle - center)
    return normal, middle - radius * normal


TREE = bumpy_ball(600)
TICKS = 480


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_every_step_satisfies_all_rows_of_the_whole_hand(seed: int) -> None:
    # Without a budget, so that the programs are the same whatever work is said to cost, and without bound.
    options = SolverOptions(method="progressive", budget=UNLIMITED, snap_speed=UNBOUNDED)
    solver, motion = HandSolver(RIGHT, TREE.arrays(), options), random_targets(RIGHT, TICKS, seed, sweep=True)
    state = solver.workspace.states[0]
    solved, yielded = 0, 0
    for first in range(0, TICKS - 5, 5):
        solver.run(*motion.part(first, first + 5))
        if prepared(solver, motion, first + 5) == 0:
            continue
        problem, _ = dense_problem(engine_of(solver).method)
        if solve_prepared(solver) != OPTIMAL:
            assert solve(problem, "quadprog").status == "infeasible"
            continue
        assert (problem.matrix @ state.step.delta - problem.rhs).min() > -1e-9
        solved += 1
        # Fingers to which the palm yielded.
        yielded += bool((state.progressive.yields[:5] >= 0).any())
    assert solved > 20
    assert yielded > 3
