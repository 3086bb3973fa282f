"""Hard contacts: narrow, opposed, crowded, degenerate ones, and hands that begin where they cannot be."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.acceptance import least_clearance, part_of
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.postures import FIST, HALF, INDEX, POINTING, threaded, tip_at
from hhsim.bench.robustness.sphere_objects import BALL_RADIUS, ball, mould, plate, right_hand, ring, tree_of, usual_ball
from hhsim.bench.robustness.triangle_objects import (
    ball_mesh,
    box_mesh,
    joined_mesh,
    ring_mesh,
    roof_mesh,
    usual_ball_mesh,
)
from hhsim.bench.run_errors import placed_of
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import frozen_decay
from hhsim.motion.analytic_motion import random_targets, still
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

HANDLE_ROOM = 1e-3
"""A handle this much wider than the finger in it [m]."""


def _handle_place() -> tuple[FloatArray, FloatArray, float]:
    hand = right_hand()
    joints = hand.joints(np.zeros(3), quaternion(np.zeros(3)), POINTING, np.zeros(5))[INDEX]
    axis = (joints[2] - joints[1]) / np.linalg.norm(joints[2] - joints[1])
    inner = 0.5 * (hand.radius[INDEX, 1] + hand.radius[INDEX, 2]) + 0.5 * HANDLE_ROOM
    return 0.5 * (joints[1] + joints[2]), axis, float(inner)


HANDLE_PROFILE = 3e-3


def _handle(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 10])
    center, axis, inner = _handle_place()
    tree = ring(center, axis, inner, HANDLE_PROFILE)
    inside = still(np.zeros(3), flexion=POINTING)
    outside = inside._replace(position=inside.position - 0.12 * axis)
    motion = outside.hold(4).line(inside, 115).hold(5)
    for _ in range(30):
        target = still(random.normal(0.0, 0.004, 3), quaternion(random.normal(0.0, 0.05, 3)), POINTING)
        target.flexion[0, INDEX] = random.uniform(0.0, [0.2, 0.8, 0.8])
        motion = sequence(motion, target).hold(19)
    motion = motion.line(inside, 40).line(inside._replace(position=0.03 * axis[None]), 60).hold(40)
    motion = motion.line(inside, 60).hold(20).line(outside, 120).hold(20)
    mesh = ring_mesh(center, axis, inner, HANDLE_PROFILE)
    return [HardRun("ring", right_hand(), tree, motion, mesh=mesh)]


def _judge_handle(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    center, axis, inner = _handle_place()
    record = outcomes[0].ticks
    within = threaded(record.joints[:, INDEX], center, axis, inner + HANDLE_PROFILE)
    away = np.linalg.norm(record.position[-1] - outcomes[0].run.motion.position[-1])
    return [
        Figure("ticks of shaking with the finger through the ring's side", int((~within[125:725]).sum()), 0),
        Figure("way left after pulling it out", float(away), 1e-6, "m"),
    ]


def _opposed(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 11])
    hand = right_hand()
    runs = [HardRun("wedge", hand, _wedge(), _wedge_motion(), mesh=_wedge_mesh())]
    down = quaternion(np.array([-0.5 * np.pi, 0.0, 0.0]))
    # A fingertip fits between the bunny's ears, and a finger between the cup's wall and its handle, with 2 to 3 mm.
    places = (
        ("bunny", "between the bunny's ears", (-0.0324, 0.008, 0.0443), down, (0.0, 0.0, -1.0)),
        ("cup", "in the cup's handle", (0.0331, 0.012, -0.0022), quaternion(np.zeros(3)), (0.0, 1.0, 0.0)),
    )
    for name, title, point, orientation, way in places:
        thing = load_object(name)
        tree = cached_sphere_tree(thing.mesh, TreeOptions(level=thing.level))
        goal = still(tip_at(hand, np.array(point), orientation, POINTING), orientation, POINTING)
        start = goal._replace(position=goal.position - 0.1 * np.array(way))
        deep = goal._replace(position=goal.position + 0.02 * np.array(way))
        motion = start.hold(4).line(goal, 120).line(deep, 60).hold(20)
        for _ in range(25):
            target = still(
                goal.position[0] + random.normal(0.0, 0.01, 3),
                quaternion(random.normal(0.0, 0.1, 3)),
                POINTING,
            )
            target.orientation[0] = quaternion_product(target.orientation[0], orientation)
            motion = motion.line(target, 10).hold(20)
        motion = motion.line(goal, 20).line(start, 120).hold(20)
        runs.append(HardRun(title, hand, tree, motion, mesh=thing.mesh))
    return runs


WEDGE_ANGLE = 0.2
"""Half the angle between the walls of the wedge [rad]: a finger pushed in touches both, and nearly opposed."""


def _wedge() -> SphereTree:
    points = plate(0.08, 0.08, 3e-3, 0.0) + [0.0, 0.04, 0.0]
    sides = []
    for sign in (-1.0, 1.0):
        cosine, sine = np.cos(WEDGE_ANGLE), sign * np.sin(WEDGE_ANGLE)
        # The walls open towards -y, from where the finger comes.
        turned = np.stack([points[:, 0], cosine * -points[:, 1], sine * points[:, 1]], axis=1)
        sides.append(turned + [0.0, 0.04, 0.0])
    return tree_of(np.concatenate(sides), 2.3e-3)


def _wedge_mesh() -> Mesh:
    wall = box_mesh(0.08, 0.08, 4.6e-3).transformed(np.eye(3), (0.0, 0.04, 0.0))
    sides = []
    for sign in (-1.0, 1.0):
        cosine, sine = np.cos(WEDGE_ANGLE), sign * np.sin(WEDGE_ANGLE)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, -cosine, -sine], [0.0, sine, -cosine]])
        sides.append(wall.transformed(turn, (0.0, 0.04, 0.0)))
    return joined_mesh(sides)


def _wedge_motion() -> HandConfiguration:
    hand = right_hand()
    upright = quaternion(np.zeros(3))
    place = tip_at(hand, np.zeros(3), upright, POINTING)
    start = still(place - [0.0, 0.1, 0.0], upright, POINTING)
    deep = still(place + [0.0, 0.06, 0.0], upright, POINTING)
    motion = start.hold(4).line(deep, 200).hold(100)
    for side in (0.03, -0.03):
        motion = motion.line(deep._replace(position=deep.position + [[0.0, 0.0, side]]), 100).hold(50)
    return motion.line(start, 200).hold(20)


def _judge_released(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    away = [np.linalg.norm(o.ticks.position[-1] - o.run.motion.position[-1]) for o in outcomes]
    return [Figure("way left after pulling the finger out", float(max(away)), 1e-6, "m")]


def _inside(seed: int) -> Sequence[HardRun]:
    hand, tree = right_hand(), usual_ball()
    tip = tip_at(hand, np.array([0.0, 0.0, BALL_RADIUS - 0.01]), quaternion(np.zeros(3)), POINTING)
    wall = tree_of(plate(0.3, 0.3, 3e-3, 0.0), 2.3e-3)
    wall_mesh, mesh = box_mesh(0.3, 0.3, 4.6e-3), usual_ball_mesh()
    runs = []
    for name, start, thing, faces in (
        ("palm in the middle", still((0.0, 0.0, 0.0), flexion=HALF), tree, mesh),
        ("fingertip 10 mm in", still(tip, flexion=POINTING), tree, mesh),
        ("ball in a closed fist", still(np.zeros(3), flexion=FIST), _fist_ball(0.02), _fist_ball_mesh(0.02)),
        ("palm in a wall", still((0.0, 0.0, 0.0), flexion=HALF), wall, wall_mesh),
    ):
        motion = start.hold(99).line(start._replace(flexion=HALF[None]), 100)
        # Whichever side the hand is on, from somewhere around the object it is pulled straight away.
        for corner in ((0.5, 0.0, 0.0), (0.0, 0.0, 0.5), (-0.5, 0.0, 0.0), (0.0, 0.0, -0.5), (0.5, 0.0, 0.0)):
            motion = motion.line(still(corner, flexion=HALF), 150)
        runs.append(HardRun(name, hand, thing, motion.hold(50), mesh=faces))
    return runs


def _judge_inside(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    gap = -np.inf
    unmarked, away = 0, 0.0
    for outcome in outcomes:
        record = outcome.ticks
        unmarked += not record.status[0] & STATUS_START_INSIDE
        held = placed_of(part_of(record, 0, 100))
        gap = max(gap, float(least_clearance(outcome.run.hand, outcome.surface, held, 1.0)[-1]))
        away = max(away, float(np.linalg.norm(record.position[-1] - outcome.run.motion.position[-1])))
    return [
        Figure("starts that are not told", unmarked, 0),
        Figure("gap to the surface while inside", gap, 1e-5, "m"),
        Figure("way left after leaving", away, 1e-9, "m"),
    ]


def _fist_middle() -> FloatArray:
    # What the four fingers curl around.
    joints = right_hand().joints(np.zeros(3), quaternion(np.zeros(3)), FIST, np.zeros(5))
    middle: FloatArray = joints[1:, 1:3].reshape(-1, 3).mean(axis=0)
    return middle


def _fist_ball(radius: float, leaves: int = 300) -> SphereTree:
    return ball(leaves, radius).transformed(np.eye(3), _fist_middle())


def _fist_ball_mesh(radius: float) -> Mesh:
    return ball_mesh(radius, 3).transformed(np.eye(3), _fist_middle())


def _fist(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 12])
    hand, tree = right_hand(), _fist_ball(0.02)
    opened = still(np.zeros(3), flexion=np.full((5, 3), 0.1))
    # The open hand comes from above, so that the ball lies in its palm.
    opened.position[0, 2] = 0.02
    above = opened._replace(position=opened.position + [[0.0, 0.0, 0.1]])
    closed = still(np.zeros(3), flexion=FIST)
    motion = above.hold(4).line(opened, 100).line(closed, 150).hold(50)
    for _ in range(20):
        target = still(random.normal(0.0, 0.03, 3), quaternion(random.normal(0.0, 0.4, 3)), FIST)
        motion = motion.line(target, 25).hold(25)
    motion = motion.line(closed, 30).line(opened, 100).line(above, 100).hold(20)
    return [HardRun("ball of 20 mm", hand, tree, motion, mesh=_fist_ball_mesh(0.02))]


def _degenerate(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    random = np.random.default_rng([seed, 13])
    motion = random_targets(hand, 1200, random)
    shell = random.normal(size=(300, 3))
    shell *= BALL_RADIUS / np.linalg.norm(shell, axis=1)[:, None]
    points = random.normal(size=(2000, 3))
    points *= BALL_RADIUS / np.linalg.norm(points, axis=1)[:, None]
    core = np.concatenate([np.zeros((1, 3)), shell])
    sizes = np.concatenate([[BALL_RADIUS], np.full(300, BALL_RADIUS / 1000.0)])
    same = np.concatenate([np.zeros((64, 3)), np.repeat([[0.0, 0.0, 0.03]], 64, axis=0)])
    poke = tip_at(hand, np.zeros(3), quaternion(np.zeros(3)), POINTING)
    front = still(poke - [0.0, 0.05, 0.0], flexion=POINTING)
    behind = still(poke + [0.0, 0.03, 0.0], flexion=POINTING)
    return [
        HardRun("64 spheres in one place", hand, tree_of(same, np.repeat([0.03, 0.02], 64)), motion),
        HardRun("spheres of no size", hand, tree_of(points, 0.0), motion),
        HardRun("radii 1,000:1", hand, tree_of(core, sizes), motion),
        HardRun("one point", hand, tree_of(np.zeros((1, 3)), 0.0), front.hold(4).line(behind, 100).hold(100)),
    ]


def _many(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    runs = []
    rest = still(np.zeros(3), flexion=0.1)
    above = rest._replace(position=np.array([[0.0, 0.0, 0.06]]))
    pressed = rest._replace(position=np.array([[0.0, 0.0, -0.004]]))
    for pairs in (500, 2000):
        tree = mould(rest, pairs, 0.3e-3, 1e-3, np.random.default_rng([seed, 14]))
        # It begins in the mould, where it touches nothing yet.
        motion = rest.hold(4).line(pressed, 60).hold(50)
        for side in ((0.004, 0.0), (0.004, 0.004), (-0.004, -0.004), (0.0, 0.0)):
            motion = motion.line(pressed._replace(position=pressed.position + [[*side, 0.0]]), 60)
        runs.append(HardRun(f"{pairs:,} pairs", hand, tree, motion.hold(60).line(above, 100)))
    return runs


def _judge_many(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = []
    for outcome in outcomes:
        still_after = frozen_decay(outcome.ticks.total[-161:-100])
        figures.append(Figure(f"ticks to rest, {outcome.run.name}", np.inf if still_after is None else still_after, 20))
    return figures


def _crowd(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    tip = tip_at(hand, np.zeros(3), quaternion(np.zeros(3)), POINTING)
    front = still(tip - [0.0, 0.05, 0.0], flexion=POINTING)
    behind = still(tip + [0.0, 0.03, 0.0], flexion=POINTING)
    crowd = tree_of(np.zeros((5000, 3)), 1e-3)
    return [HardRun("5,000 spheres in one place", hand, crowd, front.hold(4).line(behind, 100).hold(100))]


RIDGE_SPHERE = 3e-3


def _ridge(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    x = np.arange(-0.06, 0.0601, RIDGE_SPHERE)
    spheres = np.stack([x, np.zeros_like(x), np.full_like(x, -RIDGE_SPHERE)], axis=1)
    # A roof falls off to both sides: the highest spheres alone are the ridge.
    rows = [
        spheres + [0.5 * RIDGE_SPHERE * (i % 2), i * RIDGE_SPHERE, -0.8 * abs(i) * RIDGE_SPHERE] for i in range(-8, 9)
    ]
    tree = tree_of(np.concatenate(rows), RIDGE_SPHERE)
    upright = quaternion(np.zeros(3))
    place = tip_at(hand, np.array([-0.04, 0.0, 0.004]), upright, POINTING)
    above = still(place + [0.0, 0.0, 0.04], upright, POINTING)
    pressed = still(place, upright, POINTING)
    motion = above.hold(4).line(pressed, 100).hold(40)
    ticks = 600
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    sliding = HandConfiguration(*(np.repeat(values, ticks, axis=0) for values in pressed))
    # 80 mm along the ridge, and to both sides of it 20 times.
    sliding.position[:] += np.concatenate(
        [0.08 * time, 0.003 * np.sin(40.0 * np.pi * time), np.zeros_like(time)], axis=1
    )
    mesh = roof_mesh(0.12, 8.0 * RIDGE_SPHERE, 6.4 * RIDGE_SPHERE)
    return [HardRun("fingertip along it", hand, tree, sequence(motion, sliding).hold(60), mesh=mesh)]


def _judge_ridge(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    record, motion = outcomes[0].ticks, outcomes[0].run.motion
    shown = np.linalg.norm(np.diff(record.joints[144:-60, INDEX, 3], axis=0), axis=1).max()
    hand_step = np.linalg.norm(np.diff(motion.position[144:-60], axis=0), axis=1).max()
    still_after = frozen_decay(record.total[-61:])
    return [
        # Three coordinates and a lever may each add as much as the hand's own motion; a jump is far more.
        Figure("largest step of the fingertip over the hand's", float(shown / hand_step), 10.0),
        Figure("ticks to rest", np.inf if still_after is None else still_after, 20),
    ]


def _touching(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    joints = hand.joints(np.zeros(3), quaternion(np.zeros(3)), np.zeros((5, 3)), np.zeros(5))
    rest = still(np.zeros(3))
    runs = []
    for finger, name in ((2, "middle fingertip"), (INDEX, "index fingertip")):
        ahead = (joints[finger, 3] - joints[finger, 2]) / np.linalg.norm(joints[finger, 3] - joints[finger, 2])
        point = joints[finger, 3] + (hand.radius[finger, 3] + 0.01) * ahead
        motion = rest._replace(position=-0.1 * ahead[None]).hold(4).line(rest, 100).hold(300)
        runs.append(HardRun(name, hand, tree_of(point, 0.01), motion))
    floor = tree_of(plate(0.3, 0.4, 3e-3, 2e-3), 2e-3)
    low, high = 0.0, 0.3
    for _ in range(60):
        middle = 0.5 * (low + high)
        place = np.array([[0.0, 0.0, middle]])
        pose = rest._replace(position=place)
        placed = PlacedHand(hand.joints(*pose.at(0))[None], pose.position, pose.orientation)
        gap = least_clearance(hand, floor.arrays(), placed, 1.0)[0]
        low, high = (low, middle) if gap >= 0.0 else (middle, high)
    landed = rest._replace(position=np.array([[0.0, 0.0, high]]))
    motion = landed._replace(position=landed.position + [[0.0, 0.0, 0.1]]).hold(4).line(landed, 100).hold(300)
    runs.append(HardRun("hand on a floor", hand, floor, motion))
    return runs


def _judge_touching(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    moved = lagging = 0.0
    for outcome in outcomes:
        record = outcome.ticks
        moved = max(
            moved, float(np.linalg.norm(record.position[-300:] - outcome.run.motion.position[-1], axis=1).max())
        )
        lagging += int(((record.status[-280:] & (STATUS_STUCK | STATUS_LAG)) > 0).sum())
    return [
        # Contacts keep a clearance of half a micrometre.
        Figure("distance from where the user's hand just touches", moved, 2e-6, "m"),
        Figure("ticks at rest that are stuck or lag", lagging, 0),
    ]


def _limits(seed: int) -> Sequence[HardRun]:
    hand, tree = right_hand(), usual_ball()
    runs = []
    for name, flexion in (("curled beyond", hand.flexion_max + 0.5), ("stretched beyond", hand.flexion_min - 0.5)):
        above = still((0.0, -0.045, 0.12), flexion=flexion)
        pressed = still((0.0, -0.045, 0.03), flexion=flexion)
        away = above.hold(20).line(pressed, 120).hold(100)
        motion = away.line(above, 100).hold(20)
        runs.append(HardRun(f"{name}, pressed on a ball", hand, tree, motion, mesh=usual_ball_mesh()))
    return runs


def _judge_limits(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    # At both ends the hand is free: there every joint is at its limit.
    off = 0.0
    for outcome, limit in zip(outcomes, (right_hand().flexion_max, right_hand().flexion_min), strict=True):
        for tick in (10, -1):
            off = max(off, float(np.abs(outcome.ticks.flexion[tick] - limit).max()))
    return [Figure("free joint from its limit", off, 1e-9, "rad")]


def _wire(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    z = np.arange(-0.15, 0.15, 0.8e-3)
    wire = tree_of(np.stack([np.zeros_like(z), np.zeros_like(z), z], axis=1), 0.0)
    spread = np.array([0.0, 0.15, 0.0, -0.15, -0.3])
    runs = []
    for name, flexion, abduction, finger in (
        ("spread fingers", np.zeros((5, 3)), spread, 2),
        ("index finger", POINTING, np.zeros(5), INDEX),
    ):
        # The wire stands 30 mm behind the fingertip.
        middle = tip_at(hand, np.zeros(3), quaternion(np.zeros(3)), flexion, finger) + [0.0, 0.03, 0.0]
        left = still(middle - [0.1, 0.0, 0.0], flexion=flexion, abduction=abduction)
        right = still(middle + [0.1, 0.0, 0.0], flexion=flexion, abduction=abduction)
        runs.append(HardRun(name, hand, wire, left.hold(4).line(right, 40).hold(40).line(left, 40).hold(40)))
    return runs


def _abduction(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    joints = hand.joints(np.zeros(3), quaternion(np.zeros(3)), np.full((5, 3), 0.1), np.zeros(5))
    between = 0.5 * (joints[1, 2] + joints[2, 2])
    room = 0.5 * float(np.linalg.norm(joints[1, 2] - joints[2, 2])) - hand.radius[1, 2]
    ticks = 900
    motion = still(np.zeros(3), flexion=0.1, ticks=ticks)
    wave = 0.3 * np.sin(2.0 * np.pi * np.arange(ticks) / 300.0)[:, None]
    # Index and middle finger close on the ball between them and open again; the glove alone decides.
    motion.abduction[:] = np.clip(wave * [1.0, -1.0, 1.0, 1.0, 1.0], hand.abduction_min, hand.abduction_max)
    above = still((0.0, 0.0, 0.08), flexion=0.1)
    return [
        HardRun(
            "ball between two fingers",
            hand,
            tree_of(between, max(room, 0.002)),
            sequence(above.line(motion, 100), motion),
            mesh=ball_mesh(max(room, 0.002), 3).transformed(np.eye(3), between),
        )
    ]


CONTACT_CASES = (
    HardCase(
        "narrow-handle", "a finger in a handle 1 mm wider than itself, shaken and pulled out", _handle, _judge_handle
    ),
    HardCase(
        "opposed-surfaces",
        "a finger in a wedge, between the bunny's ears, in the cup's handle",
        _opposed,
        _judge_released,
    ),
    HardCase("start-inside", "a hand that begins inside the object, and leaves it", _inside, _judge_inside),
    HardCase("object-in-fist", "a ball inside the closed fist, which is pulled away", _fist, _judge_released),
    HardCase("degenerate-spheres", "coincident spheres, spheres of no size, radii 1,000:1, one point", _degenerate),
    HardCase("many-pairs", "a flat hand on a plate: 500 and 2,000 candidate pairs", _many, _judge_many),
    HardCase("too-many-pairs", "more pairs than the arrays hold: a clear refusal", _crowd, may_refuse=True),
    HardCase("ridge", "a fingertip along a ridge, where contacts switch all the time", _ridge, _judge_ridge),
    HardCase("touching-at-rest", "a hand that just touches, at rest", _touching, _judge_touching),
    HardCase("all-limits", "every joint commanded beyond its limit, in contact", _limits, _judge_limits),
    HardCase("wire", "a wire of no thickness at 5 m/s, between and across fingers", _wire),
    HardCase("abduction-squeeze", "two fingers close on a ball by abduction, which is not optimised", _abduction),
)
