"""Bodies on hinges and sliders: pendulum, falls, friction, limits, pushes, pairs, and hands beside moving parts."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from free_scenes import body_of, box, far_hand, solver_of
from msgspec import structs
from scipy.integrate import solve_ivp

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.moving_parts import MovingParts, TouchedObject
from hhsim.motion.analytic_motion import still
from hhsim.scene.body import Body, Fixed, Joint
from hhsim.scene.engine_scene import engine_scene
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import open_scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.triangle_tree import triangle_tree

DT, G = 1e-3, 9.81
ARM, MASS = 0.1, 0.3
"""Distance of the plate's centre from its hinge [m], and its mass [kg]."""
EDGES = (0.2, 0.15, 0.005)
INERTIA = MASS * ((EDGES[0] ** 2 + EDGES[2] ** 2) / 12 + ARM**2)
"""Of the plate about its hinge [kg·m²]."""
WEIGHT = MASS * G * ARM
"""Moment of the level plate's weight about its hinge [N·m]."""


def plate(**hinge: Any) -> Body:
    """A level plate from x = 0 to 0.2 m, on a hinge along -y through the origin: it opens upwards."""
    mesh = box_mesh(EDGES).transformed(np.eye(3), np.array([ARM, 0.0, 0.0]))
    axis = Joint(**{"type": "hinge", "axis": (0.0, -2.0, 0.0), "origin": (0.0, 0.3, 0.0), **hinge})
    return body_of(mesh, mass=MASS, joint=axis, friction=0.5)


def angles(turn: FloatArray) -> FloatArray:
    """Angle about -y of each orientation [rad], which has no other part."""
    assert np.abs(turn[:, [1, 3]]).max() < 1e-12
    return np.asarray(-2.0 * np.arctan2(turn[:, 2], turn[:, 0]))


def fallen(spin: float, angle: float) -> float:
    """Speed of the plate a tick on [rad/s], by its weight's moment in the middle of the tick."""
    found = spin
    for _ in range(2):
        found = spin - DT * WEIGHT / INERTIA * (np.cos(angle) - np.sin(angle) * 0.5 * DT * found)
    return float(found)


def swing(ticks: int, **hinge: Any) -> tuple[FloatArray, Any]:
    solver = solver_of(plate(**hinge))
    solver.run(*far_hand(ticks))
    return angles(solver.object_ticks.turn), solver.object_ticks


def test_a_plate_that_is_let_go_swings_as_a_pendulum() -> None:
    angle, ticks = swing(2000)
    spin, wanted, at = 0.0, np.zeros(2000), 0.0
    for i in range(2000):
        spin = fallen(spin, at)
        at += DT * spin
        wanted[i] = at
    np.testing.assert_allclose(angle, (wanted + np.pi) % (2 * np.pi) - np.pi, atol=1e-9)
    true = solve_ivp(
        lambda _, y: [y[1], -WEIGHT / INERTIA * np.cos(y[0])], (0, 2), [0, 0], t_eval=DT * np.arange(1, 2001), rtol=1e-9
    )
    half = [int(np.flatnonzero(np.diff(one) >= 0.0)[0]) for one in (angle, true.y[0])]
    assert half[0] == pytest.approx(half[1], rel=0.01), "half of a period"
    spin_at = ticks.angular_velocity[:, 1]
    energy = 0.5 * INERTIA * spin_at**2 + WEIGHT * np.sin(angle)
    assert (np.diff(energy) < 1e-9).all() and energy[-1] > -0.1 * WEIGHT, "it loses a little, and gains nothing"
    arm = ARM * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    # The hinge stays where it is: the velocity is that of the centre of mass about it.
    np.testing.assert_allclose(ticks.velocity[1:], np.diff(arm, axis=0) / DT, atol=1e-9)
    assert np.abs(ticks.shift).max() < 1e-12


