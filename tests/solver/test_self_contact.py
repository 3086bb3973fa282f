"""A hand that keeps out of itself: known answers, the same bytes where nothing meets, and random ticks."""

from typing import Any

import numpy as np
import pytest
import trimesh
from free_scenes import body_of, box, solver_of
from sampled import sampled
from sphere_scenes import BALL_RADIUS, CURL, UNTIMED, bumpy_ball, record_clearance, sphere_tree

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance, self_pairs
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.mesh import Mesh
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_distance import CLOSE, TrueSurface

RIGHT = HandModel.default("right")
FAR = [50.0, 50.0, 50.0]
AIR: dict[str, Any] = {
    "mesh": contact_surface("mesh", box((0.02, 0.02, 0.02), FAR), None).arrays,
    "spheres": sphere_tree(np.array([FAR]), np.array([0.01])).arrays(),
}
"""What a hand in the air is beside, of either surface."""
OPTIONS = SolverOptions(self_contact=True)
EITHER = sampled(["mesh", "spheres"], lambda place, _: place == 0)
"""Surfaces; a hand's own parts are the same beside either, and other tests compile it beside triangles, too."""
PINCH_FLEXION = np.zeros((5, 3))
PINCH_FLEXION[0], PINCH_FLEXION[1] = (0.1, 0.9, 0.9), (1.2, 1.2, 0.6)
PINCH = still(np.zeros(3), flexion=PINCH_FLEXION, abduction=np.array([0.5, 0.0, 0.0, 0.0, 0.0]))
OPEN = still(np.zeros(3))


def run(motion: HandConfiguration, hand: HandModel = RIGHT, beside: Any = AIR, **options: Any) -> TickRecord:
    chosen = SolverOptions(**{"self_contact": True, "surface": "mesh", **options})
    return HandSolver(hand, beside[chosen.surface], chosen).run(*motion)


def clearance(hand: HandModel, record: Any) -> FloatArray:
    return self_clearance(hand, self_pairs(hand), record.flexion, record.abduction)


def away(hand: HandModel, flexion: FloatArray, abduction: FloatArray) -> float:
    """The distance of one hand's own parts: the first hand is measured as a whole."""
    return float(self_clearance(hand, self_pairs(hand), flexion, abduction)[0])


def closed(goal: HandConfiguration, ticks: int = 300, hold: int = 60) -> HandConfiguration:
    return OPEN.line(goal, ticks - 1).hold(hold)


