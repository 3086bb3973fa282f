"""Bodies on sliders: a fall along the axis, friction that holds and brakes, limits, a push, and a stone on a cart."""

from typing import Any

import numpy as np
import pytest
from free_scenes import all_ticks, body_of, far_hand, solver_of

from hhsim.arrays import FloatArray
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.body import Body, Fixed, Joint

DT, G, MASS = 1e-3, 9.81, 0.3
STEEP = np.array([0.8, 0.0, -0.6])
"""An axis that goes down."""
PULL = 0.6 * MASS * G
"""Part of the weight along it [N]."""


def cart(velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), **given: Any) -> Body:
    """A plate of 200 × 150 × 20 mm on a slider, about the origin."""
    mesh = box_mesh((0.2, 0.15, 0.02))
    slider = Joint(**{"type": "slider", "axis": tuple((3.0 * STEEP).tolist()), **given})
    return body_of(mesh, mass=MASS, joint=slider, friction=0.5, velocity=velocity)


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
    pace = max(0.0, 1.0 - share) * PULL / MASS
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
    ticks = all_ticks(solver)
    of_cart, _, of_stone = ticks.bodies
    assert not record.status.any(), "it goes through the rail that bears it"
    speeds = of_cart.velocity[:, 0], of_stone.velocity[:, 0]
    np.testing.assert_allclose(MASS * speeds[0] + 0.2 * speeds[1], MASS * 0.3, rtol=1e-9)
    # Sliding friction is 0.5 of the stone's weight, until both are as fast.
    sliding = int(0.3 / (0.5 * G * (1.0 + 0.2 / MASS)) / DT)
    pace = np.polyfit(DT * np.arange(2, sliding - 1), speeds[1][2 : sliding - 1], 1)[0]
    assert pace == pytest.approx(0.5 * G, rel=0.003)
    np.testing.assert_allclose([one[-1] for one in speeds], MASS * 0.3 / (MASS + 0.2), rtol=1e-6)
    np.testing.assert_allclose(ticks.body_wrench[0, 100:, 2], -0.2 * G, rtol=1e-6)
    assert not of_cart.shift[:, 1:].any()