@pytest.mark.parametrize("share", [0.999, 1.001, 1e-3, 100.0])
def test_friction_of_the_hinge_holds_the_plate_or_brakes_it(share: float) -> None:
    angle, ticks = swing(40, friction=share * WEIGHT)
    if share < 1.0:
        spin, at = 0.0, 0.0
        for i in range(40):
            spin = fallen(spin, at) + DT * share * WEIGHT / INERTIA
            at += DT * spin
            assert angle[i] == pytest.approx(at, rel=1e-6)
    else:
        assert np.abs(angle).max() < 1e-12 and np.abs(ticks.angular_velocity).max() < 1e-9


def test_limits_end_the_swing() -> None:
    angle, ticks = swing(1500, limits=(-0.7, 0.1))
    assert angle.min() == pytest.approx(-0.7, abs=1e-12) and angle[-1] == pytest.approx(-0.7, abs=1e-12)
    assert np.abs(ticks.angular_velocity[-100:]).max() < 1e-9
    fell = np.flatnonzero(angle < -0.69)[0]
    assert (np.diff(angle[:fell]) < 0.0).all()


CART_MASS = 0.3
STEEP = np.array([0.8, 0.0, -0.6])
"""An axis that goes down."""
PULL = 0.6 * CART_MASS * G
"""Part of the weight along it [N]."""


def cart(velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), **given: Any) -> Body:
    """A plate of 200 × 150 × 20 mm on a slider, about the origin."""
    mesh = box_mesh((0.2, 0.15, 0.02))
    slider = Joint(**{"type": "slider", "axis": tuple((3.0 * STEEP).tolist()), **given})
    return body_of(mesh, mass=CART_MASS, joint=slider, friction=0.5, velocity=velocity)


def slid(ticks: int, **given: Any) -> tuple[FloatArray, Any]:
    """The way of a cart that nothing touches [m], (T,), and its records; it neither turns nor leaves its axis."""
    solver = solver_of(cart(**given))
    solver.run(*far_hand(ticks))
    record = solver.object_ticks
    way = record.shift @ STEEP
    np.testing.assert_allclose(record.shift, np.outer(way, STEEP), atol=1e-12)
    assert (record.turn == [1.0, 0.0, 0.0, 0.0]).all() and not record.angular_velocity.any()
    np.testing.assert_allclose(record.velocity[1:], np.diff(record.shift, axis=0) / DT, atol=1e-9)
    return way, record


@pytest.mark.parametrize("share", [0.0, 0.4, 0.999, 1.001, 100.0])
def test_it_goes_down_as_its_weight_and_friction_have_it(share: float) -> None:
    way, _ = slid(50, friction=share * PULL)
    count = np.arange(1, 51)
    pace = max(0.0, 1.0 - share) * PULL / CART_MASS
    np.testing.assert_allclose(way, pace * DT**2 * count * (count + 1) / 2, rtol=2e-6, atol=1e-12)


def test_limits_end_the_way() -> None:
    way, record = slid(600, limits=(-0.1, 0.05))
    assert way.max() == pytest.approx(0.05, abs=1e-12) and way[-1] == pytest.approx(0.05, abs=1e-12)
    assert np.abs(record.velocity[-100:]).max() < 1e-9


def test_a_stone_on_a_cart_is_carried_along_by_friction_and_takes_its_share_of_the_momentum() -> None:
    rail = box_mesh((0.6, 0.05, 0.05)).transformed(np.eye(3), np.array([0.0, 0.0, -0.02]))
    stone = box_mesh((0.04, 0.04, 0.04)).transformed(np.eye(3), np.array([0.0, 0.0, 0.03 + 2e-6]))
    others = body_of(rail, "rail", friction=0.5, moves=Fixed()), body_of(stone, "stone", mass=0.2, friction=0.5)
    solver = solver_of(cart((0.3, 0.0, 0.0), axis=(1.0, 0.0, 0.0), on="rail"), others=others)
    record = solver.run(*far_hand(200))
    ticks = solver.solver.all_ticks
    of_cart, _, of_stone = ticks.bodies
    assert not record.status.any(), "it goes through the rail that bears it"
    speeds = of_cart.velocity[:, 0], of_stone.velocity[:, 0]
    np.testing.assert_allclose(CART_MASS * speeds[0] + 0.2 * speeds[1], CART_MASS * 0.3, rtol=1e-9)
    # Sliding friction is 0.5 of the stone's weight, until both are as fast.
    sliding = int(0.3 / (0.5 * G * (1.0 + 0.2 / CART_MASS)) / DT)
    pace = np.polyfit(DT * np.arange(2, sliding - 1), speeds[1][2 : sliding - 1], 1)[0]
    assert pace == pytest.approx(0.5 * G, rel=0.003)
    np.testing.assert_allclose([one[-1] for one in speeds], CART_MASS * 0.3 / (CART_MASS + 0.2), rtol=1e-6)
    np.testing.assert_allclose(ticks.body_wrench[0, 100:, 2], -0.2 * G, rtol=1e-6)
    assert not of_cart.shift[:, 1:].any()


