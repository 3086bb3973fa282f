"""Hard contacts: narrow, opposed, many, degenerate ones, and hands that begin inside the object.

At the end those that triangles alone have: sheets, sharp edges, a large face, a vertex of many, facets.
"""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.figures import hand_clearance
from hhsim.bench.robustness import objects as shapes
from hhsim.bench.robustness.case import Figure, Figures, HardRun, Outcome, Runs, ball_run, named_cases, to_convergence
from hhsim.bench.robustness.objects import FIST, HALF, INDEX, POINTING, right_hand, shifted
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.metrics import FROZEN_LIMIT, force_ripple
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


def narrow_handle(seed: int) -> Runs:
    """A finger in a handle 1 mm wider than itself, shaken and pulled out."""
    random = np.random.default_rng([seed, 10])
    radius, joints = shapes.right_hand().radius[INDEX], shapes.joints_at_origin(POINTING)[INDEX]
    center, axis = 0.5 * (joints[1] + joints[2]), (joints[2] - joints[1]) / np.linalg.norm(joints[2] - joints[1])
    inner = float(0.5 * (radius[1] + radius[2]) + 0.5 * HANDLE_CLEARANCE)
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

    def judge(outcome: Outcome) -> Figures:
        within = shapes.threaded(outcome.ticks.joints[:, INDEX], center, axis, inner + HANDLE_PROFILE)
        yield Figure("ticks of shaking with the finger through the ring's side", int((~within[125:725]).sum()), 0)
        yield outcome.left("pulling it out")

    yield HardRun("ring", motion, shapes.ring(*place), shapes.ring_mesh(*place), judge)


def opposed_surfaces(seed: int) -> Runs:
    """A finger in a wedge, between the bunny's ears, in the cup's handle."""
    random = np.random.default_rng([seed, 11])
    tip = still(shapes.tip_at(np.zeros(3)), flexion=POINTING)
    start, deep = shifted(tip, 0.0, -0.1, 0.0), shifted(tip, 0.0, 0.06, 0.0)
    motion = start.hold(4).line(deep, 200).hold(100)
    for side in (0.03, -0.03):
        motion = motion.line(shifted(deep, 0.0, 0.0, side), 100).hold(50)
    yield HardRun("wedge", motion.line(start, 200).hold(20), *_wedge(), _released)
    down = quaternion(np.array([-0.5 * np.pi, 0.0, 0.0]))
    # A fingertip fits between the bunny's ears, and a finger between the cup's wall and its handle, with 2 to 3 mm.
    for name, title, point, orientation, direction in (
        ("bunny", "between the bunny's ears", (-0.0324, 0.008, 0.0443), down, (0.0, 0.0, -1.0)),
        ("cup", "in the cup's handle", (0.0331, 0.012, -0.0022), np.array(UPRIGHT), (0.0, 1.0, 0.0)),
    ):
        item, along = load_object(name), np.array(direction)
        goal = still(shapes.tip_at(point, orientation), orientation, POINTING)
        start = shifted(goal, *(-0.1 * along))
        motion = start.hold(4).line(goal, 120).line(shifted(goal, *(0.02 * along)), 60).hold(20)
        for _ in range(25):
            position = goal.position[0] + random.normal(0.0, 0.01, 3)
            turn = quaternion_product(quaternion(random.normal(0.0, 0.1, 3)), orientation)
            motion = motion.line(still(position, turn, POINTING), 10).hold(20)
        motion = motion.line(goal, 20).line(start, 120).hold(20)
        tree = cached_sphere_tree(item.mesh, TreeOptions(level=item.level))
        yield HardRun(title, motion, tree, item.mesh, _released)


def _wedge() -> tuple[SphereTree, Mesh]:
    points = shapes.plate(0.08, 0.08, 3e-3, 0.0) + [0.0, 0.04, 0.0]
    wall = box_mesh((0.08, 0.08, 4.6e-3)).transformed(np.eye(3), (0.0, 0.04, 0.0))
    spheres, walls = [], []
    for sign in (-1.0, 1.0):
        cosine, sine = np.cos(WEDGE_ANGLE), sign * np.sin(WEDGE_ANGLE)
        # The walls open towards -y, from where the finger comes.
        turned = np.stack([points[:, 0], cosine * -points[:, 1], sine * points[:, 1]], axis=1)
        spheres.append(turned + [0.0, 0.04, 0.0])
        turn = np.array([[1.0, 0.0, 0.0], [0.0, -cosine, -sine], [0.0, sine, -cosine]])
        walls.append(wall.transformed(turn, (0.0, 0.04, 0.0)).triangles)
    return shapes.tree_of(np.concatenate(spheres), 2.3e-3), shapes.loose_mesh(np.concatenate(walls))


