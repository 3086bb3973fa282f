"""Two hands at one free object, against closed forms, each other's mirror image and a hand that is alone."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from free_scenes import TIP, body_of, box, tongs

from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.world.record import WorldRecord
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.scene_solver import WorldSolver
from hhsim.trees.contact_surface import contact_surface

EDGE = 0.04
"""Of the block [m]."""
REACH, ASIDE = 0.09, 0.03
"""Length of a pressing finger, and how far beside its palm it lies [m]."""
SPRING = 2e4
"""Of each palm [N/m]."""
SQUEEZE = 4.0
"""Of each hand [N]."""
FRICTION, MASS = 0.5, 0.5
MOST = 2.0 * FRICTION * SQUEEZE
"""Weight that two hands just hold [N]."""
BESIDE = 0.001
"""The fingers press this far above and below the middle, and one of them as far beside it [m]."""


class Run(NamedTuple):
    """Ticks of both hands, and the object's."""

    hands: tuple[TickRecord, ...]
    object: WorldRecord


def pressing(ticks: int, height: float) -> list[HandConfiguration]:
    """Two fingers along x that come to press a block from both sides, at heights of opposite sign [m]."""
    found, straight = [], (np.zeros((ticks, 5, 3)), np.zeros((ticks, 5)))
    for side, turn in ((1.0, [1.0, 0.0, 0.0, 0.0]), (-1.0, [0.0, 0.0, 0.0, 1.0])):
        depth = np.linspace(-0.0002, SQUEEZE / SPRING, ticks)
        away = 0.5 * EDGE + TIP + REACH - depth
        position = np.stack([-side * away, np.full(ticks, -side * ASIDE), np.full(ticks, side * height)], axis=1)
        found.append(HandConfiguration(position, np.tile(turn, (ticks, 1)), *straight))
    return found


class Pressed:
    """A block between two fingers, which weighs nothing until it is loaded."""

    def __init__(self, height: float = 0.0, friction: float = FRICTION) -> None:
        body = body_of(box([EDGE] * 3), mass=MASS, friction=friction, gravity=(0.0, 0.0, 0.0))
        stiffness = Stiffness(SPRING, 1e4, 1e4)
        options = SolverOptions(surface="mesh", fingers=("index",), stiffness=stiffness)
        surface = contact_surface("mesh", body.mesh, None)
        self.solver = WorldSolver([HandSolver(tongs(), surface, options) for _ in range(2)], body)
        engine: Any = self.solver.engine
        self.bodies = engine.world.bodies
        self.way = pressing(60, height)
        self.approach = Run(self.solver.run(*self.way), self.solver.object_ticks)

    def load(self, weight: float, ticks: int) -> Run:
        """Run some ticks with a weight [N]."""
        self.bodies[0].gravity[2] = -weight / MASS
        held = [HandConfiguration(*(np.repeat(values[-1:], ticks, axis=0) for values in one)) for one in self.way]
        return Run(self.solver.run(*held), self.solver.object_ticks)


def test_a_block_hangs_between_two_hands_by_their_friction_and_slides_beyond_it() -> None:
    block = Pressed()
    for share in np.linspace(0.05, 0.99, 20):
        block.load(share * MOST, 10)
    block.load(0.99 * MOST, 400)
    held = block.load(0.99 * MOST, 300)
    assert np.ptp(held.object.shift, axis=0).max() < 1e-9
    assert np.abs(held.object.velocity).max() < 1e-9
    pushes = [each.total[-1, 0] for each in held.hands]
    assert pushes == pytest.approx([-SQUEEZE, SQUEEZE], rel=1e-2)
    assert all(each.total[-1, 2] == pytest.approx(-0.495 * MOST, rel=1e-6) for each in held.hands)
    beyond = block.load(1.01 * MOST, 100)
    assert beyond.object.velocity[-1, 2] < -5e-3
    fallen = block.load(1.5 * MOST, 50).object.velocity[:, 2]
    assert (fallen[-1] - fallen[9]) / 0.04 == pytest.approx(-0.5 * MOST / MASS, rel=1e-2)


def test_forces_and_motion_agree_at_every_tick() -> None:
    block = Pressed(BESIDE)
    runs = [block.load(share * MOST, 40).object for share in (0.3, 0.8, 1.3)]
    before = block.approach.object
    for share, ticks in zip((0.3, 0.8, 1.3), runs):
        velocity = np.concatenate([before.velocity[-1:], ticks.velocity])
        weight = [0.0, 0.0, -share * MOST]
        found = MASS * np.diff(velocity, axis=0) / 1e-3
        np.testing.assert_allclose(found, ticks.hand_wrench[:, :3] + weight, atol=1e-8)
        inertia = MASS * EDGE**2 / 6.0
        spin = np.concatenate([before.angular_velocity[-1:], ticks.angular_velocity])
        np.testing.assert_allclose(inertia * np.diff(spin, axis=0) / 1e-3, ticks.hand_wrench[:, 3:], atol=2e-6)
        rows = slice(0, ticks.contact[-1])
        own = np.zeros((len(ticks.turn), 3))
        tick = np.repeat(np.arange(len(own)), np.diff(ticks.contact))
        np.add.at(own, tick, -ticks.normal_force[rows, None] * ticks.normal[rows] - ticks.friction_force[rows])
        np.testing.assert_allclose(own, ticks.hand_wrench[:, :3], atol=1e-9)
        before = ticks
