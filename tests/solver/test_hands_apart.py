"""Hands that keep out of themselves and each other: known answers, hands alone, the same bytes, random ticks."""

from typing import Any

import numpy as np
import pytest
from conftest import sampled
from free_scenes import TIP, body_of, box, solver_of, tongs
from sphere_scenes import CURL, UNTIMED, bumpy_ball, record_clearance

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance, self_pairs
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.metrics import distance_of_hands, hand_clearance
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.scene.body import Body
from hhsim.solver.method import SURFACES, surface_of
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.solver import HandSolver, Solver
from hhsim.solver.workspace import TickWorkspace
from hhsim.trees.contact_surface import contact_surface
from hhsim.verify.mesh_distance import CLOSE, TrueSurface

HANDS = RIGHT, LEFT = HandModel.default("right"), HandModel.default("left")
BALL = load_object("sphere").mesh
NOWHERE = contact_surface("mesh", box((0.01, 0.01, 0.01), (50.0, 50.0, 50.0)), None)
"""What a hand in the air is beside."""
FREE = body_of(box((0.05, 0.05, 0.05), (50.0, 50.0, 50.0)), gravity=(0.0, 0.0, 0.0))
EITHER = sampled(["mesh", "spheres"], lambda place, _: place == 0)
"""Surfaces; a hand's own parts are the same beside either, and other tests compile it beside triangles, too."""
PINCH_FLEXION = np.zeros((5, 3))
PINCH_FLEXION[0], PINCH_FLEXION[1] = (0.1, 0.9, 0.9), (1.2, 1.2, 0.6)
PINCH = still(np.zeros(3), flexion=PINCH_FLEXION, abduction=np.array([0.5, 0.0, 0.0, 0.0, 0.0]))
OPEN = still(np.zeros(3))


def ball_of(surface: str, leaves: int) -> Any:
    """Arrays of a ball of triangles, or of so many spheres."""
    return contact_surface("mesh", BALL, None).arrays if surface == "mesh" else bumpy_ball(leaves).arrays()


def options_at(surface: Any, **options: Any) -> SolverOptions:
    kind = surface_of(getattr(surface, "arrays", surface))
    return SolverOptions(surface=next(name for name, known in SURFACES.items() if known is kind), **options)


def run(motion: HandConfiguration, surface: Any = NOWHERE, self_contact: bool = True) -> TickRecord:
    return HandSolver(RIGHT, surface, options_at(surface, self_contact=self_contact)).run(*motion)


def clearance(record: Any, hand: HandModel = RIGHT) -> FloatArray:
    return self_clearance(hand, self_pairs(hand), record.flexion, record.abduction)


def away(flexion: FloatArray, abduction: FloatArray) -> float:
    """The distance of one hand's own parts: the first hand is measured as a whole."""
    return float(self_clearance(RIGHT, self_pairs(RIGHT), flexion, abduction)[0])