def _released(outcome: Outcome) -> Figures:
    yield outcome.left("pulling the finger out")


def start_inside(seed: int) -> Runs:
    """A hand that begins inside the object, and leaves it."""
    usual = shapes.ball(4000), shapes.ball_mesh()
    wall = shapes.tree_of(shapes.plate(0.3, 0.3, 3e-3, 0.0), 2.3e-3), box_mesh((0.3, 0.3, 4.6e-3))
    for name, start, item in (
        ("palm in the middle", still((0.0, 0.0, 0.0), flexion=HALF), usual),
        ("fingertip 10 mm in", still(shapes.tip_at((0.0, 0.0, shapes.BALL_RADIUS - 0.01)), flexion=POINTING), usual),
        ("ball in a closed fist", still(np.zeros(3), flexion=FIST), _fist_ball()),
        ("palm in a wall", still((0.0, 0.0, 0.0), flexion=HALF), wall),
    ):
        motion = start.hold(99).line(start._replace(flexion=HALF[None]), 100)
        # On whichever side the hand is, it is pulled straight away from somewhere around the object.
        for corner in ((0.5, 0.0, 0.0), (0.0, 0.0, 0.5), (-0.5, 0.0, 0.0), (0.0, 0.0, -0.5), (0.5, 0.0, 0.0)):
            motion = motion.line(still(corner, flexion=HALF), 150)
        yield HardRun(name, motion.hold(50), *item, _judge_inside)


def _judge_inside(outcome: Outcome) -> Figures:
    marked = outcome.ticks_with(STATUS_START_INSIDE, ticks=slice(1))
    yield Figure("starts inside without the status bit", 1 - marked, 0)
    yield Figure("gap to the surface while inside", outcome.gap(99), 1e-5, "m")
    yield outcome.left("leaving", 1e-9)


def _fist_ball() -> tuple[SphereTree, Mesh]:
    """A ball of 20 mm that the four fingers of a fist curl around."""
    middle = shapes.joints_at_origin(FIST)[1:, 1:3].reshape(-1, 3).mean(axis=0)
    return shapes.ball(300, 0.02).transformed(np.eye(3), middle), shapes.ball_mesh(0.02, 3).transformed(
        np.eye(3), middle
    )


def object_in_fist(seed: int) -> Runs:
    """A ball inside the closed fist, which is pulled away."""
    random = np.random.default_rng([seed, 12])
    # The open hand comes from above, so that the ball lies in its palm.
    opened = still((0.0, 0.0, 0.02), flexion=np.full((5, 3), 0.1))
    above, closed = shifted(opened, 0.0, 0.0, 0.1), still(np.zeros(3), flexion=FIST)
    motion = above.hold(4).line(opened, 100).line(closed, 150).hold(50)
    for _ in range(20):
        target = still(random.normal(0.0, 0.03, 3), quaternion(random.normal(0.0, 0.4, 3)), FIST)
        motion = motion.line(target, 25).hold(25)
    motion = motion.line(closed, 30).line(opened, 100).line(above, 100).hold(20)
    yield HardRun("ball of 20 mm", motion, *_fist_ball(), _released)


def degenerate_spheres(seed: int) -> Runs:
    """Coincident spheres, spheres of no size, radii 1,000:1, one point."""
    random = np.random.default_rng([seed, 13])
    motion = random_targets(shapes.right_hand(), 1200, random)
    shell, points = random.normal(size=(300, 3)), random.normal(size=(2000, 3))
    for directions in (shell, points):
        directions *= shapes.BALL_RADIUS / np.linalg.norm(directions, axis=1)[:, None]
    core = np.concatenate([np.zeros((1, 3)), shell])
    sizes = np.concatenate([[shapes.BALL_RADIUS], np.full(300, shapes.BALL_RADIUS / 1000.0)])
    same = np.concatenate([np.zeros((64, 3)), np.repeat([[0.0, 0.0, 0.03]], 64, axis=0)])
    yield HardRun("64 spheres in one place", motion, shapes.tree_of(same, np.repeat([0.03, 0.02], 64)))
    yield HardRun("spheres of no size", motion, shapes.tree_of(points, 0.0))
    yield HardRun("radii 1,000:1", motion, shapes.tree_of(core, sizes))
    yield HardRun("one point", shapes.poke(), shapes.tree_of(np.zeros((1, 3)), 0.0))


