"""Method `paper` tick by tick: where it is right, where it fails and how that is told, and that it is the paper's."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from sphere_scenes import CURL, UNTIMED, brute_pairs, bumpy_ball, random_targets, record_clearance, sphere_tree

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
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


def grasp(ticks: int = 400, hold: int = 200) -> HandConfiguration:
    start = still([0.0, -0.045, 0.15])
    goal = still([0.0, -0.045, 0.052], flexion=CURL)
    return start.line(goal, ticks - 1).hold(hold)


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


def test_a_palm_on_a_ball_converges_to_the_known_optimum() -> None:
    # Pressed down beside its middle the palm yields and tilts. scipy minimises the paper's objective in Euler angles.
    centre, radius, stiffness = RIGHT.palm_tree.leaf_center, RIGHT.palm_tree.leaf_radius, SolverOptions().stiffness
    lowest = int(np.argmin(centre[:, 2] - radius + 0.2 * np.abs(centre[:, 0] - 0.015)))
    under = centre[lowest] - [0.0, 0.0, radius[lowest] + 0.03]
    ball = sphere_tree(under[None], np.array([0.02]))
    flexion = np.full((5, 3), 0.0)
    pressed = np.array([0.002, 0.0, -0.016])
    start, goal = still(np.zeros(3), flexion=flexion), still(pressed, flexion=flexion)
    record = paper(RIGHT, ball, start.line(goal, 399).hold(100))
    assert not record.status.any()

    def gap(q: FloatArray) -> float:
        world = q[:3] + centre @ Rotation.from_euler("xyz", q[3:]).as_matrix().T
        return 1e3 * float((np.linalg.norm(world - under, axis=1) - radius - 0.02).min())

    root = np.sqrt([stiffness.translation] * 3 + [stiffness.rotation] * 3)
    wanted = np.array([*pressed, 0.0, 0.0, 0.0])
    turned = Rotation.from_quat(record.orientation[-1], scalar_first=True).as_euler("xyz")
    reached = np.concatenate([record.position[-1], turned])
    best = MINIMIZE(
        lambda z: float(((z - root * wanted) ** 2).sum()),
        root * (reached + 1e-4),
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda z: gap(z / root)},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert best.success
    assert abs(gap(reached)) < 1e-6
    assert np.abs(reached[3:]).max() > 1e-3
    np.testing.assert_allclose(reached, best.x / root, atol=1e-5)
    assert record_clearance(RIGHT, ball, record).min() > -1e-5


def test_the_palm_s_torque_is_equation_1_in_euler_angles() -> None:
    turned = Rotation.from_euler("ZYX", [1.5, 0.8, 0.1]).as_quat(scalar_first=True)
    start, goal = still([0.0, 0.0, 0.16], turned), still([0.01, 0.0, 0.02], turned)
    record = paper(RIGHT, BALL, start.line(goal, 399))
    pressed = np.flatnonzero(np.linalg.norm(record.palm_wrench[:, :3], axis=1) > 1.0)
    assert len(pressed) > 50
    shown, wanted = (
        Rotation.from_quat(record.orientation[pressed], scalar_first=True),
        Rotation.from_euler("ZYX", [1.5, 0.8, 0.1]),
    )
    torque = SolverOptions().stiffness.rotation * (shown.as_euler("ZYX") - [1.5, 0.8, 0.1])[:, ::-1]
    np.testing.assert_allclose(record.palm_wrench[pressed, 3:], torque, atol=1e-9)
    vector = SolverOptions().stiffness.rotation * (shown * wanted.inv()).as_rotvec()
    assert np.abs(vector - torque).max() > 0.1 * np.abs(vector).max() > 1e-3


def test_a_gentle_grasp_is_that_of_progressive() -> None:
    motion = grasp()
    record = paper(RIGHT, BALL, motion)
    other = HandSolver(RIGHT, BALL.arrays(), SolverOptions(method="progressive")).run(*motion)
    assert not (record.status & STATUS_STUCK).any()
    touching = record.work[:, WORK_TOUCHING] > 0
    assert touching.sum() > 200
    apart = np.linalg.norm(record.joints - other.joints, axis=-1).max(axis=(1, 2))
    assert apart.max() < 1e-4
    assert record_clearance(RIGHT, BALL, record).min() > -1e-5


def test_a_hand_in_free_space_is_the_haptic_hand() -> None:
    far = sphere_tree(np.array([[5.0, 0.0, 0.0]]), np.array([0.01]))
    motion = random_targets(RIGHT, 200, 4, hold=1, sweep=True)
    record = paper(RIGHT, far, motion)
    np.testing.assert_allclose(record.position, motion.position, atol=1e-15)
    np.testing.assert_allclose(np.abs((record.orientation * motion.orientation).sum(axis=1)), 1.0, atol=1e-12)
    np.testing.assert_array_equal(record.flexion, motion.flexion)
    np.testing.assert_array_equal(record.abduction, motion.abduction)
    assert not record.status.any() and not record.work[:, WORK_CANDIDATES].any()
    assert not record.total.any()


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


def test_multipliers_balance_the_joints_coupling() -> None:
    # The index is held against one sphere; its contact is the nearest of many points of the phalanx's axis.
    free = np.zeros((5, 3))
    free[INDEX] = [0.2, 0.3, 0.2]
    bent = free.copy()
    bent[INDEX] = [0.4, 0.5, 0.3]
    tree = under_the_index(RIGHT, free, 0.02)
    start, goal = still(np.zeros(3), flexion=0.7 * free), still(np.zeros(3), flexion=bent)
    record = paper(RIGHT, tree, start.line(goal, 199).hold(50), force="kkt")
    assert record.work[-1, WORK_TOUCHING] == 1
    k = int(np.argmax(np.linalg.norm(record.phalanx[-1, INDEX], axis=1)))
    force, joints = record.phalanx[-1, INDEX, k], record.joints[-1, INDEX]
    shares = np.linspace(0.0, 1.0, 200001)
    axis = joints[k] + shares[:, None] * (joints[k + 1] - joints[k])
    size = RIGHT.radius[INDEX, k] + shares * (RIGHT.radius[INDEX, k + 1] - RIGHT.radius[INDEX, k])
    away = axis - tree.leaf_center[0]
    nearest = int(np.argmin(np.linalg.norm(away, axis=1) - size))
    normal = away[nearest] / np.linalg.norm(away[nearest])
    np.testing.assert_allclose(force, np.linalg.norm(force) * normal, atol=1e-4 * float(np.linalg.norm(force)))
    bends = np.cross(joints[1] - joints[0], joints[3] - joints[1])
    lever = np.cross(bends / np.linalg.norm(bends), axis[nearest] - size[nearest] * normal - joints[:3])
    lever[k + 1 :] = 0.0
    coupling = SolverOptions().stiffness.flexion * (bent[INDEX] - record.flexion[-1, INDEX])
    assert np.abs(coupling).max() > 1e-3
    np.testing.assert_allclose(lever @ force, -coupling, atol=1e-4 * float(np.abs(coupling).max()))


def test_more_pairs_than_there_is_room_for_leave_their_part_where_it_was() -> None:
    tip = RIGHT.joints([0.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], np.zeros((5, 3)), np.zeros(5))[1, 3]
    crowd = sphere_tree(np.repeat((tip - [0.0, 0.0, 0.05])[None], 5000, axis=0), np.full(5000, 1e-3))
    motion = still([0.0, 0.0, 0.4]).line(still([0.0, 0.0, 0.34]), 599)
    record = paper(RIGHT, crowd, motion)
    assert (record.status & STATUS_STUCK).any()
    np.testing.assert_array_equal(record.position, motion.position)