def test_thumb_and_index_commanded_through_each_other_touch_and_push_alike() -> None:
    motion = OPEN.line(PINCH, 299).hold(60)
    assert clearance(motion).min() < -5e-3
    record = run(motion)
    assert clearance(record).min() >= 0.0 and away(record.flexion[-1:], record.abduction[-1:]) <= 1e-6
    assert not (record.status & (STATUS_LAG | STATUS_STUCK)).any()
    force = record.phalanx[-1].reshape(15, 3)
    bears = np.flatnonzero(np.linalg.norm(force, axis=1))
    assert {int(body) // 3 for body in bears} == {0, 1}
    assert np.linalg.norm(force[bears], axis=1).min() > 0.1
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(record.total[-1], 0.0, atol=1e-12)
    # The palm is where the user has it, and each joint is off by the moment of the force over its stiffness.
    np.testing.assert_allclose(record.position[-1], 0.0, atol=1e-9)
    off = (PINCH.flexion[0] - record.flexion[-1]).ravel() * SolverOptions().stiffness.flexion
    rate = [_rate(record, joint) for joint in range(15)]
    size = float(np.linalg.norm(force[bears[0]]))
    np.testing.assert_allclose(off, -size * np.array(rate), atol=2e-3 * size * 0.1)


def _rate(record: TickRecord, joint: int) -> float:
    """How fast the least distance of the last hand grows with a joint's angle [m/rad]."""
    flexion = np.repeat(record.flexion[-1:], 2, axis=0).reshape(2, 15)
    flexion[:, joint] += (1e-6, -1e-6)
    ahead, behind = (away(angles.reshape(1, 5, 3), record.abduction[-1:]) for angles in flexion)
    return (ahead - behind) / 2e-6


@pytest.mark.parametrize("surface", EITHER)
def test_where_nothing_meets_every_byte_is_as_without(surface: str) -> None:
    opened, grasped = still([0.0, -0.045, 0.056], flexion=0.4 * CURL), still([0.0, -0.045, 0.054], flexion=CURL)
    motion = opened.line(grasped, 119).hold(40)
    ours, theirs = (run(motion, ball_of(surface, 150), on) for on in (True, False))
    assert clearance(theirs).min() > 0.0 and np.linalg.norm(theirs.total[-1]) > 1.0
    for name in UNTIMED:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def test_a_hand_that_begins_in_itself_begins_beside() -> None:
    record = run(PINCH.hold(40))
    assert record.status[0] & STATUS_START_INSIDE and record.status[-1] == 0
    assert clearance(record).min() >= 0.0 and away(record.flexion[-1:], record.abduction[-1:]) < 1e-6


@pytest.mark.parametrize("free", [None, FREE], ids=["fixed", "free"])
def test_crossed_fingers_that_are_pressed_together_come_to_rest(free: Body | None) -> None:
    # Their distance bends by several times what the springs hold: steps of flat rows go to and fro.
    flexion = [[0.42, 0.34, 0.97], [-0.2, 1.25, 0.47], [1.09, 0.27, 1.53], [0.43, 0.5, 0.89], [0.81, 1.68, -0.32]]
    begin, goal = np.array(flexion), np.array(flexion)
    goal[3, 0] = -0.15
    abduction = np.array([0.51, -0.07, 0.43, 0.12, -0.27])
    alone = HandSolver(RIGHT, NOWHERE, options_at(NOWHERE, self_contact=True))
    solver = alone if free is None else solver_of(free, self_contact=True)
    solver.place(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), begin, abduction)
    record = solver.run(*still(np.zeros(3), flexion=goal, abduction=abduction).hold(300))
    assert clearance(record).min() >= 0.0 and clearance(record)[-1] < 1e-6
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
    motion = random_targets(RIGHT, 500, random, hold=20)
    record = run(motion, ball_of(surface, 60))
    assert clearance(motion).min() < -2e-3
    assert clearance(record).min() >= 0.0
    if surface == "spheres":
        assert record_clearance(RIGHT, bumpy_ball(60), record).min() >= 0.0
    else:
        shown = PlacedHand(record.joints, record.position, record.orientation)
        assert -CLOSE < TrueSurface(BALL).clearances(hand_shape(RIGHT), shown, 1e-3).min() < 1e-5


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


def pressing(ticks: int) -> list[HandConfiguration]:
    """Two fingers along x that come to press a block from both sides."""
    found, depth = [], np.linspace(-0.0002, SQUEEZE / SPRING, ticks)
    for side, turn in ((1.0, [1.0, 0.0, 0.0, 0.0]), (-1.0, [0.0, 0.0, 0.0, 1.0])):
        held = still((0.0, -side * ASIDE, 0.0), turn, ticks=ticks)
        held.position[:, 0] = -side * (0.5 * EDGE + TIP + REACH - depth)
        found.append(held)
    return found


