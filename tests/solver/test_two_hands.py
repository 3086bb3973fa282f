"""Two hands at one free object, against closed forms, each other's mirror image and a hand that is alone."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from free_scenes import TIP, body_of, box, far_hand, gripped, tongs, tongs_at
from referee_clearance import bodies_clearance

from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_SNAP, STATUS_START_INSIDE
from hhsim.metrics.metrics import distance_of_hands
from hhsim.solver.free_engine import FreeEngine
from hhsim.solver.free_object import EngineBody, FreeObject
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.world_solver import WorldSolver
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
    object: ObjectRecord


def two_handed(
    mesh: Any, free: FreeObject, hands: tuple[HandModel, HandModel], others: Sequence[EngineBody] = (), **options: Any
) -> WorldSolver:
    surface = contact_surface("mesh", mesh, None)
    chosen = SolverOptions(surface="mesh", **options)
    return WorldSolver([HandSolver(hand, surface, chosen) for hand in hands], free, others)


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

    def __init__(self, height: float = 0.0, friction: float = FRICTION, others: Sequence[EngineBody] = ()) -> None:
        mesh = box([EDGE] * 3)
        free = FreeObject.of_mesh(mesh, mass=MASS, friction=friction, gravity=(0.0, 0.0, 0.0))
        stiffness = Stiffness(SPRING, 1e4, 1e4)
        self.solver = two_handed(mesh, free, (tongs(), tongs()), others, fingers=("index",), stiffness=stiffness)
        engine: Any = self.solver.engine
        self.bodies = engine.world.bodies
        self.way = pressing(60, height)
        self.approach = Run(self.solver.run(*self.way), self.solver.object_ticks(0))

    def load(self, weight: float, ticks: int) -> Run:
        """Run some ticks with a weight [N]."""
        self.bodies[0].gravity[2] = -weight / MASS
        held = [HandConfiguration(*(np.repeat(values[-1:], ticks, axis=0) for values in one)) for one in self.way]
        return Run(self.solver.run(*held), self.solver.object_ticks(0))


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


def test_a_block_between_two_hands_bears_another_one_which_falls_with_it_when_they_let_go() -> None:
    mesh = box([0.02] * 3, np.array([0.0, 0.0, 0.5 * EDGE + 0.01 + 1e-6]))
    upper = FreeObject.of_mesh(mesh, mass=0.1, friction=FRICTION, gravity=(0.0, 0.0, 0.0))
    block = Pressed(others=[body_of(mesh, upper, "upper")])
    bodies = block.bodies
    for share in np.linspace(0.05, 0.5, 20):
        bodies[1].gravity[2] = -0.4 * share * MOST / 0.1
        block.load(share * MOST, 10)
    block.load(0.5 * MOST, 400)
    held = block.load(0.5 * MOST, 100)
    ticks = block.solver.all_ticks
    assert ticks is not None
    assert all(np.ptp(body.shift, axis=0).max() < 1e-9 for body in ticks.bodies)
    np.testing.assert_allclose(ticks.body_wrench[:, -1, 2], [-0.2 * MOST, 0.2 * MOST], rtol=1e-6)
    assert sum(each.total[-1, 2] for each in held.hands) == pytest.approx(-0.7 * MOST, rel=1e-6)
    block.load(1.2 * MOST, 60)
    falling = block.solver.all_ticks
    assert falling is not None and falling.bodies[0].velocity[-1, 2] < -0.1
    # The upper one weighs 0.2 of that: alone it would fall faster, and both fall as one.
    assert falling.bodies[1].velocity[-1, 2] == pytest.approx(falling.bodies[0].velocity[-1, 2], abs=1e-6)


def test_a_squeeze_off_by_a_lever_turns_the_block_about_its_middle() -> None:
    ticks = Pressed(BESIDE, friction=0.0).approach.object
    force = np.abs(np.diff(ticks.velocity[:, 0])).max()
    pressed = np.flatnonzero(ticks.contact[1:] - ticks.contact[:-1] == 2)[:5]
    assert pressed.size and force < 1e-9
    moment = MASS * EDGE**2 / 6.0 * np.diff(ticks.angular_velocity[:, 1], prepend=0.0) * 1e3
    load = ticks.normal_force[ticks.contact[pressed]]
    assert np.abs(moment[pressed]) == pytest.approx(2.0 * BESIDE * load, rel=1e-2)


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


def test_a_hand_with_the_other_one_far_away_is_as_it_is_alone() -> None:
    alone, closed = gripped(0.1, 0.5, 2.0)
    assert isinstance(alone.engine, FreeEngine)
    free = alone.engine.bodies[0].free
    chosen = alone.options
    surface = contact_surface("mesh", box((0.02, 0.03, 0.02), np.array(free.center)), None)
    record = HandSolver(tongs(), surface, chosen, free)
    motion = HandConfiguration(*tongs_at(np.r_[np.linspace(closed - 0.05, closed, 60), np.full(60, closed)]))
    wanted, far = record.run(*motion), HandConfiguration(*far_hand(120))
    assert np.abs(wanted.total).max() > 0.1
    for place in (0, 1):
        both = WorldSolver([HandSolver(tongs(), surface, chosen) for _ in range(2)], free)
        found = both.run(*((motion, far) if place == 0 else (far, motion)))[place]
        for name in ("status", "position", "joints", "total", "palm_wrench"):
            # To the rounding of sums over more variables.
            np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-9, atol=1e-12)
        object_ticks = both.object_ticks(place)
        for name in ("turn", "shift", "velocity", "hand_wrench", "contact"):
            given = getattr(record.object_ticks, name)
            np.testing.assert_allclose(getattr(object_ticks, name), given, rtol=1e-9, atol=1e-11)
        rows = slice(0, object_ticks.contact[-1])
        np.testing.assert_array_equal(object_ticks.body[rows], record.object_ticks.body[rows])


def test_mirrored_hands_bear_mirrored_forces() -> None:
    # So large that the hands do not meet beside it, with fingers that are not modelled.
    edge, flip = 0.14, np.array([-1.0, 1.0, 1.0])
    mesh = box([edge, EDGE, EDGE])
    free = FreeObject.of_mesh(mesh, mass=0.1, friction=FRICTION, gravity=(0.0, 0.0, 0.0))
    hands = HandModel.default("right"), HandModel.default("left")
    solver = two_handed(mesh, free, hands, fingers=("index", "middle"))
    ticks = 150
    turn = np.tile([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], (ticks, 1))
    flexion = np.zeros((ticks, 5, 3))
    flexion[:, :, 0] = np.linspace(0.0, 0.9, ticks)[:, None]
    position = np.tile([0.5 * edge + 0.03, -0.11, 0.0], (ticks, 1))
    right = HandConfiguration(position, turn, flexion, np.zeros((ticks, 5)))
    left = HandConfiguration(position * flip, turn * [1.0, 1.0, -1.0, -1.0], flexion, np.zeros((ticks, 5)))
    one, two = solver.run(right, left)
    assert np.abs(one.total).max() > 1.0 and np.abs(solver.object_ticks(0).shift[-1]).max() > 1e-3
    np.testing.assert_allclose(two.total * flip, one.total, atol=1e-9)
    np.testing.assert_allclose(two.palm_wrench[:, :3] * flip, one.palm_wrench[:, :3], atol=1e-9)
    np.testing.assert_allclose(two.joints * flip, one.joints, atol=1e-12)


@pytest.mark.parametrize("both", [False, True])
def test_hands_that_begin_in_a_second_thing_and_in_each_other_are_freed_of_all(both: bool) -> None:
    edge, hands = 0.06, (HandModel.default("right"), HandModel.default("left"))
    meshes = [box([edge] * 3, np.array([k * (edge + 1.1e-6), 0.0, 0.0])) for k in range(2)]
    free = [FreeObject.of_mesh(mesh, mass=MASS, friction=FRICTION, gravity=(0.0, 0.0, 0.0)) for mesh in meshes]
    solver = two_handed(meshes[0], free[0], hands, [body_of(meshes[1], free[1])])
    begin = np.array([edge, -0.05, 0.0])
    other = begin + (0.01, 0.0, 0.01) if both else np.array([-0.3, 0.3, 0.3])
    posture = np.array([[1.0, 0.0, 0.0, 0.0]]), np.full((1, 5, 3), 0.3), np.zeros((1, 5))
    records = solver.run(*(HandConfiguration(at[None], *posture) for at in (other, begin)))
    # Hands that pull on bodies from both sides may be on their way in the first tick.
    assert [int(each.status[0]) & ~(STATUS_LAG | STATUS_SNAP) for each in records] == [
        both * STATUS_START_INSIDE,
        STATUS_START_INSIDE,
    ]
    ticks = solver.all_ticks
    assert ticks is not None
    away = [bodies_clearance(hand, meshes, record, ticks.bodies) for hand, record in zip(hands, records)]
    placed = [PlacedHand(record.joints, record.position, record.orientation) for record in records]
    away.append(float(distance_of_hands(hands, placed).min()))
    assert 0.0 <= min(away) < 2e-6, "out of all, and as near as they come"


def test_what_has_no_free_objects_says_so() -> None:
    mesh = box([EDGE] * 3)
    with pytest.raises(InputError, match="method progressive has no free objects"):
        two_handed(mesh, FreeObject.of_mesh(mesh), (tongs(), tongs()), method="progressive")