def many_pairs(seed: int) -> Runs:
    """A flat hand on a plate: 500 and 2,000 candidate pairs."""
    rest = still(np.zeros(3), flexion=0.1)
    pressed = shifted(rest, 0.0, 0.0, -0.004)
    for pairs in (500, 2000):
        # It begins in the mould, where it touches nothing yet.
        motion = rest.hold(4).line(pressed, 60).hold(50)
        for x, y in ((0.004, 0.0), (0.004, 0.004), (-0.004, -0.004), (0.0, 0.0)):
            motion = motion.line(shifted(pressed, x, y, 0.0), 60)
        tree = shapes.mould(rest, pairs, 0.3e-3, 1e-3, np.random.default_rng([seed, 14]))
        motion = motion.hold(60).line(shifted(rest, 0.0, 0.0, 0.06), 100)
        yield HardRun(f"{pairs:,} pairs", motion, tree, judge=lambda outcome: [outcome.rest(slice(-161, -100))])


def cast_in(seed: int) -> Runs:
    """A hand with a mould on all sides, whose fingers spread and bend."""
    rest = still(np.zeros(3), flexion=0.1)
    for gap in (1e-4, 1e-3):
        random = np.random.default_rng([seed, 15])
        motion = rest.hold(3)
        for _ in range(25):
            # Palm, joints and abduction at odds: no program of a whole step has a solution.
            flexion, abduction = 0.1 + random.normal(0.0, 0.3, (5, 3)), random.uniform(-0.4, 0.4, 5)
            target = still(random.normal(0.0, 0.003, 3), flexion=flexion, abduction=abduction)
            motion = sequence(motion, target).hold(9)
        tree = shapes.mould(rest, 2000, gap, 2e-3, random, closed=True)
        yield HardRun(
            f"{1e3 * gap:g} mm of room",
            motion.line(rest, 60).hold(60),
            tree,
            judge=lambda outcome: [
                Figure("stuck ticks", outcome.ticks_with(STATUS_STUCK), 0),
                outcome.rest(slice(-41, None)),
            ],
        )


def too_many_pairs(seed: int) -> Runs:
    """More pairs than the arrays hold: a clear refusal."""
    yield HardRun("5,000 spheres in one place", shapes.poke(), shapes.tree_of(np.zeros((5000, 3)), 1e-3))


def ridge(seed: int) -> Runs:
    """A fingertip along a ridge, where contacts switch all the time."""
    x = np.arange(-0.06, 0.0601, RIDGE_SPHERE)
    spheres = np.stack([x, np.zeros_like(x), np.full_like(x, -RIDGE_SPHERE)], axis=1)
    # A roof falls off to both sides: the highest spheres alone are the ridge.
    rows = [
        spheres + [0.5 * RIDGE_SPHERE * (i % 2), i * RIDGE_SPHERE, -0.8 * abs(i) * RIDGE_SPHERE] for i in range(-8, 9)
    ]
    pressed = still(shapes.tip_at((-0.04, 0.0, 0.004)), flexion=POINTING)
    motion = shifted(pressed, 0.0, 0.0, 0.04).hold(4).line(pressed, 100).hold(40)
    ticks = 600
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    sliding = pressed.hold(ticks - 1)
    # 80 mm along the ridge, and to both sides of it 20 times.
    sliding.position[:] += np.concatenate(
        [0.08 * time, 0.003 * np.sin(40.0 * np.pi * time), np.zeros_like(time)], axis=1
    )
    mesh = shapes.roof_mesh(0.12, 8.0 * RIDGE_SPHERE, 6.4 * RIDGE_SPHERE)
    tree = shapes.tree_of(np.concatenate(rows), RIDGE_SPHERE)
    yield HardRun("fingertip along it", sequence(motion, sliding).hold(60), tree, mesh, _judge_ridge)