class Pressed:
    """A block between two fingers, which weighs nothing until it is loaded."""

    def __init__(self) -> None:
        body = body_of(box([EDGE] * 3), mass=MASS, friction=FRICTION, gravity=(0.0, 0.0, 0.0))
        stiffness = Stiffness(SPRING, 1e4, 1e4)
        options = SolverOptions(surface="mesh", fingers=("index",), stiffness=stiffness)
        surface = contact_surface("mesh", body.mesh, None)
        self.solver = Solver([TickWorkspace(tongs(), surface, options) for _ in range(2)], [body])
        engine: Any = self.solver.engines[0]
        self.bodies = engine.world.bodies
        self.way = pressing(60)
        self.solver.solve(*self.way)

    def load(self, weight: float, ticks: int) -> tuple[Any, Any]:
        """Run some ticks with a weight [N]; the records of both hands, and the object's."""
        self.bodies[0].gravity[2] = -weight / MASS
        held = [one.part(-1).hold(ticks - 1) for one in self.way]
        return self.solver.solve(*held), self.solver.object_ticks


def test_a_block_hangs_between_two_hands_by_their_friction_and_slides_beyond_it() -> None:
    block = Pressed()
    for share in np.linspace(0.05, 0.99, 20):
        block.load(share * MOST, 10)
    block.load(0.99 * MOST, 400)
    hands, held = block.load(0.99 * MOST, 300)
    assert np.ptp(held.shift, axis=0).max() < 1e-9
    assert np.abs(held.velocity).max() < 1e-9
    assert [each.total[-1, 0] for each in hands] == pytest.approx([-SQUEEZE, SQUEEZE], rel=1e-2)
    assert all(each.total[-1, 2] == pytest.approx(-0.495 * MOST, rel=1e-6) for each in hands)
    assert block.load(1.01 * MOST, 100)[1].velocity[-1, 2] < -5e-3
    fallen = block.load(1.5 * MOST, 50)[1].velocity[:, 2]
    assert (fallen[-1] - fallen[9]) / 0.04 == pytest.approx(-0.5 * MOST / MASS, rel=1e-2)


FLIP = np.array([-1.0, 1.0, 1.0])
TURN = np.array([0.9, 0.1, 0.4, 0.05]) / np.linalg.norm([0.9, 0.1, 0.4, 0.05])
Pair = tuple[HandConfiguration, HandConfiguration]


def run_both(
    motions: Pair, surface: Any = NOWHERE, free: Body | None = None, **options: Any
) -> tuple[TickRecord, TickRecord]:
    """Run both hands, at a surface or at a free box; they are returned as that sees them."""
    if free is not None:
        surface = contact_surface("mesh", free.mesh, None)
    spaces = [TickWorkspace(hand, surface, options_at(surface, **options)) for hand in HANDS]
    solver = Solver(spaces, [] if free is None else [free])
    records: list[list[TickRecord]] = [[], []]
    for first in range(0, len(motions[0].position), 100):
        for kept, found in zip(records, solver.solve(*(motion.at(slice(first, first + 100)) for motion in motions))):
            kept.append(found)
    one, two = (TickRecord._make(np.concatenate(values) for values in zip(*kept)) for kept in records)
    return one, two


def apart(hands: Any) -> FloatArray:
    """Distance at each tick, by code of its own, of two hands given by their configurations or records."""
    placed = [forward_kinematics(hand, *HandConfiguration.of(one)) for hand, one in zip(HANDS, hands)]
    return distance_of_hands(HANDS, placed)


def mirrored(motion: HandConfiguration) -> HandConfiguration:
    return motion._replace(position=motion.position * FLIP, orientation=motion.orientation * [1.0, 1.0, -1.0, -1.0])


def through(depth: float, ticks: int = 150, hold: int = 60) -> Pair:
    """Hands that come from the sides, meet at the plane between them, and are then in each other by a depth [m]."""
    way = still([0.2, 0.0, 0.0]).line(still([-0.05, 0.0, 0.0]), 999)
    way = way._replace(orientation=np.tile(TURN, (1000, 1)))
    end = int(np.argmax(apart((way, mirrored(way))) <= -depth))
    right = way.at(slice(0, 1)).line(way.at(slice(end, end + 1)), ticks - 1).hold(hold)
    return right, mirrored(right)


