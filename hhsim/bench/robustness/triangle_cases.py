"""Hard contacts that triangles alone have: sheets, sharp edges, facets, slivers, T-junctions, loose pieces."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness import case, postures
from hhsim.bench.robustness import objects as shapes
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.invariance_cases import SAME, to_convergence
from hhsim.bench.robustness.objects import right_hand
from hhsim.bench.robustness.postures import HALF, INDEX, POINTING, RIM, shifted
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.metrics import FROZEN_LIMIT, force_ripple
from hhsim.motion.analytic_motion import random_targets, still

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


def _run(name: str, mesh: Mesh, motion: HandConfiguration) -> HardRun:
    return HardRun(name, motion, mesh=mesh)


def _released(outcomes: Sequence[Outcome]) -> Figure:
    return case.distance_left(outcomes, "distance left after pulling the finger away")


def _poking(side: float = 1.0) -> HandConfiguration:
    """Index finger that points down at the origin, or up at it for a side of -1; no other finger is in the way."""
    turn = quaternion(np.array([-0.5 * np.pi * side, 0.0, 0.0]))
    return still(postures.tip_at(np.zeros(3), turn), turn, POINTING)


def _thin(seed: int) -> Sequence[HardRun]:
    runs = []
    for thickness, mesh in (
        ("of no thickness", shapes.sheet_mesh(SHEET, SHEET)),
        ("1 nm thick", box_mesh((SHEET, SHEET, 1e-9))),
        ("1 µm thick", box_mesh((SHEET, SHEET, 1e-6))),
    ):
        for name, side in (("from above", 1.0), ("from below", -1.0)):
            tip = _poking(side)
            start, behind = shifted(tip, 0.0, 0.0, 0.05 * side), shifted(tip, 0.0, 0.0, -0.03 * side)
            motion = start.hold(4).line(behind, 100).hold(60).line(shifted(behind, 0.03, 0.02, 0.0), 100).hold(60)
            runs.append(_run(f"{thickness}, {name}", mesh, motion.line(start, 150).hold(20)))
    joints = postures.joints_at_origin(np.full((5, 3), 0.1))
    upright = shapes.sheet_mesh(0.03, 0.03).transformed(shapes.ALONG_X, 0.5 * (joints[1, 2] + joints[2, 2]))
    return [*runs, _run("between two fingers", upright, postures.squeeze())]


def _judge_thin(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    flat = outcomes[:-1]
    through = sum(postures.crossings(case.shown_points(outcome.ticks), 0.5 * SHEET - RIM) for outcome in flat)
    return [
        Figure("points of the hand that went through the sheet", through, 0),
        _released(flat),
        *(case.rest_of_run(outcome, slice(264, 325)) for outcome in flat),
    ]


def _edge(seed: int) -> Sequence[HardRun]:
    radius, joints = right_hand().radius[INDEX], postures.joints_at_origin(POINTING)[INDEX]
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
    return [
        _run("a ridge of 90°", shapes.roof_mesh(0.2, 0.02, 0.02), motion),
        _run("a ridge of 10°", shapes.roof_mesh(0.2, 0.05 * np.tan(np.radians(5.0)), 0.05), motion),
        _run("the edge of a sheet", shapes.sheet_mesh(0.2, 0.05).transformed(upright, (0.0, 0.0, -0.025)), motion),
    ]


def _judge_edge(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures, moving = [_released(outcomes)], slice(164, 764)
    for outcome in outcomes:
        hand, motion = outcome.run.hand, outcome.run.motion.at(moving)
        own = case.largest_step([hand.joints(*sample) for sample in zip(*motion, strict=True)])
        shown = case.largest_step(case.shown_points(outcome.ticks)[moving])
        figures.append(Figure(f"largest step of the hand over the user's, {outcome.run.name}", shown / own, JUMP))
        figures += [case.rest_of_run(outcome, slice(104, 164)), case.rest_of_run(outcome, slice(804, 864))]
    return figures


def _lying(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    # Turned by the taper of the last phalanx, whose underside is then parallel to the face.
    taper = np.arcsin((hand.radius[INDEX, 2] - hand.radius[INDEX, 3]) / hand.length[INDEX, 2])
    turn = quaternion(np.array([-taper, 0.0, 0.0]))
    joints = postures.joints_at_origin(POINTING, turn)[INDEX]
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
    return [_run("index finger", face, motion.line(shifted(low, 0.02, 0.01, 0.04), 100).hold(20))]


def _judge_lying(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    outcome = outcomes[0]
    record, hand = outcome.ticks, outcome.run.hand
    pressing, held, easing, sliding = slice(164, 464), slice(464, 524), slice(524, 824), slice(884, 1084)
    ends = record.joints[164:824, INDEX, 2:4, 2] - hand.radius[INDEX, 2:4]
    lying = int((ends < LYING).all(axis=1).sum())
    size = np.linalg.norm(record.total, axis=1)
    back = max(-np.diff(size[pressing]).min(), np.diff(size[easing]).max(), 0.0) / size[held].max()
    change = np.abs(np.diff(record.total[sliding], axis=0)).max() / size[sliding].max()
    return [
        Figure("ticks with both ends of the last phalanx on the face", lying, 20, at_least=True),
        Figure("share of the force that comes back while it is pressed and eased", float(back), STEADY),
        Figure("share by which the force changes in a tick of sliding", float(change), STEADY),
        *(case.rest_of_run(outcome, slice(first, first + 60)) for first in (104, 464, 824, 1084)),
        _released(outcomes),
    ]


def _vertex(seed: int) -> Sequence[HardRun]:
    tip = _poking()
    time = np.linspace(0.0, 2.0 * np.pi, 300)[:, None]
    around = tip.hold(299)
    around.position[:] += 0.003 * np.concatenate([np.sin(time), 1.0 - np.cos(time), 0.0 * time], axis=1)
    above = shifted(tip, 0.0, 0.0, 0.06)
    motion = sequence(above.hold(4).line(tip, 100).hold(60), around, tip.hold(60)).line(above, 100).hold(20)
    return [
        _run(f"{name} of 100 triangles", shapes.cone_mesh(0.06, height, 100), motion)
        for name, height in (("apex", 0.03), ("pit", -0.03))
    ]


def _judge_vertex(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    rest = [case.rest_of_run(outcome, part) for outcome in outcomes for part in (slice(104, 164), slice(465, 525))]
    return [_released(outcomes), *rest]


def _sliding(direction: FloatArray) -> HandConfiguration:
    """Index finger that comes down beside the top, slides straight over it, and leaves; its pad touches."""
    turn, bent = quaternion(np.array([-0.3, 0.0, 0.0])), POINTING.copy()
    bent[INDEX] = (0.2, 0.3, 0.2)
    # Off the middle, so that no contact is symmetric.
    height = ROUND + right_hand().radius[INDEX, 3] - PRESSED
    middle = np.array([1.3e-3 * direction[1], 1.3e-3 * direction[0], height])
    start, end = (
        still(postures.tip_at(middle + share * SLID * direction, turn, bent), turn, bent) for share in (-0.5, 0.5)
    )
    motion = shifted(start, 0.0, 0.0, 0.03).hold(4).line(start, 100).hold(60).line(end, SLIDING).hold(60)
    return motion.line(shifted(end, 0.0, 0.0, 0.03), 100).hold(20)


def _facets(seed: int) -> Sequence[HardRun]:
    along, across = _sliding(np.array([0.0, 1.0, 0.0])), _sliding(np.array([1.0, 0.0, 0.0]))
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    runs = []
    for count in (64, 128, 256, 1024):
        tube = shapes.tube_mesh(ROUND, 0.08, count)
        runs.append(_run(f"{count} around a cylinder, along the finger", tube, along))
        runs.append(_run(f"{count} around a cylinder, across it", tube.transformed(turned, np.zeros(3)), across))
    runs += [_run(f"{count} around a ball", shapes.globe_mesh(ROUND, count), along) for count in (64, 128)]
    return [each for run in runs for each in (run, replace(run, adapt=to_convergence))]


def _judge_facets(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = [_released(outcomes)]
    for outcome, optimum in zip(outcomes[::2], outcomes[1::2], strict=True):
        name, force = outcome.run.name, outcome.ticks.total[SLIDE]
        shown = np.diff(outcome.ticks.joints[SLIDE, INDEX, 3], axis=0)
        wanted = np.diff(outcome.run.motion.position[SLIDE], axis=0)
        pace = (shown * wanted).sum(axis=1) / (wanted * wanted).sum(axis=1)
        least, most = (f"way of the tip over the user's, {which} in a tick, {name}" for which in ("least", "most"))
        step = case.largest_step(force) / float(np.linalg.norm(force, axis=1).mean())
        rate = 1.0 / outcome.options.period
        ripple = force_ripple(force, rate) / force_ripple(optimum.ticks.total[SLIDE], rate)
        figures += [
            Figure(f"largest force step over the mean force, {name}", step, STEP),
            Figure(least, float(pace.min()), SLOWEST, at_least=True),
            Figure(most, float(pace.max()), FASTEST),
            Figure(f"ripple over that of the optimum, {name}", ripple, RIPPLE),
            case.rest_of_run(outcome, slice(SLIDE.stop, SLIDE.stop + 60)),
        ]
    return figures


def _on_floor() -> HandConfiguration:
    """A fingertip pressed and slid, then the hand with all of its fingers."""
    finger = shifted(_poking(), 0.01, -0.02, 0.002)
    high, flat = (still((0.0, -0.05, height), flexion=HALF) for height in (0.12, 0.02))
    motion = shifted(finger, 0.0, 0.0, 0.06).hold(4).line(finger, 100).hold(20)
    motion = motion.line(shifted(finger, 0.02, 0.03, 0.0), 150).hold(20).line(high, 150).line(flat, 150).hold(20)
    return motion.line(shifted(flat, -0.02, 0.03, 0.0), 150).hold(60).line(high, 100).hold(20)


def _floor(name: str, description: str, title: str, make: Callable[[np.random.Generator], Mesh]) -> HardCase:
    def build(seed: int) -> Sequence[HardRun]:
        motion = _on_floor()
        meshes = (("two triangles", shapes.sheet_mesh(SHEET, SHEET)), (title, make(np.random.default_rng([seed, 30]))))
        return [HardRun(named, motion, mesh=mesh, adapt=to_convergence) for named, mesh in meshes]

    return HardCase(name, f"a floor {description}: as on two", build, _judge_floor)


def _judge_floor(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    plain, other = outcomes
    moved = case.motion_difference(other.ticks, plain.ticks) / plain.run.hand.hand_length
    rest = [case.rest_of_run(outcome, slice(764, 824)) for outcome in outcomes]
    return [*rest, Figure(f"difference of motion to two triangles, {other.run.name}", moved, SAME)]


def _slivers(random: np.random.Generator) -> Mesh:
    rows = np.arange(-0.5 * SHEET, 0.5 * SHEET, 2e-3)
    return shapes.strips_mesh([-0.5 * SHEET, 0.5 * SHEET], [np.sort([*rows, *(rows[1:] + 0.1 / 1e6), 0.5 * SHEET])])


def _t_junctions(random: np.random.Generator) -> Mesh:
    half = 0.5 * SHEET
    columns = np.linspace(-half, half, 31)
    counts = random.integers(0, 60, 30)
    return shapes.strips_mesh(list(columns), [np.sort([-half, *random.uniform(-half, half, n), half]) for n in counts])


def _overlapping(random: np.random.Generator) -> Mesh:
    middle = random.uniform(-0.08, 0.08, (300, 1, 2))
    size = random.uniform(2e-3, 4e-2, (300, 1, 1))
    corners = np.concatenate([middle + size * random.normal(size=(300, 3, 2)) / 2.0, np.zeros((300, 3, 1))], axis=2)
    corners = corners[np.abs(corners).max(axis=(1, 2)) < 0.5 * SHEET]
    # Some of them again, and some of those wound the other way.
    loose = [shapes.loose_mesh(part) for part in (corners, corners[:50], corners[25:75, ::-1])]
    return shapes.joined_mesh([shapes.sheet_mesh(SHEET, SHEET), *loose])


def _soup(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 31])
    middle = random.normal(0.0, 0.03, (300, 1, 3))
    corners = middle + random.uniform(2e-3, 1e-2, (300, 1, 1)) * random.normal(size=(300, 3, 3))
    # The hand begins outside of the ball that holds all of it.
    corners = corners[np.linalg.norm(corners, axis=2).max(axis=1) < 0.1]
    return [
        _run(f"{len(corners)} loose triangles", shapes.loose_mesh(corners), random_targets(right_hand(), 1800, random))
    ]


_CASES = (
    HardCase(
        "thin-sheet",
        "sheets of no thickness, of 1 nm and 1 µm: from above, from below, between two fingers",
        _thin,
        _judge_thin,
    ),
    HardCase("sharp-edge", "a ridge of 90°, of 10° and the edge of a sheet across a phalanx", _edge, _judge_edge),
    HardCase("flat-finger", "a finger that lies on a large face, and slides", _lying, _judge_lying),
    HardCase("many-at-a-vertex", "a fingertip on the vertex of 100 triangles, and in it", _vertex, _judge_vertex),
    HardCase(
        "facets",
        "a fingertip slides over cylinders and balls of 64 to 1,024 facets: no step, no stop, little ripple",
        _facets,
        _judge_facets,
    ),
    _floor("slivers", "with triangles 1,000,000 times as long as wide", "slivers", _slivers),
    _floor("t-junctions", "whose triangles share no vertices", "T-junctions", _t_junctions),
    _floor("overlaps", "of triangles that overlap in its plane", "overlaps", _overlapping),
    HardCase("triangle-soup", "random targets among loose triangles that cut each other", _soup),
)
TRIANGLE_CASES = tuple(replace(hard, mesh_only=True) for hard in _CASES)