def test_thumb_and_index_commanded_through_each_other_touch_and_push_alike() -> None:
    motion = closed(PINCH)
    assert clearance(RIGHT, motion).min() < -5e-3
    record = run(motion)
    assert clearance(RIGHT, record).min() >= 0.0 and away(RIGHT, record.flexion[-1:], record.abduction[-1:]) <= 1e-6
    assert not (record.status & (STATUS_LAG | STATUS_STUCK)).any()
    force = record.phalanx[-1].reshape(15, 3)
    bears = np.flatnonzero(np.linalg.norm(force, axis=1))
    assert {int(body) // 3 for body in bears} == {0, 1}
    assert np.linalg.norm(force[bears], axis=1).min() > 0.1
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(record.total[-1], 0.0, atol=1e-12)
    # The palm is where the user has it, and each joint is off by the moment of the force over its stiffness.
    np.testing.assert_allclose(record.position[-1], 0.0, atol=1e-9)
    off = (PINCH.flexion[0] - record.flexion[-1]).ravel() * OPTIONS.stiffness.flexion
    rate = [_rate(record, joint) for joint in range(15)]
    size = float(np.linalg.norm(force[bears[0]]))
    np.testing.assert_allclose(off, -size * np.array(rate), atol=2e-3 * size * 0.1)


def _rate(record: TickRecord, joint: int) -> float:
    """How fast the least distance of the last hand grows with a joint's angle [m/rad]."""
    flexion = np.repeat(record.flexion[-1:], 2, axis=0).reshape(2, 15)
    flexion[:, joint] += (1e-6, -1e-6)
    ahead, behind = (away(RIGHT, angles.reshape(1, 5, 3), record.abduction[-1:]) for angles in flexion)
    return (ahead - behind) / 2e-6


def ball(leaves: int) -> tuple[Mesh, SphereTree, dict[str, Any]]:
    """A ball of triangles, a bumpy one of spheres, and both as what a hand touches."""
    found = trimesh.creation.icosphere(subdivisions=2, radius=BALL_RADIUS)
    mesh, tree = Mesh(np.array(found.vertices), np.array(found.faces)), bumpy_ball(leaves)
    return mesh, tree, {"mesh": contact_surface("mesh", mesh, None).arrays, "spheres": tree.arrays()}


@pytest.mark.parametrize("surface", EITHER)
def test_where_nothing_meets_every_byte_is_as_without(surface: str) -> None:
    _, _, beside = ball(150)
    opened, grasped = still([0.0, -0.045, 0.056], flexion=0.4 * CURL), still([0.0, -0.045, 0.054], flexion=CURL)
    motion = opened.line(grasped, 119).hold(40)
    ours, theirs = (run(motion, beside=beside, surface=surface, self_contact=on) for on in (True, False))
    assert clearance(RIGHT, theirs).min() > 0.0 and np.linalg.norm(theirs.total[-1]) > 1.0
    for name in UNTIMED:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def test_a_hand_that_begins_in_itself_begins_beside() -> None:
    record = run(PINCH.hold(40))
    assert record.status[0] & STATUS_START_INSIDE and record.status[-1] == 0
    assert clearance(RIGHT, record).min() >= 0.0 and away(RIGHT, record.flexion[-1:], record.abduction[-1:]) < 1e-6


def beside_free(far: Mesh) -> HandSolver:
    return solver_of(body_of(far, gravity=(0.0, 0.0, 0.0)), self_contact=True)


@pytest.mark.parametrize("moves", [False, True], ids=["fixed", "free"])
def test_crossed_fingers_that_are_pressed_together_come_to_rest(moves: bool) -> None:
    # Their distance bends by several times what the springs hold: steps of flat rows go to and fro.
    flexion = [[0.42, 0.34, 0.97], [-0.2, 1.25, 0.47], [1.09, 0.27, 1.53], [0.43, 0.5, 0.89], [0.81, 1.68, -0.32]]
    begin, goal = np.array(flexion), np.array(flexion)
    goal[3, 0] = -0.15
    abduction = np.array([0.51, -0.07, 0.43, 0.12, -0.27])
    far = box((0.02, 0.02, 0.02), FAR)
    solver = (
        beside_free(far) if moves else HandSolver(RIGHT, AIR["mesh"], SolverOptions(self_contact=True, surface="mesh"))
    )
    solver.place(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), begin, abduction)
    record = solver.run(*still(np.zeros(3), flexion=goal, abduction=abduction).hold(300))
    assert clearance(RIGHT, record).min() >= 0.0 and clearance(RIGHT, record)[-1] < 1e-6
    assert not (record.status[20:] & (STATUS_LAG | STATUS_STUCK)).any()
    assert np.ptp(record.flexion[200:], axis=0).max() < 1e-8
    # All joints but the clamped ones are off by the moment of one force.
    off = (goal - record.flexion[-1]).ravel() * SolverOptions().stiffness.flexion
    rate = np.array([_rate(record, joint) for joint in range(15)])
    size = -(off @ rate) / (rate @ rate)
    assert size > 1.0
    np.testing.assert_allclose(off, -size * rate, atol=1e-4 * size * np.abs(rate).max())


@pytest.mark.parametrize("surface", EITHER)
@pytest.mark.parametrize("seed", sampled(range(20), lambda seed, _: seed == 0))
def test_random_ticks_never_enter_hand_or_object(seed: int, surface: str) -> None:
    random = np.random.default_rng(seed)
    (mesh, tree, beside), motion = ball(60), random_targets(RIGHT, 500, random, hold=20)
    record = run(motion, beside=beside, surface=surface)
    assert clearance(RIGHT, motion).min() < -2e-3
    assert clearance(RIGHT, record).min() >= 0.0
    if surface == "spheres":
        assert record_clearance(RIGHT, tree, record).min() >= 0.0
    else:
        shown = PlacedHand(record.joints, record.position, record.orientation)
        assert -CLOSE < TrueSurface(mesh).clearances(hand_shape(RIGHT), shown, 1e-3).min() < 1e-5