STILL: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0)}
LONG = (0.2, 0.1, 0.02)


def run_pair(ticks: int, **of_first: Any) -> tuple[Any, tuple[Body, Body]]:
    """The records of two plates without gravity that begin end to end, the first one on a joint of the second."""
    meshes = box(LONG, (0.1, 0.0, 0.0)), box(LONG, (-0.1, 0.0, 0.0))
    first = body_of(meshes[0], mass=0.3, **STILL, **of_first)
    second = body_of(meshes[1], "base", mass=0.5, **STILL)
    solver = solver_of(first, others=[second])
    record = solver.run(*far_hand(ticks))
    assert not record.status.any()
    return solver.solver.all_ticks, (first, second)


def energy_of(record: Any, bodies: tuple[Body, Body]) -> FloatArray:
    """Energy of both at each tick [J]; momentum and angular momentum about the origin are held to be kept."""
    momentum, angular, energy, begun = np.zeros(3), np.zeros(3), np.zeros(()), np.zeros(3)
    for ticks, body in zip(record.bodies, bodies):
        one, turn = body.solid, rotation_matrix(ticks.turn)
        inertia = turn @ np.array(one.inertia) @ turn.transpose(0, 2, 1)
        spun = np.einsum("tij,tj->ti", inertia, ticks.angular_velocity)
        moved = one.mass * ticks.velocity
        momentum = momentum + moved
        angular = angular + np.cross(turn @ np.array(one.center) + ticks.shift, moved) + spun
        energy = energy + 0.5 * (moved * ticks.velocity + spun * ticks.angular_velocity).sum(axis=1)
        begun = begun + one.mass * np.array(body.motion.velocity)
    np.testing.assert_allclose(momentum, np.tile(begun, (len(momentum), 1)), atol=1e-9)
    most = 2e-3 * float(np.linalg.norm(angular[0]))
    np.testing.assert_allclose(angular, np.tile(angular[0], (len(angular), 1)), atol=most)
    return energy


def beside(record: Any) -> tuple[FloatArray, FloatArray]:
    """Turn (T, 3, 3) and shift [m] (T, 3) of the first body beside the second one, from where they began."""
    first, second = record.bodies[:2]
    back = rotation_matrix(second.turn).transpose(0, 2, 1)
    return back @ rotation_matrix(first.turn), np.einsum("tij,tj->ti", back, first.shift - second.shift)


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.3, -0.2, 1.0)])
def test_what_turns_on_a_hinge_keeps_momenta_and_energy(axis: tuple[float, float, float]) -> None:
    given = {"joint": Joint("hinge", axis, on="base"), "velocity": (0.0, 0.02, 0.1)}
    record, free = run_pair(400, **given, angular_velocity=(0.5, 4.0, -2.0))
    turn, shift = beside(record)
    assert np.abs(shift).max() < 1e-6, "the origin is a point of both"
    along = np.array(axis) / np.linalg.norm(axis)
    assert np.abs(turn @ along - along).max() < 1e-6 and np.abs(turn - np.eye(3)).max() > 0.3
    energy = energy_of(record, free)
    assert (np.diff(energy) < 1e-6 * energy[0]).all() and energy[-1] > 0.98 * energy[0]
    first, second = record.body_wrench
    np.testing.assert_allclose(first[:, :3], -second[:, :3], atol=1e-9)