@pytest.mark.parametrize(
    "options",
    sampled([{}, {"free": FREE}, {"self_contact": True}, {"method": "progressive"}], lambda place, _: place < 2),
)
def test_hands_commanded_through_each_other_touch_and_push_alike(options: dict[str, Any]) -> None:
    motions = through(0.015)
    assert apart(motions).min() < -0.014
    one, two = run_both(motions, **options)
    # Round bodies slip aside in the end.
    distance, rests = apart((one, two)), -20
    assert distance.min() >= 0.0 and distance[rests] <= 1e-6
    assert not ((one.status | two.status)[rests] & (STATUS_LAG | STATUS_STUCK))
    assert np.linalg.norm(one.total[rests]) > 0.2
    np.testing.assert_array_equal(one.total[: rests + 1], -two.total[: rests + 1])
    # What the other hand pushes with is what the user's pulls with, on either side.
    for record in (one, two):
        np.testing.assert_allclose(record.palm_wrench[rests, :3], record.total[rests], rtol=1e-2, atol=1e-3)


@pytest.mark.quick("mesh")
@pytest.mark.parametrize("surface", ["mesh", "spheres"])
def test_where_the_hands_are_far_every_byte_is_that_of_each_alone(surface: str) -> None:
    ball = ball_of(surface, 150)
    near = still([0.0, -0.045, 0.056]).line(still([0.0, -0.045, 0.04]), 119).hold(20)
    motions = near, HandConfiguration(near.position * [1.0, 1.0, -1.0], *near[1:])
    together = run_both(motions, ball)
    assert apart(together).min() > 0.0
    for hand, motion, record in zip(HANDS, motions, together):
        alone = HandSolver(hand, ball, options_at(ball)).run(*motion)
        assert np.abs(alone.total).max() > 1.0
        for name in UNTIMED:
            assert getattr(record, name).tobytes() == getattr(alone, name).tobytes(), name


@pytest.mark.parametrize("free", [None, FREE], ids=["fixed", "free"])
def test_hands_that_begin_in_each_other_begin_beside(free: Body | None) -> None:
    right = still([0.02, 0.0, 0.0]).hold(30)
    motions = right, mirrored(right)
    assert apart(motions).max() < -5e-3
    one, two = run_both(motions, free=free)
    assert one.status[0] == two.status[0] == STATUS_START_INSIDE, "they have come near, and have nothing left to go"
    distance = apart((one, two))
    assert distance.min() >= 0.0 and distance[-1] <= 1e-6
    np.testing.assert_array_equal(one.total, -two.total)


def random_hands(seed: int, ticks: int) -> Pair:
    random = np.random.default_rng(seed)
    right, left = (random_targets(hand, ticks, random, hold=20) for hand in HANDS)
    return right, left._replace(position=left.position + [0.02, 0.03, 0.02])


@pytest.mark.quick("0-mesh")
@pytest.mark.parametrize("surface", ["mesh", "spheres"])
@pytest.mark.parametrize("seed", range(20))
def test_random_ticks_enter_neither_hand_nor_object(surface: str, seed: int) -> None:
    ball, motions = ball_of(surface, 60), random_hands(seed, 300)
    options: dict[str, Any] = {"self_contact": True} if seed % 2 else {}
    records = run_both(motions, ball, **options)
    assert apart(motions).min() < -5e-3
    assert apart(records).min() >= 0.0
    for hand, record in zip(HANDS, records):
        if surface == "spheres":
            assert record_clearance(hand, bumpy_ball(60), record).min() >= 0.0
        else:
            shown = forward_kinematics(hand, *HandConfiguration.of(record))
            palm, fingers = hand_clearance(ball, hand_shape(hand), shown, limit=1.0)
            assert min(palm.min(), fingers.min()) >= 0.0
        if options:
            assert clearance(record, hand).min() >= 0.0
