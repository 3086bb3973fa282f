"""Hinged bodies: a pendulum, friction that holds and brakes, limits, a lid that a finger opens, and blocks on it."""

from typing import Any

import numpy as np
import pytest
from free_scenes import body_of, far_hand, solver_of
from scipy.integrate import solve_ivp

from hhsim.arrays import FloatArray
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.body import Body, Joint

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


def arms(angle: FloatArray) -> FloatArray:
    """Place of the plate's centre of mass from its hinge [m], (T, 3)."""
    return ARM * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)


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


def test_limits_end_the_swing() -> None:
    angle, ticks = swing(1500, limits=(-0.7, 0.1))
    assert angle.min() == pytest.approx(-0.7, abs=1e-12) and angle[-1] == pytest.approx(-0.7, abs=1e-12)
    assert np.abs(ticks.angular_velocity[-100:]).max() < 1e-9
    fell = np.flatnonzero(angle < -0.69)[0]
    assert (np.diff(angle[:fell]) < 0.0).all()