def _judge_ridge(outcome: Outcome) -> Figures:
    sliding = slice(144, -60)
    shown = shapes.largest_step(outcome.ticks.joints[sliding, INDEX, 3])
    # Three coordinates and a lever may each add as much as the hand's own motion; a jump is far more.
    own = shapes.largest_step(outcome.run.motion.position[sliding])
    yield Figure("largest step of the fingertip over the hand's", shown / own, 10.0)
    yield outcome.rest(slice(-61, None), "")


def touching_at_rest(seed: int) -> Runs:
    """A hand that just touches, at rest."""
    hand = shapes.right_hand()
    joints = shapes.joints_at_origin(np.zeros((5, 3)))
    rest = still(np.zeros(3))
    for finger, name in ((2, "middle fingertip"), (INDEX, "index fingertip")):
        ahead = (joints[finger, 3] - joints[finger, 2]) / np.linalg.norm(joints[finger, 3] - joints[finger, 2])
        point = joints[finger, 3] + (hand.radius[finger, 3] + 0.01) * ahead
        motion = rest._replace(position=-0.1 * ahead[None]).hold(4).line(rest, 100).hold(300)
        yield HardRun(name, motion, shapes.tree_of(point, 0.01), judge=_judge_touching)
    floor = shapes.tree_of(shapes.plate(0.3, 0.4, 3e-3, 2e-3), 2e-3)
    low, high = 0.0, 0.3
    for _ in range(60):
        middle = 0.5 * (low + high)
        pose = shifted(rest, 0.0, 0.0, middle)
        placed = PlacedHand(hand.joints(*pose.at(0))[None], pose.position, pose.orientation)
        low, high = (low, middle) if hand_clearance(hand, floor.arrays(), placed, 1.0)[0] >= 0.0 else (middle, high)
    landed = shifted(rest, 0.0, 0.0, high)
    motion = shifted(landed, 0.0, 0.0, 0.1).hold(4).line(landed, 100).hold(300)
    yield HardRun("hand on a floor", motion, floor, judge=_judge_touching)


def _judge_touching(outcome: Outcome) -> Figures:
    moved = np.linalg.norm(outcome.ticks.position[-300:] - outcome.run.motion.position[-1], axis=1).max()
    # Contacts keep a clearance of half a micrometre.
    yield Figure("distance from where the user's hand just touches", float(moved), 2e-6, "m")
    lagging = outcome.ticks_with(STATUS_STUCK, STATUS_LAG, ticks=slice(-280, None))
    yield Figure("ticks at rest that are stuck or lag", lagging, 0)


def all_limits(seed: int) -> Runs:
    """Every joint commanded beyond its limit, in contact."""
    hand = shapes.right_hand()
    for name, limit, beyond in (("curled", hand.flexion_max, 0.5), ("stretched", hand.flexion_min, -0.5)):

        def judge(outcome: Outcome, limit: FloatArray = limit) -> Figures:
            # At both ends the hand is free: there every joint is at its limit.
            off = np.abs(outcome.ticks.flexion[[10, -1]] - limit).max()
            yield Figure("free joint from its limit", float(off), 1e-9, "rad")

        above, pressed = (still((0.0, -0.045, height), flexion=limit + beyond) for height in (0.12, 0.03))
        motion = above.hold(20).line(pressed, 120).hold(100).line(above, 100).hold(20)
        yield ball_run(f"{name} beyond, pressed on a ball", motion, judge=judge)


def wire(seed: int) -> Runs:
    """A wire of no thickness at 5 m/s, between and across fingers."""
    z = np.arange(-0.15, 0.15, 0.8e-3)
    tree = shapes.tree_of(np.stack([np.zeros_like(z), np.zeros_like(z), z], axis=1), 0.0)
    for name, flexion, abduction, finger in (
        ("spread fingers", np.zeros((5, 3)), np.array([0.0, 0.15, 0.0, -0.15, -0.3]), 2),
        ("index finger", POINTING, np.zeros(5), INDEX),
    ):
        # The wire stands 30 mm behind the fingertip.
        middle = shapes.tip_at(np.zeros(3), flexion=flexion, finger=finger) + [0.0, 0.03, 0.0]
        left, right = (still(middle + [x, 0.0, 0.0], flexion=flexion, abduction=abduction) for x in (-0.1, 0.1))
        yield HardRun(name, left.hold(4).line(right, 40).hold(40).line(left, 40).hold(40), tree)


