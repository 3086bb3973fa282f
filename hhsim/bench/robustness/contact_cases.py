"""Hard contacts: narrow, opposed, many, degenerate ones, and hands that begin inside the object."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness import case, postures
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.objects import (
    BALL_RADIUS,
    ball,
    ball_mesh,
    joined_mesh,
    mould,
    plate,
    right_hand,
    ring,
    ring_mesh,
    roof_mesh,
    tree_of,
)
from hhsim.bench.robustness.postures import FIST, HALF, INDEX, POINTING, shifted
from hhsim.bench.tick_records import hand_clearance, placed_of
from hhsim.hand.configuration import sequence
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.motion.analytic_motion import UPRIGHT, random_targets, still
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

HANDLE_CLEARANCE = 1e-3
"""Inner width of the handle over the width of the finger in it [m]."""
HANDLE_PROFILE = 3e-3
"""Radius of the handle's round profile [m]."""
WEDGE_ANGLE = 0.2
"""Half the angle between the walls of the wedge [rad]: a finger pushed in touches both, and nearly opposed."""
RIDGE_SPHERE = 3e-3
"""Radius of the ridge's spheres, and the distance between them [m]."""


def _handle_place() -> tuple[FloatArray, FloatArray, float]:
    radius, joints = right_hand().radius[INDEX], postures.joints_at_origin(POINTING)[INDEX]
    axis = (joints[2] - joints[1]) / np.linalg.norm(joints[2] - joints[1])
    inner = 0.5 * (radius[1] + radius[2]) + 0.5 * HANDLE_CLEARANCE
    return 0.5 * (joints[1] + joints[2]), axis, float(inner)


def _handle(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 10])
    center, axis, inner = _handle_place()
    inside = still(np.zeros(3), flexion=POINTING)
    outside = shifted(inside, *(-0.12 * axis))
    motion = outside.hold(4).line(inside, 115).hold(5)
    for _ in range(30):
        target = still(random.normal(0.0, 0.004, 3), quaternion(random.normal(0.0, 0.05, 3)), POINTING)
        target.flexion[0, INDEX] = random.uniform(0.0, [0.2, 0.8, 0.8])
        motion = sequence(motion, target).hold(19)
    motion = motion.line(inside, 40).line(inside._replace(position=0.03 * axis[None]), 60).hold(40)
    motion = motion.line(inside, 60).hold(20).line(outside, 120).hold(20)
    place = (center, axis, inner, HANDLE_PROFILE)
    return [HardRun("ring", motion, ring(*place), ring_mesh(*place))]


def _judge_handle(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    center, axis, inner = _handle_place()
    within = postures.threaded(outcomes[0].ticks.joints[:, INDEX], center, axis, inner + HANDLE_PROFILE)
    return [
        Figure("ticks of shaking with the finger through the ring's side", int((~within[125:725]).sum()), 0),
        case.distance_left(outcomes, "distance left after pulling it out"),
    ]


def _opposed(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 11])
    tip = still(postures.tip_at(np.zeros(3)), flexion=POINTING)
    start, deep = shifted(tip, 0.0, -0.1, 0.0), shifted(tip, 0.0, 0.06, 0.0)
    motion = start.hold(4).line(deep, 200).hold(100)
    for side in (0.03, -0.03):
        motion = motion.line(shifted(deep, 0.0, 0.0, side), 100).hold(50)
    runs = [HardRun("wedge", motion.line(start, 200).hold(20), *_wedge())]
    down = quaternion(np.array([-0.5 * np.pi, 0.0, 0.0]))
    # A fingertip fits between the bunny's ears, and a finger between the cup's wall and its handle, with 2 to 3 mm.
    for name, title, point, orientation, direction in (
        ("bunny", "between the bunny's ears", (-0.0324, 0.008, 0.0443), down, (0.0, 0.0, -1.0)),
        ("cup", "in the cup's handle", (0.0331, 0.012, -0.0022), np.array(UPRIGHT), (0.0, 1.0, 0.0)),
    ):
        item, along = load_object(name), np.array(direction)
        goal = still(postures.tip_at(point, orientation), orientation, POINTING)
        start = shifted(goal, *(-0.1 * along))
        motion = start.hold(4).line(goal, 120).line(shifted(goal, *(0.02 * along)), 60).hold(20)
        for _ in range(25):
            position = goal.position[0] + random.normal(0.0, 0.01, 3)
            turn = quaternion_product(quaternion(random.normal(0.0, 0.1, 3)), orientation)
            motion = motion.line(still(position, turn, POINTING), 10).hold(20)
        motion = motion.line(goal, 20).line(start, 120).hold(20)
        tree = cached_sphere_tree(item.mesh, TreeOptions(level=item.level))
        runs.append(HardRun(title, motion, tree, item.mesh))
    return runs