DRY: dict[str, Any] = {
    # Friction [N·m] or [N], axis, and the motion of the first body.
    "hinge": (0.002, (0.0, 0.0, 1.0), {"angular_velocity": (0.0, 0.0, 0.6)}),
    "slider": (0.15, (1.0, 0.0, 0.0), {"velocity": (0.2, 0.0, 0.0)}),
}


@pytest.mark.parametrize("kind", DRY)
def test_dry_friction_slows_two_things_until_they_go_on_as_one(kind: str) -> None:
    size, along, given = DRY[kind]
    record, free = run_pair(400, joint=Joint(kind, along, friction=size, on="base"), **given)
    energy = energy_of(record, free)
    assert (np.diff(energy) <= 1e-9).all()
    one, two = record.bodies[:2]
    apart = {"slider": one.velocity - two.velocity, "hinge": one.angular_velocity - two.angular_velocity}[kind]
    speed = apart @ along
    stops = int(np.argmax(np.abs(speed) < 1e-6))
    assert np.abs(speed[stops:]).max() < 1e-6 and 50 < stops < 350
    if kind == "slider":
        # The reduced mass of 0.3 and 0.5 kg.
        assert stops * DT == pytest.approx(0.2 * (0.3 * 0.5 / 0.8) / size, abs=2 * DT)
        np.testing.assert_allclose(record.body_wrench[0, : stops - 1, 0], -size, rtol=1e-3)
        assert np.abs(record.body_wrench[0, stops + 1 :]).max() < 1e-6
    else:
        # Both turn about the hinge, whose moment is that of friction alone.
        force, moment = record.body_wrench[0, : stops - 1, :3], record.body_wrench[0, : stops - 1, 5]
        lever = -rotation_matrix(one.turn[: stops - 1]) @ free[0].solid.center
        np.testing.assert_allclose(moment - np.cross(lever, force)[:, 2], -size, rtol=2e-3)


def test_what_moves_on_a_slider_keeps_momenta_and_turns_with_what_bears_it() -> None:
    slider = Joint("slider", (1.0, 0.0, 0.0), limits=(-0.01, 0.06), on="base")
    record, free = run_pair(600, joint=slider, velocity=(0.3, 0.0, 0.1))
    turn, shift = beside(record)
    assert np.abs(turn - np.eye(3)).max() < 1e-6
    # Of the first body's centre, which began on the axis.
    off = np.einsum("tij,j->ti", turn - np.eye(3), np.array(free[0].solid.center)) + shift
    assert np.abs(off[:, 1:]).max() < 1e-6 and off[:, 0].max() == pytest.approx(0.06, abs=1e-6)
    energy = energy_of(record, free)
    stops = int(np.argmax(off[:, 0] > 0.06 - 1e-6))
    assert energy[stops - 2] > 0.99 * energy[0] and energy[-1] < 0.9 * energy[0], "the stop is inelastic"


RADIUS, WALL = 0.008, 0.08
"""Radius of a finger in a book, and the distance of a wall from the book's hinge [m]."""
MICROMETRE = 1e-6


@pytest.mark.parametrize("surface", ["mesh", "spheres"])
@pytest.mark.quick("mesh")
def test_a_laptop_whose_lid_stands_still_gives_the_ticks_of_its_rigid_twin(surface: str) -> None:
    closed = structs.replace(resolve_trajectory("close"), joints={"lid": ((0.0, 1.92),)})
    scene = open_scene("laptop", closed, solid=surface == "spheres", level=3 if surface == "spheres" else 1).first(1500)
    seen, options = engine_scene(scene), SolverOptions(surface=surface)
    haptic = HandConfiguration.of(scene.hands[0].ticks)
    parts = HandSolver(scene.hands[0].model, seen.surface(surface), options).run(*haptic)
    twin = HandSolver(scene.hands[0].model, contact_surface(surface, seen.mesh, seen.tree), options).run(*haptic)
    assert np.linalg.norm(twin.total[-1]) > 1.0
    assert np.abs(parts.joints - twin.joints).max() < MICROMETRE
    # Leaves of a flat side make rows that imply each other, and which of them is kept depends on their order.
    assert np.abs(parts.total - twin.total).max() < (1e-6 if surface == "mesh" else 1e-3 * np.abs(twin.total).max())
    assert np.array_equal(parts.status, twin.status)


