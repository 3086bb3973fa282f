"""Scenes of few large spheres whose answer is known: graphic pose to 1 µm and force to 0.1 %.

Where one contact acts through the palm's origin the answer is one line. Otherwise it is the equilibrium
G (q_g - q_h) = Σ λ_i ∇d_i with d_i >= ε, ε the clearance that contacts keep, found by scipy for true distances by brute
force: nothing of the solver under test is in it.
"""

from itertools import product
from typing import Any

import numpy as np
import pytest
from conftest import sampled
from contact_scenes import moved
from scipy.optimize import NonlinearConstraint, brentq, minimize, nnls
from sphere_scenes import brute_pairs, sphere_tree

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.solver import HandSolver
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default("right")
POSE = 1e-6
"""The issue's bars: 1 µm for any point of the hand, 0.1 % for forces."""
FORCE = 1e-3
OFFSET, SPRINGS = SolverOptions().offset, Stiffness()
PLANE = 1000.0
"""Radius [m] of a sphere that is a plane: it falls away by 5 µm within 100 mm."""


def hold(tree: SphereTree, goal: HandConfiguration, away: FloatArray, **options: Any) -> TickRecord:
    """Come from `away` [m] beside the goal in 200 ticks, then hold for 300."""
    start = goal._replace(position=goal.position + away)
    solver = HandSolver(HAND, tree.arrays(), SolverOptions(**options))
    record = solver.run(*start.line(goal, 199).hold(300))
    assert record.status[0] == 0
    assert record.status[-1] == 0
    return record


def equilibrium(tree: SphereTree, goal: HandConfiguration) -> FloatArray:
    """Offset (21,) of least coupling energy with every true distance at least ε, by scipy."""
    root = np.sqrt(SPRINGS.diagonal())

    def clearance(x: FloatArray) -> FloatArray:
        pairs = brute_pairs(HAND, tree.leaf_center, tree.leaf_radius, moved(goal, x / root))
        # In millimetres, so that scipy's tolerances mean the same for distances and energies.
        return 1e3 * (pairs.ravel() - OFFSET)

    def slope(x: FloatArray) -> FloatArray:
        columns = [(clearance(x + h) - clearance(x - h)) / (2.0 * h.max()) for h in 1e-5 * np.eye(21)]
        return np.stack(columns, axis=1)

    def energy(x: FloatArray) -> float:
        return 0.5 * float(x @ x)

    best = minimize(
        energy,
        np.zeros(21),
        jac=np.array,
        constraints=[NonlinearConstraint(clearance, 0.0, np.inf, jac=slope)],
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    # The optimum is known by its conditions, not by what scipy says of it: x = Σ λ_i ∇d_i, λ >= 0, over what touches.
    left = clearance(best.x)
    assert left.min() > -1e-5
    _, residual = nnls(slope(best.x)[left < 1e-5].T, best.x)
    assert residual < 2e-5 * np.linalg.norm(best.x)
    offset: FloatArray = best.x / root
    return offset


def raised(
    center: FloatArray, radius: FloatArray, goal: HandConfiguration, depth: float, towards: FloatArray
) -> SphereTree:
    """These spheres, moved along `towards` until the haptic hand is `depth` [m] inside of them."""

    def left(shift: float) -> float:
        return float(brute_pairs(HAND, center + shift * towards, radius, goal).min()) + depth

    assert left(-0.05) > 0.0
    shift = float(brentq(left, -0.05, 0.05, xtol=1e-14))
    return sphere_tree(center + shift * towards, radius)


def assert_known(record: TickRecord, goal: HandConfiguration, offset: FloatArray) -> None:
    """Every joint and the palm to 1 µm, total force and palm wrench to 0.1 %."""
    at = moved(goal, offset)
    joints = HAND.joints(*at.at(0))
    assert np.linalg.norm(record.joints[-1] - joints, axis=2).max() < POSE
    assert np.linalg.norm(record.position[-1] - at.position[0]) < POSE
    pull = SPRINGS.translation * offset[:3]
    assert np.linalg.norm(pull) > 0.02
    assert np.linalg.norm(record.total[-1] - pull) < FORCE * np.linalg.norm(pull)
    assert np.linalg.norm(record.palm_wrench[-1, :3] - pull) < FORCE * np.linalg.norm(pull)
    torque = SPRINGS.rotation * offset[3:6]
    scale = max(float(np.linalg.norm(torque)), 0.1 * float(np.linalg.norm(pull)))
    assert np.linalg.norm(record.palm_wrench[-1, 3:] - torque) < FORCE * scale


METHODS = ("coupled", "progressive")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("depth", [0.5e-3, 2e-3, 6e-3])
def test_a_palm_pressed_on_a_ball_through_its_origin(method: str, depth: float) -> None:
    """One line: no lever, hence no turn; the palm stands ε off the ball and the force is k_t (depth + ε)."""
    # The ball's centre lies on the ray from the palm's origin through a sphere, the lowest that is alone there.
    # The ball is small enough to touch no other, and the command stops short of its centre.
    ball = 2e-3
    lowest = np.argsort(HAND.palm_tree.leaf_center[:, 2] - HAND.palm_tree.leaf_radius)
    for sphere in lowest:
        arm, size = HAND.palm_tree.leaf_center[sphere], HAND.palm_tree.leaf_radius[sphere]
        out = arm / np.linalg.norm(arm)
        tree = sphere_tree((arm + (size + ball) * out)[None], np.array([ball]))
        touching = brute_pairs(HAND, tree.leaf_center, tree.leaf_radius, still(np.zeros(3)))[:, 0]
        if np.sum(touching < 1e-3) == 1:
            break
    assert np.sum(touching < 1e-9) == 1
    assert depth < size + ball
    goal = still(depth * out)
    record = hold(tree, goal, -0.05 * out, method=method)
    offset = np.zeros(21)
    offset[:3] = -(depth + OFFSET) * out
    assert_known(record, goal, offset)
    assert np.linalg.norm(record.total[-1]) == pytest.approx(1000.0 * (depth + OFFSET), rel=FORCE)


POINTING = np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 0.2], [1.2, 1.4, 0.8], [1.2, 1.4, 0.8], [1.2, 1.4, 0.8]])
"""An index finger that points, the others curled."""
AHEAD = np.array([0.0, 0.8, -0.6])
"""Where the tip of the pointing finger is the farthest point of the hand."""