def _wedge() -> tuple[SphereTree, Mesh]:
    points = plate(0.08, 0.08, 3e-3, 0.0) + [0.0, 0.04, 0.0]
    wall = box_mesh((0.08, 0.08, 4.6e-3)).transformed(np.eye(3), (0.0, 0.04, 0.0))
    spheres, walls = [], []
    for sign in (-1.0, 1.0):
        cosine, sine = np.cos(WEDGE_ANGLE), sign * np.sin(WEDGE_ANGLE)
        # The walls open towards -y, from where the finger comes.
        turned = np.stack([points[:, 0], cosine * -points[:, 1], sine * points[:, 1]], axis=1)
        spheres.append(turned + [0.0, 0.04, 0.0])
        turn = np.array([[1.0, 0.0, 0.0], [0.0, -cosine, -sine], [0.0, sine, -cosine]])
        walls.append(wall.transformed(turn, (0.0, 0.04, 0.0)))
    return tree_of(np.concatenate(spheres), 2.3e-3), joined_mesh(walls)


def _judge_released(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    return [case.distance_left(outcomes, "distance left after pulling the finger out")]


def _inside(seed: int) -> Sequence[HardRun]:
    usual = ball(4000), ball_mesh()
    wall = tree_of(plate(0.3, 0.3, 3e-3, 0.0), 2.3e-3), box_mesh((0.3, 0.3, 4.6e-3))
    runs = []
    for name, start, item in (
        ("palm in the middle", still((0.0, 0.0, 0.0), flexion=HALF), usual),
        ("fingertip 10 mm in", still(postures.tip_at((0.0, 0.0, BALL_RADIUS - 0.01)), flexion=POINTING), usual),
        ("ball in a closed fist", still(np.zeros(3), flexion=FIST), _fist_ball()),
        ("palm in a wall", still((0.0, 0.0, 0.0), flexion=HALF), wall),
    ):
        motion = start.hold(99).line(start._replace(flexion=HALF[None]), 100)
        # On whichever side the hand is, it is pulled straight away from somewhere around the object.
        for corner in ((0.5, 0.0, 0.0), (0.0, 0.0, 0.5), (-0.5, 0.0, 0.0), (0.0, 0.0, -0.5), (0.5, 0.0, 0.0)):
            motion = motion.line(still(corner, flexion=HALF), 150)
        runs.append(HardRun(name, motion.hold(50), *item))
    return runs


def _judge_inside(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    unmarked = sum(int(not outcome.ticks.status[0] & STATUS_START_INSIDE) for outcome in outcomes)
    gaps = [
        hand_clearance(outcome.run.hand, outcome.surface, placed_of(outcome.ticks).at([99]), 1.0)[0]
        for outcome in outcomes
    ]
    return [
        Figure("starts inside without the status bit", unmarked, 0),
        Figure("gap to the surface while inside", float(np.max(gaps)), 1e-5, "m"),
        case.distance_left(outcomes, "distance left after leaving", 1e-9),
    ]


def _fist_ball() -> tuple[SphereTree, Mesh]:
    """A ball of 20 mm that the four fingers of a fist curl around."""
    middle = postures.joints_at_origin(FIST)[1:, 1:3].reshape(-1, 3).mean(axis=0)
    return ball(300, 0.02).transformed(np.eye(3), middle), ball_mesh(0.02, 3).transformed(np.eye(3), middle)


def _fist(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 12])
    # The open hand comes from above, so that the ball lies in its palm.
    opened = still((0.0, 0.0, 0.02), flexion=np.full((5, 3), 0.1))
    above, closed = shifted(opened, 0.0, 0.0, 0.1), still(np.zeros(3), flexion=FIST)
    motion = above.hold(4).line(opened, 100).line(closed, 150).hold(50)
    for _ in range(20):
        target = still(random.normal(0.0, 0.03, 3), quaternion(random.normal(0.0, 0.4, 3)), FIST)
        motion = motion.line(target, 25).hold(25)
    motion = motion.line(closed, 30).line(opened, 100).line(above, 100).hold(20)
    return [HardRun("ball of 20 mm", motion, *_fist_ball())]


def _degenerate(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 13])
    motion = random_targets(right_hand(), 1200, random)
    shell, points = random.normal(size=(300, 3)), random.normal(size=(2000, 3))
    for directions in (shell, points):
        directions *= BALL_RADIUS / np.linalg.norm(directions, axis=1)[:, None]
    core = np.concatenate([np.zeros((1, 3)), shell])
    sizes = np.concatenate([[BALL_RADIUS], np.full(300, BALL_RADIUS / 1000.0)])
    same = np.concatenate([np.zeros((64, 3)), np.repeat([[0.0, 0.0, 0.03]], 64, axis=0)])
    return [
        HardRun("64 spheres in one place", motion, tree_of(same, np.repeat([0.03, 0.02], 64))),
        HardRun("spheres of no size", motion, tree_of(points, 0.0)),
        HardRun("radii 1,000:1", motion, tree_of(core, sizes)),
        HardRun("one point", postures.poke(), tree_of(np.zeros((1, 3)), 0.0)),
    ]