def trapped_finger(angles: FloatArray) -> tuple[MovingParts, HandModel, TickRecord]:
    """A straight index finger along y in a book that closes about y, between the hinge and a wall on a plate."""
    count = len(angles)
    meshes = box_mesh((0.3, 0.3, 0.01)), box_mesh((0.3, 0.3, 0.01)), box_mesh((0.01, 0.3, 0.03))
    path = np.zeros((count, 3, 7))
    path[:, :, 3] = 1.0
    path[:, 0, :3] = 0.15, 0.0, -0.005
    path[:, 2, :3] = WALL + 0.005, 0.0, 0.015
    path[:, 1, 3:] = turn = quaternion(np.outer(angles, [0.0, -1.0, 0.0]))
    path[:, 1, :3] = rotation_matrix(turn) @ np.array([0.15, 0.0, 0.005])
    # Trees are not touched.
    trees = tuple(triangle_tree(mesh, 1) for mesh in meshes)
    parts = MovingParts("book", ("back", "front", "wall"), meshes, trees, path, {"front": angles})
    default = HandModel.default("right")
    radius = default.radius.copy()
    radius[1] = RADIUS
    hand = replace(default, radius=radius)
    turned = quaternion(np.array([0.0, 0.0, -math.radians(5.0)]))
    index = hand.joints(np.zeros(3), turned, np.zeros((5, 3)), np.zeros(5))[1]
    assert np.ptp(index[:, 0]) < 1e-6
    position = np.array([0.06, -0.09, RADIUS + 5e-4]) - index[3]
    options = SolverOptions(surface="mesh", fingers=("index",))
    solver = HandSolver(hand, parts.surface("mesh"), options)
    found = solver.run(*still(position, turned, ticks=count))
    # Each way out once missed the limits by its program's tolerance, and began where the one before had ended.
    assert (found.flexion >= hand.flexion_min).all() and (found.flexion <= hand.flexion_max).all()
    return parts, hand, found


def test_a_book_that_shuts_on_a_finger_leaves_no_place_at_the_angle_that_geometry_says() -> None:
    # The circle of the finger touches both plates and the wall where it is inscribed in their angle.
    least = 2.0 * math.atan(RADIUS / (WALL - RADIUS))
    angles = np.concatenate([np.linspace(0.9, 0.18, 700), np.full(20, 0.18), np.linspace(0.18, 0.5, 300)])
    parts, hand, found = trapped_finger(angles)
    squeezed = found.status & STATUS_NO_PLACE > 0
    first = int(np.flatnonzero(squeezed)[0])
    assert angles[first] == pytest.approx(least, rel=0.01)
    assert not squeezed[angles > least + 0.01 * least].any()
    assert squeezed[(angles < 0.99 * least)].all()
    shown = PlacedHand(found.joints, found.position, found.orientation)
    fingers = np.array([False, True, False, False, False])
    touched = TouchedObject(parts.meshes[0], None, hand_shape(hand), fingers, 0.0, parts, "mesh")
    depth = touched.penetration(shown).depth
    assert depth[~squeezed].max() == 0.0
    # It yields to the wall and the lower plate, and is as deep in the other as they leave it.
    away = np.sin(angles) * (WALL - RADIUS) - np.cos(angles) * RADIUS
    assert depth[squeezed] == pytest.approx((RADIUS - away)[squeezed], rel=0.01, abs=2e-6)
    assert np.isfinite(found.total).all()