def abduction_squeeze(seed: int) -> Runs:
    """Two fingers close on a ball by abduction, which is not optimised."""
    joints = shapes.joints_at_origin(np.full((5, 3), 0.1))
    between = 0.5 * (joints[1, 2] + joints[2, 2])
    gap = 0.5 * float(np.linalg.norm(joints[1, 2] - joints[2, 2])) - shapes.right_hand().radius[1, 2]
    radius = max(gap, 0.002)
    mesh = shapes.ball_mesh(radius, 3).transformed(np.eye(3), between)
    yield HardRun("ball between two fingers", shapes.squeeze(), shapes.tree_of(between, radius), mesh)


CONTACT_CASES = (
    *named_cases(narrow_handle, opposed_surfaces, start_inside, object_in_fist, degenerate_spheres, many_pairs),
    *named_cases(too_many_pairs, may_refuse=True),
    *named_cases(cast_in, ridge, touching_at_rest, all_limits, wire, abduction_squeeze),
)


AWAY = "pulling the finger away"
SHEET = 0.3
"""Width of sheets and floors [m]."""
JUMP = 10.0
"""Three coordinates and a lever may each add as much as the hand's own motion; a jump is far more."""
LYING = 1e-5
"""A body this near [m] to a face lies on it."""
STEADY = FROZEN_LIMIT
"""Pressed ever more on a plane a finger is pushed back ever more, and slid on it alike: trembling is neither."""
ROUND = 0.04
"""Radius of what a fingertip slides over [m]."""
PRESSED = 0.003
"""Commanded depth there [m]. A finger that is pressed much harder bends sideways at every edge, whatever it is solved
by: force over radius is then more than the finger is stiff."""
SLID, SLIDING = 0.02, 400
"""Way [m] and ticks of the slide: 50 mm/s. At 100 mm/s the normal of a fingertip alone turns by 1.3 % in a tick."""
SLIDE = slice(164, 164 + SLIDING)
"""Ticks of the slide."""
STEP = 0.02
"""Bar of the largest force step over the mean force."""
SLOWEST, FASTEST = 0.7, 1.4
"""Bars of the tip's way over the user's in a tick: along a facet 1, over an edge a little more, before it less."""
RIPPLE = 1.1
"""Bar of the force ripple over that of the optimum: facets shake a finger that slides over them, nothing else is to."""


def _poking(side: float = 1.0) -> HandConfiguration:
    """Index finger that points down at the origin, or up at it for a side of -1; no other finger is in the way."""
    turn = quaternion(np.array([-0.5 * np.pi * side, 0.0, 0.0]))
    return still(shapes.tip_at(np.zeros(3), turn), turn, POINTING)


def thin_sheet(seed: int) -> Runs:
    """Sheets of no thickness, of 1 nm and 1 µm: from above, from below, between two fingers."""
    for thickness, mesh in (
        ("of no thickness", shapes.sheet_mesh(SHEET, SHEET)),
        ("1 nm thick", box_mesh((SHEET, SHEET, 1e-9))),
        ("1 µm thick", box_mesh((SHEET, SHEET, 1e-6))),
    ):
        for name, side in (("from above", 1.0), ("from below", -1.0)):
            tip = _poking(side)
            start, behind = shifted(tip, 0.0, 0.0, 0.05 * side), shifted(tip, 0.0, 0.0, -0.03 * side)
            motion = start.hold(4).line(behind, 100).hold(60).line(shifted(behind, 0.03, 0.02, 0.0), 100).hold(60)
            motion = motion.line(start, 150).hold(20)
            yield HardRun(f"{thickness}, {name}", motion, mesh=mesh, judge=_judge_thin)
    joints = shapes.joints_at_origin(np.full((5, 3), 0.1))
    upright = shapes.sheet_mesh(0.03, 0.03).transformed(shapes.ALONG_X, 0.5 * (joints[1, 2] + joints[2, 2]))
    yield HardRun("between two fingers", shapes.squeeze(), mesh=upright)


def _judge_thin(outcome: Outcome) -> Figures:
    yield outcome.through("sheet", 0.5 * SHEET)
    yield outcome.left(AWAY)
    yield outcome.rest(slice(264, 325))


