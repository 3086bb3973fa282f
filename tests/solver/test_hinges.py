"""Hinged bodies: a pendulum, friction that holds and brakes, limits, a lid that a finger opens, and blocks on it."""

from typing import Any

import numpy as np
import pytest
from free_scenes import TIP, all_ticks, body_of, far_hand, solver_of, tongs, tongs_at
from scipy.integrate import solve_ivp

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.solver.free_object import FreeObject, Hinge
from hhsim.solver.hand_solver import HandSolver

DT, G = 1e-3, 9.81
ARM, MASS = 0.1, 0.3
"""Distance of the plate's centre from its hinge [m], and its mass [kg]."""
EDGES = (0.2, 0.15, 0.005)
INERTIA = MASS * ((EDGES[0] ** 2 + EDGES[2] ** 2) / 12 + ARM**2)
"""Of the plate about its hinge [kg·m²]."""
WEIGHT = MASS * G * ARM
"""Moment of the level plate's weight about its hinge [N·m]."""


def plate(**hinge: Any) -> tuple[Mesh, FreeObject]:
    """A level plate from x = 0 to 0.2 m, on a hinge along -y through the origin: it opens upwards."""
    mesh = box_mesh(EDGES).transformed(np.eye(3), np.array([ARM, 0.0, 0.0]))
    axis = Hinge(**{"axis": (0.0, -2.0, 0.0), "origin": (0.0, 0.3, 0.0), **hinge})
    return mesh, FreeObject.of_mesh(mesh, mass=MASS, hinge=axis, friction=0.5)


def angles(turn: FloatArray) -> FloatArray:
    """Angle about -y of each orientation [rad], which has no other part."""
    assert np.abs(turn[:, [1, 3]]).max() < 1e-12
    return np.asarray(-2.0 * np.arctan2(turn[:, 2], turn[:, 0]))


def arms(angle: FloatArray) -> FloatArray:
    """Place of the plate's centre of mass from its hinge [m], (T, 3)."""
    return ARM * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)


def about_hinge(wrench: FloatArray, angle: FloatArray) -> FloatArray:
    """Moment about -y through the hinge of wrenches about the centre of mass [N·m]."""
    return np.asarray(-(wrench[:, 3:] + np.cross(arms(angle), wrench[:, :3]))[:, 1])


def fallen(spin: float, angle: float) -> float:
    """Speed of the plate a tick on [rad/s], by its weight's moment in the middle of the tick."""
    found = spin
    for _ in range(2):
        found = spin - DT * WEIGHT / INERTIA * (np.cos(angle) - np.sin(angle) * 0.5 * DT * found)
    return float(found)


def swing(ticks: int, **hinge: Any) -> tuple[FloatArray, Any]:
    solver = solver_of(*plate(**hinge))
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
    # The hinge stays where it is: the velocity is that of the centre of mass about it.
    np.testing.assert_allclose(ticks.velocity[1:], np.diff(arms(angle), axis=0) / DT, atol=1e-9)
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


def test_friction_takes_the_energy_that_it_is_to() -> None:
    mesh, free = plate(friction=0.05)
    still = {"gravity": (0.0, 0.0, 0.0), "angular_velocity": (0.0, -8.0, 0.0)}
    solver = solver_of(mesh, FreeObject(**{**vars(free), **still}))
    solver.run(*far_hand(1000))
    spin = -solver.object_ticks.angular_velocity[:, 1]
    stops = 8.0 * INERTIA / 0.05
    braked = 8.0 - 0.05 / INERTIA * DT * np.arange(1, 1001)
    np.testing.assert_allclose(spin, np.maximum(braked, 0.0), atol=1e-6 * 8.0)
    assert stops < 1.0 and np.abs(spin[-100:]).max() < 1e-9


def test_limits_end_the_swing() -> None:
    angle, ticks = swing(1500, limits=(-0.7, 0.1))
    assert angle.min() == pytest.approx(-0.7, abs=1e-12) and angle[-1] == pytest.approx(-0.7, abs=1e-12)
    assert np.abs(ticks.angular_velocity[-100:]).max() < 1e-9
    fell = np.flatnonzero(angle < -0.69)[0]
    assert (np.diff(angle[:fell]) < 0.0).all()


def lift(friction: float, ticks: int = 900) -> tuple[HandSolver, Any, Any]:
    """Two fingers rise under the far end of the level plate by 30 mm, and go down again."""
    mesh, free = plate(friction=friction, limits=(0.0, 2.0))
    up = 0.03 * np.interp(np.arange(ticks), [0, 600, 700, ticks], [0.0, 1.0, 1.0, -1.0])
    shift = np.stack([0 * up + 0.27, 0 * up, up - 0.0025 - 0.0081], axis=1)
    position, _, *bent = tongs_at(np.zeros(ticks), shift)
    solver = solver_of(mesh, free, hand=tongs())
    record = solver.run(position, np.tile([0.0, 0.0, 0.0, 1.0], (ticks, 1)), *bent)
    return solver, record, solver.object_ticks