def face_ahead(depth: float) -> tuple[SphereTree, HandConfiguration]:
    """A plane-like face across `AHEAD`, and the pointing hand with its tip `depth` [m] behind it."""
    goal = still(np.zeros(3), flexion=POINTING)
    tip = HAND.joints(*goal.at(0))[1, 3]
    tree = sphere_tree((tip + (HAND.radius[1, 3] - depth + PLANE) * AHEAD)[None], np.array([PLANE]))
    distance = brute_pairs(HAND, tree.leaf_center, tree.leaf_radius, goal)[:, 0]
    assert distance[5] == pytest.approx(-depth, abs=1e-9)
    assert np.delete(distance, 5).min() > 0.002, "no other body touches"
    return tree, goal


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("depth", [1e-3, 5e-3])
def test_a_fingertip_on_a_face_with_a_hand_that_does_not_bend(method: str, depth: float) -> None:
    """One line again: the hand's joints and wrist are so stiff that it is pushed back by depth + ε as one piece.

    In the paper's order it is the finger that gives way first, as far as it can; the palm does not feel it.
    """
    stiff = Stiffness(translation=1.0, rotation=1e5, flexion=1e5)
    tree, goal = face_ahead(depth)
    record = hold(tree, goal, -0.05 * AHEAD, stiffness=stiff, method=method)
    if method == "progressive":
        assert np.linalg.norm(record.position[-1]) < POSE
        return
    np.testing.assert_allclose(record.position[-1], -(depth + OFFSET) * AHEAD, atol=POSE)
    np.testing.assert_allclose(record.total[-1], -(depth + OFFSET) * AHEAD, atol=FORCE * depth)
    np.testing.assert_allclose(record.phalanx[-1, 1, 2], record.total[-1], atol=FORCE * depth)


@pytest.mark.parametrize("depth", sampled([1e-3, 4e-3, 7e-3], lambda place, depth: depth != 4e-3))
def test_a_fingertip_pressed_into_a_face(depth: float) -> None:
    tree, goal = face_ahead(depth)
    record = hold(tree, goal, -0.05 * AHEAD)
    assert_known(record, goal, equilibrium(tree, goal))
    # A face pushes along its normal, however the finger bends.
    assert np.linalg.norm(np.cross(record.total[-1], AHEAD)) < 1e-4 * np.linalg.norm(record.total[-1])
    np.testing.assert_allclose(record.phalanx[-1, 1, 2], record.total[-1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("depth", "radius"),
    sampled(product((1e-3, 6e-3), (0.02, 0.05)), lambda place, case: case in ((1e-3, 0.05), (6e-3, 0.02))),
)
def test_a_finger_on_a_sphere(depth: float, radius: float) -> None:
    flexion = np.zeros((5, 3))
    flexion[2] = [0.3, 0.3, 0.2]
    goal = still(np.zeros(3), flexion=flexion)
    joints = HAND.joints(*goal.at(0))
    down = np.cross(joints[2, 3] - joints[2, 2], [1.0, 0.0, 0.0])
    down *= np.sign(-down[2]) / np.linalg.norm(down)
    # Under the pad of the middle finger; the others are straight and far above it.
    tree = raised((joints[2, 3] + 0.07 * down)[None], np.array([radius]), goal, depth, -down)
    record = hold(tree, goal, -0.06 * down)
    assert_known(record, goal, equilibrium(tree, goal))
    bearing = np.argwhere(np.linalg.norm(record.phalanx[-1], axis=2) > 0.02)
    assert len(bearing) > 0
    assert (bearing[:, 0] == 2).all()


ROW = np.stack([np.linspace(-0.12, 0.12, 9), np.zeros(9), np.full(9, -0.08)], axis=1)
FACE = np.array([[0.0, 0.0, -PLANE - 0.08]])


@pytest.mark.parametrize(
    ("center", "radius", "depth"), [(ROW, 0.04, 1e-3), (ROW, 0.04, 5e-3), (FACE, PLANE, 1e-3), (FACE, PLANE, 4e-3)]
)
def test_a_flat_hand_on_a_cylinder_of_spheres_and_on_a_face(center: FloatArray, radius: float, depth: float) -> None:
    """Several contacts share the load of large spheres in a row across the palm, and the palm turns to suit them."""
    goal = still(np.zeros(3))
    tree = raised(center, np.full(len(center), radius), goal, depth, np.array([0.0, 0.0, 1.0]))
    record = hold(tree, goal, np.array([0.0, 0.0, 0.05]))
    assert_known(record, goal, equilibrium(tree, goal))