def sharp_edge(seed: int) -> Runs:
    """A ridge of 90°, of 10° and the edge of a sheet across a phalanx."""
    radius, joints = right_hand().radius[INDEX], shapes.joints_at_origin(POINTING)[INDEX]
    size = 0.5 * (radius[1] + radius[2])
    pressed = still(np.array([0.0, 0.0, size - 0.003]) - 0.5 * (joints[1] + joints[2]), flexion=POINTING)
    ticks = 600
    wave = np.sin(2.0 * np.pi * np.linspace(0.0, 1.0, ticks)[:, None] * [2.0, 3.0, 1.0])
    moving = pressed.hold(ticks - 1)
    # Back and forth across the edge and along it, tilted and turned on it.
    moving.position[:] += wave * [0.01, 0.006, 0.001]
    moving.orientation[:] = quaternion(wave[:, ::-1] * [0.1, 0.1, 0.3])
    above = shifted(pressed, 0.0, 0.0, 0.04)
    motion = sequence(above.hold(4).line(pressed, 100).hold(60), moving)
    motion = motion.line(pressed, 40).hold(60).line(above, 100).hold(20)
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    for name, mesh in (
        ("a ridge of 90°", shapes.roof_mesh(0.2, 0.02, 0.02)),
        ("a ridge of 10°", shapes.roof_mesh(0.2, 0.05 * np.tan(np.radians(5.0)), 0.05)),
        ("the edge of a sheet", shapes.sheet_mesh(0.2, 0.05).transformed(upright, (0.0, 0.0, -0.025))),
    ):
        yield HardRun(name, motion, mesh=mesh, judge=_judge_edge)


def _judge_edge(outcome: Outcome) -> Figures:
    moving = slice(164, 764)
    hand, motion = outcome.run.hand, outcome.run.motion.at(moving)
    own = shapes.largest_step([hand.joints(*sample) for sample in zip(*motion, strict=True)])
    shown = shapes.largest_step(outcome.points[moving])
    yield outcome.left(AWAY)
    yield Figure(f"largest step of the hand over the user's, {outcome.run.name}", shown / own, JUMP)
    yield outcome.rest(slice(104, 164))
    yield outcome.rest(slice(804, 864))


def flat_finger(seed: int) -> Runs:
    """A finger that lies on a large face, and slides."""
    hand = right_hand()
    # Turned by the taper of the last phalanx, whose underside is then parallel to the face.
    taper = np.arcsin((hand.radius[INDEX, 2] - hand.radius[INDEX, 3]) / hand.length[INDEX, 2])
    turn = quaternion(np.array([-taper, 0.0, 0.0]))
    joints = shapes.joints_at_origin(POINTING, turn)[INDEX]
    # It would bend through the face: pressed a little its tip touches, pressed more it lies flat, then its other end.
    bent = POINTING.copy()
    bent[INDEX, 2] += 0.1
    low, lower = (
        still(np.array([0.0, 0.0, hand.radius[INDEX, 3] - depth]) - joints[3], turn, bent) for depth in (0.005, 0.0085)
    )
    # The face begins under the last joint, in front of the other fingers.
    start = joints[2, 1] - joints[3, 1] - 1e-3
    face = shapes.sheet_mesh(0.4, 0.4).transformed(np.eye(3), (0.0, 0.2 + start, 0.0))
    motion = shifted(low, 0.0, 0.0, 0.04).hold(4)
    for goal, ticks in ((low, 100), (lower, 300), (low, 300), (shifted(low, 0.02, 0.01, 0.0), 200)):
        motion = motion.line(goal, ticks).hold(60)
    motion = motion.line(shifted(low, 0.02, 0.01, 0.04), 100).hold(20)
    yield HardRun("index finger", motion, mesh=face, judge=_judge_lying)


def _judge_lying(outcome: Outcome) -> Figures:
    record, hand = outcome.ticks, outcome.run.hand
    pressing, held, easing, sliding = slice(164, 464), slice(464, 524), slice(524, 824), slice(884, 1084)
    ends = record.joints[164:824, INDEX, 2:4, 2] - hand.radius[INDEX, 2:4]
    lying = int((ends < LYING).all(axis=1).sum())
    size = np.linalg.norm(record.total, axis=1)
    back = max(-np.diff(size[pressing]).min(), np.diff(size[easing]).max(), 0.0) / size[held].max()
    change = np.abs(np.diff(record.total[sliding], axis=0)).max() / size[sliding].max()
    yield Figure("ticks with both ends of the last phalanx on the face", lying, 20, at_least=True)
    yield Figure("share of the force that comes back while it is pressed and eased", float(back), STEADY)
    yield Figure("share by which the force changes in a tick of sliding", float(change), STEADY)
    yield from (outcome.rest(slice(first, first + 60)) for first in (104, 464, 824, 1084))
    yield outcome.left(AWAY)