def test_a_lid_opens_where_the_fingers_moment_exceeds_weight_and_friction_and_stays_open() -> None:
    friction = 1.5 * WEIGHT
    _, record, ticks = lift(friction)
    angle = angles(ticks.turn)
    before = np.concatenate([[0.0], angle[:-1]])
    moment = about_hinge(ticks.hand_wrench, before)  # forces have the directions of the tick's start
    assert not record.status.any()
    opens = int(np.flatnonzero(angle > 1e-9)[0])
    assert opens > 5, "friction holds it at first"
    assert moment[opens - 1] < WEIGHT + friction < 1.01 * moment[opens]
    assert (moment[:opens] < WEIGHT + friction).all() and moment[opens] < 1.1 * (WEIGHT + friction)
    # Euler's equation about the hinge: what the fingers, the weight and the friction leave.
    spin = -ticks.angular_velocity[:, 1]
    gained = INERTIA * np.diff(spin, prepend=0.0) / DT
    began = np.concatenate([[0.0], spin[:-1]])
    weight = np.array([fallen(*one) - one[0] for one in zip(began, before)]) * INERTIA / DT
    held = gained - moment - weight
    turns = np.abs(spin) > 1e-6
    np.testing.assert_allclose(held[turns], -friction * np.sign(spin[turns]), rtol=1e-5)
    assert np.abs(held[~turns]).max() < friction * (1 + 1e-9)
    # It holds its angle once the fingers are gone.
    assert 0.1 < angle[-1] == pytest.approx(angle.max(), abs=1e-9)
    assert np.abs(np.diff(angle[-100:])).max() < 1e-12


def test_a_lid_without_friction_falls_shut_behind_the_fingers() -> None:
    _, record, ticks = lift(0.0)
    angle = angles(ticks.turn)
    assert angle.max() > 0.1 and angle[-1] == pytest.approx(0.0, abs=1e-12)
    share = np.linspace(0.0, 1.0, 50)[:, None]
    ends = record.joints[:, :2, 0, None], record.joints[:, :2, 3, None]
    points = (ends[0] + share * (ends[1] - ends[0])).reshape(len(angle), -1, 3)
    seen = np.einsum("tji,tpj->tpi", rotation_matrix(ticks.turn), points - ticks.shift[:, None]) - [ARM, 0.0, 0.0]
    beyond = np.maximum(np.abs(seen) - 0.5 * np.array(EDGES), 0.0)
    assert np.linalg.norm(beyond, axis=2).min() > TIP, "straight fingers are beside the plate"


def test_a_lid_goes_through_what_it_hangs_on_and_bears_what_lies_on_it() -> None:
    mesh, free = plate(friction=2.0 * WEIGHT, on="base", limits=(-0.5, 1.5))
    base = box_mesh((0.1, 0.15, 0.1)).transformed(np.eye(3), np.array([0.0, 0.0, -0.04]))
    stone = box_mesh((0.04, 0.04, 0.04)).transformed(np.eye(3), np.array([0.1, 0.0, 0.0225 + 2e-6]))
    others = tuple(
        body_of(one, FreeObject.of_mesh(one, mass=mass, friction=0.8), name, fixed=fixed)
        for one, mass, fixed, name in ((base, 1.0, True, "base"), (stone, 0.2, False, "stone"))
    )
    solver = solver_of(mesh, free, others=others)
    record = solver.run(*far_hand(400))
    ticks = all_ticks(solver)
    assert not record.status.any()
    assert np.abs(angles(ticks.bodies[0].turn)).max() < 1e-9, "1.67 of its weight is less than twice"
    np.testing.assert_allclose(ticks.body_wrench[0, 100:, 2], -0.2 * G, rtol=1e-9)
    moment = about_hinge(ticks.body_wrench[0], np.zeros(400))[100:]
    np.testing.assert_allclose(moment, -0.2 * G * 0.1, rtol=1e-3)
    heavier = others[1]._replace(free=FreeObject.of_mesh(stone, mass=0.4, friction=0.8))
    solver = solver_of(mesh, free, others=(others[0], heavier))
    solver.run(*far_hand(100))
    tipped = angles(all_ticks(solver).bodies[0].turn)
    # Plate and stone turn as one about the hinge at first.
    inertia = INERTIA + 0.4 * (0.04**2 / 6 + 0.1**2 + 0.0225**2)
    falls = (2.0 * WEIGHT - WEIGHT - 0.4 * G * 0.1) / inertia
    assert tipped[20] == pytest.approx(falls * DT**2 * 21 * 22 / 2, rel=0.01)


def test_a_hinge_in_the_world_lets_the_lid_through_nothing() -> None:
    mesh, free = plate()
    box = box_mesh((0.1, 0.15, 0.1)).transformed(np.eye(3), np.array([0.1, 0.0, -0.0545]))
    solver = solver_of(mesh, free, others=[body_of(box, FreeObject.of_mesh(box, mass=1.0), fixed=True)])
    solver.run(*far_hand(200))
    # It falls 2 mm at most, onto a body that has no name either.
    angle = angles(all_ticks(solver).bodies[0].turn)
    assert -0.05 < angle[-1] < -0.001 and np.abs(np.diff(angle[-50:])).max() < 1e-9


@pytest.mark.parametrize(
    ("hinge", "wrong"),
    [
        ({"axis": (0.0, 0.0, 0.0)}, "the axis of the hinge has no direction"),
        ({"limits": (0.5, 1.0)}, "hinge limits 0.5 to 1 rad; expected angles from the start, with 0"),
        ({"limits": (-4.0, 1.0)}, "within ±π"),
        ({"friction": -1.0}, "hinge.friction"),
    ],
)
def test_what_is_no_hinge_is_refused(hinge: dict[str, Any], wrong: str) -> None:
    with pytest.raises(InputError, match=wrong):
        plate(**hinge)