def _many(seed: int) -> Sequence[HardRun]:
    runs = []
    rest = still(np.zeros(3), flexion=0.1)
    pressed = shifted(rest, 0.0, 0.0, -0.004)
    for pairs in (500, 2000):
        # It begins in the mould, where it touches nothing yet.
        motion = rest.hold(4).line(pressed, 60).hold(50)
        for x, y in ((0.004, 0.0), (0.004, 0.004), (-0.004, -0.004), (0.0, 0.0)):
            motion = motion.line(shifted(pressed, x, y, 0.0), 60)
        tree = mould(rest, pairs, 0.3e-3, 1e-3, np.random.default_rng([seed, 14]))
        runs.append(HardRun(f"{pairs:,} pairs", motion.hold(60).line(shifted(rest, 0.0, 0.0, 0.06), 100), tree))
    return runs


def _judge_many(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    return [case.rest_of_run(outcome, slice(-161, -100)) for outcome in outcomes]


def _cast_in(seed: int) -> Sequence[HardRun]:
    runs = []
    rest = still(np.zeros(3), flexion=0.1)
    for gap in (1e-4, 1e-3):
        random = np.random.default_rng([seed, 15])
        motion = rest.hold(3)
        for _ in range(25):
            # Palm, joints and abduction at odds: no program of a whole step has a solution.
            flexion, abduction = 0.1 + random.normal(0.0, 0.3, (5, 3)), random.uniform(-0.4, 0.4, 5)
            target = still(random.normal(0.0, 0.003, 3), flexion=flexion, abduction=abduction)
            motion = sequence(motion, target).hold(9)
        tree = mould(rest, 2000, gap, 2e-3, random, closed=True)
        runs.append(HardRun(f"{1e3 * gap:g} mm of room", motion.line(rest, 60).hold(60), tree))
    return runs


def _judge_cast_in(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    stuck = sum(int(((outcome.ticks.status & STATUS_STUCK) > 0).sum()) for outcome in outcomes)
    return [Figure("stuck ticks", stuck, 0), *(case.rest_of_run(outcome, slice(-41, None)) for outcome in outcomes)]


def _too_many(seed: int) -> Sequence[HardRun]:
    return [HardRun("5,000 spheres in one place", postures.poke(), tree_of(np.zeros((5000, 3)), 1e-3))]


def _ridge(seed: int) -> Sequence[HardRun]:
    x = np.arange(-0.06, 0.0601, RIDGE_SPHERE)
    spheres = np.stack([x, np.zeros_like(x), np.full_like(x, -RIDGE_SPHERE)], axis=1)
    # A roof falls off to both sides: the highest spheres alone are the ridge.
    rows = [
        spheres + [0.5 * RIDGE_SPHERE * (i % 2), i * RIDGE_SPHERE, -0.8 * abs(i) * RIDGE_SPHERE] for i in range(-8, 9)
    ]
    pressed = still(postures.tip_at((-0.04, 0.0, 0.004)), flexion=POINTING)
    motion = shifted(pressed, 0.0, 0.0, 0.04).hold(4).line(pressed, 100).hold(40)
    ticks = 600
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    sliding = pressed.hold(ticks - 1)
    # 80 mm along the ridge, and to both sides of it 20 times.
    sliding.position[:] += np.concatenate(
        [0.08 * time, 0.003 * np.sin(40.0 * np.pi * time), np.zeros_like(time)], axis=1
    )
    mesh = roof_mesh(0.12, 8.0 * RIDGE_SPHERE, 6.4 * RIDGE_SPHERE)
    tree = tree_of(np.concatenate(rows), RIDGE_SPHERE)
    return [HardRun("fingertip along it", sequence(motion, sliding).hold(60), tree, mesh)]


def _judge_ridge(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    outcome, sliding = outcomes[0], slice(144, -60)
    shown = case.largest_step(outcome.ticks.joints[sliding, INDEX, 3])
    return [
        # Three coordinates and a lever may each add as much as the hand's own motion; a jump is far more.
        Figure(
            "largest step of the fingertip over the hand's",
            shown / case.largest_step(outcome.run.motion.position[sliding]),
            10.0,
        ),
        case.rest_figure(outcome, slice(-61, None)),
    ]


def _touching(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    joints = postures.joints_at_origin(np.zeros((5, 3)))
    rest = still(np.zeros(3))
    runs = []
    for finger, name in ((2, "middle fingertip"), (INDEX, "index fingertip")):
        ahead = (joints[finger, 3] - joints[finger, 2]) / np.linalg.norm(joints[finger, 3] - joints[finger, 2])
        point = joints[finger, 3] + (hand.radius[finger, 3] + 0.01) * ahead
        motion = rest._replace(position=-0.1 * ahead[None]).hold(4).line(rest, 100).hold(300)
        runs.append(HardRun(name, motion, tree_of(point, 0.01)))
    floor = tree_of(plate(0.3, 0.4, 3e-3, 2e-3), 2e-3)
    low, high = 0.0, 0.3
    for _ in range(60):
        middle = 0.5 * (low + high)
        pose = shifted(rest, 0.0, 0.0, middle)
        placed = PlacedHand(hand.joints(*pose.at(0))[None], pose.position, pose.orientation)
        low, high = (low, middle) if hand_clearance(hand, floor.arrays(), placed, 1.0)[0] >= 0.0 else (middle, high)
    landed = shifted(rest, 0.0, 0.0, high)
    motion = shifted(landed, 0.0, 0.0, 0.1).hold(4).line(landed, 100).hold(300)
    return [*runs, HardRun("hand on a floor", motion, floor)]


def _judge_touching(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    moved = [np.linalg.norm(o.ticks.position[-300:] - o.run.motion.position[-1], axis=1).max() for o in outcomes]
    lagging = sum(int(((o.ticks.status[-280:] & (STATUS_STUCK | STATUS_LAG)) > 0).sum()) for o in outcomes)
    return [
        # Contacts keep a clearance of half a micrometre.
        Figure("distance from where the user's hand just touches", float(np.max(moved)), 2e-6, "m"),
        Figure("ticks at rest that are stuck or lag", lagging, 0),
    ]


def _limits(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    runs = []
    for name, flexion in (("curled beyond", hand.flexion_max + 0.5), ("stretched beyond", hand.flexion_min - 0.5)):
        above, pressed = (still((0.0, -0.045, height), flexion=flexion) for height in (0.12, 0.03))
        motion = above.hold(20).line(pressed, 120).hold(100).line(above, 100).hold(20)
        runs.append(case.ball_run(f"{name}, pressed on a ball", motion))
    return runs


def _judge_limits(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    # At both ends the hand is free: there every joint is at its limit.
    limits = (right_hand().flexion_max, right_hand().flexion_min)
    off = [np.abs(o.ticks.flexion[[10, -1]] - limit).max() for o, limit in zip(outcomes, limits, strict=True)]
    return [Figure("free joint from its limit", float(np.max(off)), 1e-9, "rad")]


def _wire(seed: int) -> Sequence[HardRun]:
    z = np.arange(-0.15, 0.15, 0.8e-3)
    wire = tree_of(np.stack([np.zeros_like(z), np.zeros_like(z), z], axis=1), 0.0)
    runs = []
    for name, flexion, abduction, finger in (
        ("spread fingers", np.zeros((5, 3)), np.array([0.0, 0.15, 0.0, -0.15, -0.3]), 2),
        ("index finger", POINTING, np.zeros(5), INDEX),
    ):
        # The wire stands 30 mm behind the fingertip.
        middle = postures.tip_at(np.zeros(3), flexion=flexion, finger=finger) + [0.0, 0.03, 0.0]
        left, right = (still(middle + [x, 0.0, 0.0], flexion=flexion, abduction=abduction) for x in (-0.1, 0.1))
        runs.append(HardRun(name, left.hold(4).line(right, 40).hold(40).line(left, 40).hold(40), wire))
    return runs


def _abduction(seed: int) -> Sequence[HardRun]:
    joints = postures.joints_at_origin(np.full((5, 3), 0.1))
    between = 0.5 * (joints[1, 2] + joints[2, 2])
    gap = 0.5 * float(np.linalg.norm(joints[1, 2] - joints[2, 2])) - right_hand().radius[1, 2]
    radius = max(gap, 0.002)
    mesh = ball_mesh(radius, 3).transformed(np.eye(3), between)
    return [HardRun("ball between two fingers", postures.squeeze(), tree_of(between, radius), mesh)]


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
    HardCase("too-many-pairs", "more pairs than the arrays hold: a clear refusal", _too_many, may_refuse=True),
    HardCase("cast-in", "a hand with a mould on all sides, whose fingers spread and bend", _cast_in, _judge_cast_in),
    HardCase("ridge", "a fingertip along a ridge, where contacts switch all the time", _ridge, _judge_ridge),
    HardCase("touching-at-rest", "a hand that just touches, at rest", _touching, _judge_touching),
    HardCase("all-limits", "every joint commanded beyond its limit, in contact", _limits, _judge_limits),
    HardCase("wire", "a wire of no thickness at 5 m/s, between and across fingers", _wire),
    HardCase("abduction-squeeze", "two fingers close on a ball by abduction, which is not optimised", _abduction),
)