def many_at_a_vertex(seed: int) -> Runs:
    """A fingertip on the vertex of 100 triangles, and in it."""
    tip = _poking()
    time = np.linspace(0.0, 2.0 * np.pi, 300)[:, None]
    around = tip.hold(299)
    around.position[:] += 0.003 * np.concatenate([np.sin(time), 1.0 - np.cos(time), 0.0 * time], axis=1)
    above = shifted(tip, 0.0, 0.0, 0.06)
    motion = sequence(above.hold(4).line(tip, 100).hold(60), around, tip.hold(60)).line(above, 100).hold(20)
    for name, height in (("apex", 0.03), ("pit", -0.03)):
        yield HardRun(
            f"{name} of 100 triangles",
            motion,
            mesh=shapes.cone_mesh(0.06, height, 100),
            judge=lambda at: [at.left(AWAY), at.rest(slice(104, 164)), at.rest(slice(465, 525))],
        )


def _sliding(direction: FloatArray) -> HandConfiguration:
    """Index finger that comes down beside the top, slides straight over it, and leaves; its pad touches."""
    turn, bent = quaternion(np.array([-0.3, 0.0, 0.0])), POINTING.copy()
    bent[INDEX] = (0.2, 0.3, 0.2)
    # Off the middle, so that no contact is symmetric.
    height = ROUND + right_hand().radius[INDEX, 3] - PRESSED
    middle = np.array([1.3e-3 * direction[1], 1.3e-3 * direction[0], height])
    start, end = (
        still(shapes.tip_at(middle + share * SLID * direction, turn, bent), turn, bent) for share in (-0.5, 0.5)
    )
    motion = shifted(start, 0.0, 0.0, 0.03).hold(4).line(start, 100).hold(60).line(end, SLIDING).hold(60)
    return motion.line(shifted(end, 0.0, 0.0, 0.03), 100).hold(20)


def facets(seed: int) -> Runs:
    """A fingertip slides over cylinders and balls of 64 to 1,024 facets: no step, no stop, little ripple."""
    along, across = _sliding(np.array([0.0, 1.0, 0.0])), _sliding(np.array([1.0, 0.0, 0.0]))
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    runs = []
    for count in (64, 128, 256, 1024):
        tube = shapes.disc_mesh(ROUND, 0.08, count).transformed(shapes.ALONG_X, np.zeros(3))
        runs.append((f"{count} around a cylinder, along the finger", along, tube))
        runs.append((f"{count} around a cylinder, across it", across, tube.transformed(turned, np.zeros(3))))
    runs += [(f"{count} around a ball", along, shapes.globe_mesh(ROUND, count)) for count in (64, 128)]
    for name, motion, mesh in runs:
        run = HardRun(name, motion, mesh=mesh, judge=lambda outcome: [outcome.left(AWAY)])
        yield run
        yield replace(run, adapt=to_convergence, judge=_judge_facets)


def _judge_facets(optimum: Outcome) -> Figures:
    outcome = optimum.before[-1]
    name, force = outcome.run.name, outcome.ticks.total[SLIDE]
    shown = np.diff(outcome.ticks.joints[SLIDE, INDEX, 3], axis=0)
    wanted = np.diff(outcome.run.motion.position[SLIDE], axis=0)
    pace = (shown * wanted).sum(axis=1) / (wanted * wanted).sum(axis=1)
    least, most = (f"way of the tip over the user's, {which} in a tick, {name}" for which in ("least", "most"))
    step = shapes.largest_step(force) / float(np.linalg.norm(force, axis=1).mean())
    rate = 1.0 / outcome.options.period
    ripple = force_ripple(force, rate) / force_ripple(optimum.ticks.total[SLIDE], rate)
    yield optimum.left(AWAY)
    yield Figure(f"largest force step over the mean force, {name}", step, STEP)
    yield Figure(least, float(pace.min()), SLOWEST, at_least=True)
    yield Figure(most, float(pace.max()), FASTEST)
    yield Figure(f"ripple over that of the optimum, {name}", ripple, RIPPLE)
    yield outcome.rest(slice(SLIDE.stop, SLIDE.stop + 60))


TRIANGLE_CASES = named_cases(thin_sheet, sharp_edge, flat_finger, many_at_a_vertex, facets, mesh_only=True)
