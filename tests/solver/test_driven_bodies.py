"""Driven bodies beside free ones: closed forms of what rides on them, is pushed by them, and is in their way."""

from typing import Any

import numpy as np
import pytest
from free_scenes import all_ticks, body_of, box, far_hand, solver_of

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.scene.body import Body, Driven, Fixed

DT, G = 1e-3, 9.81
GAP = 2e-6


def shifted(way: FloatArray, direction: Any = (1.0, 0.0, 0.0)) -> RigidMotion:
    """Motion by ways [m] along a direction, shape (T,)."""
    return RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (len(way), 1)), way[:, None] * np.array(direction))


def turned(angle: FloatArray, axis: Any = (0.0, 1.0, 0.0)) -> RigidMotion:
    """Motion by angles [rad] about an axis through the origin, shape (T,)."""
    return RigidMotion(quaternion(angle[:, None] * np.array(axis)), np.zeros((len(angle), 3)))


def play(body: Body, driven: Mesh, motion: RigidMotion, *others: Body, friction: float = 0.6) -> Any:
    """Records of the hand, far away, and of a free body, a driven one, and others."""
    goes = Driven(ObjectMotion(motion.shift, motion.turn))
    solver = solver_of(body, others=(body_of(driven, "driven", moves=goes, friction=friction), *others))
    return solver.run(*far_hand(len(motion.turn))), all_ticks(solver)


def block(mass: float = 0.1, friction: float = 0.6, **given: Any) -> Body:
    """A cube of 40 mm that stands 2 µm above z = 0."""
    return body_of(box((0.04, 0.04, 0.04), (0.0, 0.0, 0.02 + GAP)), mass=mass, friction=friction, **given)


PLATE = box((1.0, 0.2, 0.02), (0.0, 0.0, -0.01))


@pytest.mark.parametrize("share", [0.5, 0.99, 1.5])
def test_a_block_rides_on_a_plate_unless_it_is_drawn_away_faster_than_friction_accelerates(share: float) -> None:
    ticks, mu = 400, 0.5
    speed = share * mu * G * DT * np.clip(np.arange(ticks) - 20, 0, None)
    record, found = play(block(friction=mu), PLATE, shifted(np.cumsum(speed * DT)), friction=mu)
    assert not record.status.any()
    rides, drives = found.bodies[:2]
    np.testing.assert_allclose(drives.shift[:, 0], np.cumsum(speed * DT), atol=1e-9)
    np.testing.assert_allclose(rides.velocity[-1, 0], min(share, 1.0) / share * speed[-1], rtol=1e-3)
    np.testing.assert_allclose(found.body_wrench[0, -100:, 0].mean(), 0.1 * min(share, 1.0) * mu * G, rtol=1e-3)
    np.testing.assert_allclose(found.body_wrench[1, :, :3], -found.body_wrench[0, :, :3], atol=1e-9)
    if share < 1.0:
        slid = rides.shift[:, 0] - drives.shift[:, 0]
        assert np.abs(slid - slid[19]).max() < 1e-6


def test_a_block_on_a_plate_that_tilts_slides_at_the_angle_of_friction() -> None:
    ticks, mu = 900, 0.4
    angle = 0.6 * np.arange(ticks) / ticks
    record, found = play(block(friction=mu), PLATE, turned(angle), friction=mu)
    assert not record.status.any()
    first, second = found.bodies[:2]
    back = RigidMotion(second.turn, second.shift).seen_points(
        RigidMotion(first.turn, first.shift).points(np.zeros((ticks, 3)))
    )
    slides = int(np.argmax(np.linalg.norm(back - back[0], axis=1) > 1e-4))
    # Where it has slid by 0.1 mm the plate is a little steeper: d = ½ g' Δt² with g' from the angle beyond.
    assert np.arctan(mu) - 1e-3 < angle[slides] < np.arctan(mu) + 0.03


def test_a_press_stops_where_a_block_is_in_its_way_and_goes_on_where_it_is_not() -> None:
    ticks = 240
    way = np.interp(np.arange(ticks), [0, 100, 140, 200], [0.0, 0.005, 0.005, -0.002])
    press = box((0.1, 0.1, 0.02), (0.0, 0.0, 0.04 + GAP + 0.0125))
    anvil = body_of(PLATE, "anvil", moves=Fixed())
    _, found = play(block(), press, shifted(way, (0.0, 0.0, -1.0)), anvil)
    block_z, press_z = found.bodies[0].shift[:, 2], found.bodies[1].shift[:, 2]
    top, bottom = 0.04 + GAP + block_z, 0.0425 + GAP + press_z
    assert (bottom - top).min() > 0.0 and block_z.min() > -GAP, "nothing is entered"
    assert np.abs(press_z + np.minimum(way, 0.0025)).max() < 5e-6, "it stops at the block, and comes back as recorded"
    assert np.abs(press_z[-60:] + way[-60:]).max() < 1e-9
