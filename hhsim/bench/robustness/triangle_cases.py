"""Hard contacts that triangles alone have: sheets, sharp edges, facets, slivers, T-junctions, loose pieces."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.acceptance import shown_points
from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.invariance_cases import SAME, to_convergence
from hhsim.bench.robustness.postures import HALF, INDEX, POINTING, crossings, tip_at
from hhsim.bench.robustness.sphere_objects import right_hand
from hhsim.bench.robustness.triangle_objects import (
    box_mesh,
    cone_mesh,
    globe_mesh,
    joined_mesh,
    loose_mesh,
    roof_mesh,
    sheet_mesh,
    strips_mesh,
    tube_mesh,
)
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import FROZEN_LIMIT, force_ripple, frozen_decay
from hhsim.motion.analytic_motion import random_targets, still

SHEET = 0.3
RIM = 0.01
"""A point that passes this far within the rim [m] has gone through the sheet and not around it."""
REST = 20
"""Ticks after which the force of a frozen input must be still, as for every replay."""
JUMP = 10.0
"""Three coordinates and a lever may each add as much as the hand's own motion; a jump is far more."""
LYING = 1e-5
"""What is this near [m] to a face lies on it."""
STEADY = FROZEN_LIMIT
"""Pressed ever more on a plane a finger is pushed back ever more, and slid on it alike: trembling is neither."""
ROUND = 0.04
"""Radius of what a fingertip slides over [m]."""
PRESSED = 0.003
"""How deep it is commanded there [m]. A finger that is pressed much harder bends sideways at every edge, whatever it
is solved by: force over radius is then more than the finger is stiff."""
SLID, SLIDING = 0.02, 400
"""How far [m], in how many ticks: 50 mm/s. At 100 mm/s the normal of a fingertip alone turns by 1.3 % in a tick."""
STEP = 0.02
SLOWEST, FASTEST = 0.7, 1.4
"""Of the tip over the user's in a tick: along a facet 1, over an edge a little more, on the way to it a little less."""
RIPPLE = 1.1
"""Over that of the optimum: facets shake a finger that slides over them, and nothing else is to."""


def _run(name: str, mesh: Mesh, motion: HandConfiguration) -> HardRun:
    return HardRun(name, right_hand(), None, motion, mesh=mesh)


def _by(pose: HandConfiguration, way: tuple[float, float, float]) -> HandConfiguration:
    return pose._replace(position=pose.position + np.array(way))


def _rest(outcome: Outcome, ticks: slice) -> Figure:
    after = frozen_decay(outcome.ticks.total[ticks])
    return Figure(f"ticks to rest, {outcome.run.name}", np.inf if after is None else after, REST)


def _released(outcomes: Sequence[Outcome]) -> Figure:
    away = [np.linalg.norm(o.ticks.position[-1] - o.run.motion.position[-1]) for o in outcomes]
    return Figure("way left after pulling the finger away", float(max(away)), 1e-6, "m")


def _poking(side: float = 1.0) -> HandConfiguration:
    # The index finger points down at the origin, or up at it for a side of -1: no other finger is in the way.
    turn = quaternion(np.array([-0.5 * np.pi * side, 0.0, 0.0]))
    return still(tip_at(right_hand(), np.zeros(3), turn, POINTING), turn, POINTING)


def _thin(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    runs = []
    for thickness, mesh in (
        ("of no thickness", sheet_mesh(SHEET, SHEET)),
        ("1 nm thick", box_mesh(SHEET, SHEET, 1e-9)),
        ("1 µm thick", box_mesh(SHEET, SHEET, 1e-6)),
    ):
        for name, side in (("from above", 1.0), ("from below", -1.0)):
            tip = _poking(side)
            start, behind = _by(tip, (0.0, 0.0, 0.05 * side)), _by(tip, (0.0, 0.0, -0.03 * side))
            motion = start.hold(4).line(behind, 100).hold(60).line(_by(behind, (0.03, 0.02, 0.0)), 100).hold(60)
            runs.append(_run(f"{thickness}, {name}", mesh, motion.line(start, 150).hold(20)))
    joints = hand.joints(np.zeros(3), quaternion(np.zeros(3)), np.full((5, 3), 0.1), np.zeros(5))
    between = 0.5 * (joints[1, 2] + joints[2, 2])
    ticks = 900
    closing = still(np.zeros(3), flexion=0.1, ticks=ticks)
    wave = 0.3 * np.sin(2.0 * np.pi * np.arange(ticks) / 300.0)[:, None]
    closing.abduction[:] = np.clip(wave * [1.0, -1.0, 1.0, 1.0, 1.0], hand.abduction_min, hand.abduction_max)
    upright = sheet_mesh(0.03, 0.03).transformed(
        np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]), between
    )
    above = still((0.0, 0.0, 0.08), flexion=0.1)
    # Index and middle finger close on the sheet between them, from both sides at once.
    return [*runs, _run("between two fingers", upright, sequence(above.line(closing.part(0, 1), 100), closing))]


def _judge_thin(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    flat = outcomes[:-1]
    through = sum(crossings(shown_points(outcome.ticks), 0.5 * SHEET - RIM) for outcome in flat)
    return [
        Figure("points of the hand that went through the sheet", through, 0),
        _released(flat),
        *(_rest(outcome, slice(264, 325)) for outcome in flat),
    ]


def _edge(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    joints = hand.joints(np.zeros(3), quaternion(np.zeros(3)), POINTING, np.zeros(5))[INDEX]
    middle = 0.5 * (joints[1] + joints[2])
    size = 0.5 * (hand.radius[INDEX, 1] + hand.radius[INDEX, 2])
    pressed = still(np.array([0.0, 0.0, size - 0.003]) - middle, flexion=POINTING)
    ticks = 600
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    wave = np.sin(2.0 * np.pi * time * [2.0, 3.0, 1.0])
    moving = HandConfiguration(*(np.repeat(values, ticks, axis=0) for values in pressed))
    # To and fro across the edge and along it, tilted and turned on it.
    moving.position[:] += wave * [0.01, 0.006, 0.001]
    moving.orientation[:] = quaternion(wave[:, ::-1] * [0.1, 0.1, 0.3])
    motion = sequence(_by(pressed, (0.0, 0.0, 0.04)).hold(4).line(pressed, 100).hold(60), moving)
    motion = motion.line(pressed, 40).hold(60).line(_by(pressed, (0.0, 0.0, 0.04)), 100).hold(20)
    blade = sheet_mesh(0.2, 0.05).transformed(
        np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), (0.0, 0.0, -0.025)
    )
    return [
        _run("a ridge of 90°", roof_mesh(0.2, 0.02, 0.02), motion),
        _run("a ridge of 10°", roof_mesh(0.2, 0.05 * np.tan(np.radians(5.0)), 0.05), motion),
        _run("the edge of a sheet", blade, motion),
    ]


def _judge_edge(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = [_released(outcomes)]
    for outcome in outcomes:
        while_moving = slice(164, 764)
        shown = np.linalg.norm(np.diff(shown_points(outcome.ticks)[while_moving], axis=0), axis=2).max()
        hand, motion = outcome.run.hand, outcome.run.motion.at(while_moving)
        points = np.array([hand.joints(*sample) for sample in zip(*motion, strict=True)])
        own = np.linalg.norm(np.diff(points, axis=0), axis=-1).max()
        figures.append(Figure(f"largest step of the hand over the user's, {outcome.run.name}", shown / own, JUMP))
        figures += [_rest(outcome, slice(104, 164)), _rest(outcome, slice(804, 864))]
    return figures


def _lying(seed: int) -> Sequence[HardRun]:
    hand = right_hand()
    joints = hand.joints(np.zeros(3), quaternion(np.zeros(3)), POINTING, np.zeros(5))[INDEX]
    # Turned by the taper of the last phalanx, whose underside is then parallel to the face.
    taper = np.arcsin((hand.radius[INDEX, 2] - hand.radius[INDEX, 3]) / hand.length[INDEX, 2])
    turn = quaternion(np.array([-taper, 0.0, 0.0]))
    joints = hand.joints(np.zeros(3), turn, POINTING, np.zeros(5))[INDEX]
    # It would bend through the face: pressed a little its tip touches, pressed more it lies flat, then its other end.
    bent = POINTING.copy()
    bent[INDEX, 2] += 0.1
    low, lower = (
        still(np.array([0.0, 0.0, hand.radius[INDEX, 3] - depth]) - joints[3], turn, bent) for depth in (0.005, 0.0085)
    )
    above = _by(low, (0.0, 0.0, 0.04))
    # The face begins under the last joint, in front of the other fingers.
    start = joints[2, 1] - joints[3, 1] - 1e-3
    face = sheet_mesh(0.4, 0.4).transformed(np.eye(3), (0.0, 0.2 + start, 0.0))
    motion = above.hold(4).line(low, 100).hold(60).line(lower, 300).hold(60).line(low, 300).hold(60)
    slid = _by(low, (0.02, 0.01, 0.0))
    return [_run("index finger", face, motion.line(slid, 200).hold(60).line(_by(slid, (0.0, 0.0, 0.04)), 100).hold(20))]


def _judge_lying(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    outcome = outcomes[0]
    record, hand = outcome.ticks, outcome.run.hand
    pressing, held, easing, sliding = (
        slice(first, last) for first, last in ((164, 464), (464, 524), (524, 824), (884, 1084))
    )
    ends = record.joints[164:824, INDEX, 2:4, 2] - hand.radius[INDEX, 2:4]
    size = np.linalg.norm(record.total, axis=1)
    back = max(-np.diff(size[pressing]).min(), np.diff(size[easing]).max(), 0.0) / size[held].max()
    change = np.abs(np.diff(record.total[sliding], axis=0)).max() / size[sliding].max()
    return [
        Figure(
            "ticks with both ends of the last phalanx on the face",
            int((ends < LYING).all(axis=1).sum()),
            20,
            at_least=True,
        ),
        Figure("share of the force that comes back while it is pressed and eased", float(back), STEADY),
        Figure("share by which the force changes in a tick of sliding", float(change), STEADY),
        *(_rest(outcome, slice(first, first + 60)) for first in (104, 464, 824, 1084)),
        _released(outcomes),
    ]


def _vertex(seed: int) -> Sequence[HardRun]:
    tip = _poking()
    time = np.linspace(0.0, 2.0 * np.pi, 300)[:, None]
    runs = []
    for name, height in (("apex", 0.03), ("pit", -0.03)):
        around = HandConfiguration(*(np.repeat(values, 300, axis=0) for values in tip))
        around.position[:] += 0.003 * np.concatenate([np.sin(time), 1.0 - np.cos(time), 0.0 * time], axis=1)
        above = _by(tip, (0.0, 0.0, 0.06))
        motion = sequence(above.hold(4).line(tip, 100).hold(60), around, tip.hold(60)).line(above, 100).hold(20)
        runs.append(_run(f"{name} of 100 triangles", cone_mesh(0.06, height, 100), motion))
    return runs


def _judge_vertex(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    rest = [_rest(outcome, part) for outcome in outcomes for part in (slice(104, 164), slice(465, 525))]
    return [_released(outcomes), *rest]


def _sliding(way: FloatArray) -> HandConfiguration:
    # The index finger comes down beside the top, slides straight over it, and goes away; its pad touches.
    hand = right_hand()
    turn, bent = quaternion(np.array([-0.3, 0.0, 0.0])), POINTING.copy()
    bent[INDEX] = (0.2, 0.3, 0.2)
    # Off the middle, so that no contact is symmetric.
    middle = np.array([1.3e-3 * way[1], 1.3e-3 * way[0], ROUND + hand.radius[INDEX, 3] - PRESSED])
    start, end = (still(tip_at(hand, middle + share * SLID * way, turn, bent), turn, bent) for share in (-0.5, 0.5))
    above = (0.0, 0.0, 0.03)
    motion = _by(start, above).hold(4).line(start, 100).hold(60).line(end, SLIDING).hold(60)
    return motion.line(_by(end, above), 100).hold(20)


SLIDE = slice(164, 164 + SLIDING)


def _facets(seed: int) -> Sequence[HardRun]:
    along, across = _sliding(np.array([0.0, 1.0, 0.0])), _sliding(np.array([1.0, 0.0, 0.0]))
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    runs = []
    for count in (64, 128, 256, 1024):
        tube = tube_mesh(ROUND, 0.08, count)
        runs.append(_run(f"{count} around a cylinder, along the finger", tube, along))
        runs.append(_run(f"{count} around a cylinder, across it", tube.transformed(turned, np.zeros(3)), across))
    runs += [_run(f"{count} around a ball", globe_mesh(ROUND, count), along) for count in (64, 128)]
    return [each for run in runs for each in (run, replace(run, adapt=to_convergence))]


def _judge_facets(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = [_released(outcomes)]
    for outcome, optimum in zip(outcomes[::2], outcomes[1::2], strict=True):
        name, force = outcome.run.name, outcome.ticks.total[SLIDE]
        step = np.linalg.norm(np.diff(force, axis=0), axis=1).max() / np.linalg.norm(force, axis=1).mean()
        shown = np.diff(outcome.ticks.joints[SLIDE, INDEX, 3], axis=0)
        asked = np.diff(outcome.run.motion.position[SLIDE], axis=0)
        pace = (shown * asked).sum(axis=1) / (asked * asked).sum(axis=1)
        rate = 1.0 / outcome.options.period
        ripple = force_ripple(force, rate) / force_ripple(optimum.ticks.total[SLIDE], rate)
        figures += [
            Figure(f"largest force step over the mean force, {name}", float(step), STEP),
            Figure(
                f"way of the tip over the user's, least in a tick, {name}", float(pace.min()), SLOWEST, at_least=True
            ),
            Figure(f"way of the tip over the user's, most in a tick, {name}", float(pace.max()), FASTEST),
            Figure(f"ripple over that of the optimum, {name}", ripple, RIPPLE),
            _rest(outcome, slice(SLIDE.stop, SLIDE.stop + 60)),
        ]
    return figures


def _on_floor() -> HandConfiguration:
    # A fingertip pressed and slid, then the hand with all of its fingers.
    finger = _by(_poking(), (0.01, -0.02, 0.002))
    high = still((0.0, -0.05, 0.12), flexion=HALF)
    flat = still((0.0, -0.05, 0.02), flexion=HALF)
    motion = _by(finger, (0.0, 0.0, 0.06)).hold(4).line(finger, 100).hold(20).line(_by(finger, (0.02, 0.03, 0.0)), 150)
    motion = motion.hold(20).line(high, 150).line(flat, 150).hold(20).line(_by(flat, (-0.02, 0.03, 0.0)), 150)
    return motion.hold(60).line(high, 100).hold(20)


def _floor(name: str, description: str, title: str, make: Callable[[np.random.Generator], Mesh]) -> HardCase:
    def build(seed: int) -> Sequence[HardRun]:
        motion = _on_floor()
        meshes = (("two triangles", sheet_mesh(SHEET, SHEET)), (title, make(np.random.default_rng([seed, 30]))))
        return [HardRun(named, right_hand(), None, motion, to_convergence, mesh=mesh) for named, mesh in meshes]

    return HardCase(name, description, build, _judge_floor, mesh_only=True)


def _judge_floor(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    points = shown_points(outcomes[0].ticks)
    length = outcomes[0].run.hand.hand_length
    figures = [_rest(outcome, slice(764, 824)) for outcome in outcomes]
    for outcome in outcomes[1:]:
        moved = np.linalg.norm(shown_points(outcome.ticks) - points, axis=-1).max() / length
        figures.append(Figure(f"difference of motion to two triangles, {outcome.run.name}", float(moved), SAME))
    return figures


def _slivers(random: np.random.Generator) -> Mesh:
    rows = np.arange(-0.5 * SHEET, 0.5 * SHEET, 2e-3)
    return strips_mesh([-0.5 * SHEET, 0.5 * SHEET], [np.sort([*rows, *(rows[1:] + 0.1 / 1e6), 0.5 * SHEET])])


def _t_junctions(random: np.random.Generator) -> Mesh:
    half = 0.5 * SHEET
    columns = np.linspace(-half, half, 31)
    counts = random.integers(0, 60, 30)
    return strips_mesh(list(columns), [np.sort([-half, *random.uniform(-half, half, n), half]) for n in counts])


def _overlapping(random: np.random.Generator) -> Mesh:
    middle = random.uniform(-0.08, 0.08, (300, 1, 2))
    size = random.uniform(2e-3, 4e-2, (300, 1, 1))
    corners = np.concatenate([middle + size * random.normal(size=(300, 3, 2)) / 2.0, np.zeros((300, 3, 1))], axis=2)
    corners = corners[np.abs(corners).max(axis=(1, 2)) < 0.5 * SHEET]
    # Some of them again, and some of those the other way round.
    return joined_mesh(
        [sheet_mesh(SHEET, SHEET), loose_mesh(corners), loose_mesh(corners[:50]), loose_mesh(corners[25:75, ::-1])]
    )


def _soup(seed: int) -> Sequence[HardRun]:
    random = np.random.default_rng([seed, 31])
    middle = random.normal(0.0, 0.03, (300, 1, 3))
    corners = middle + random.uniform(2e-3, 1e-2, (300, 1, 1)) * random.normal(size=(300, 3, 3))
    # Outside of the ball that all of it lies in the hand begins.
    corners = corners[np.linalg.norm(corners, axis=2).max(axis=1) < 0.1]
    return [_run(f"{len(corners)} loose triangles", loose_mesh(corners), random_targets(right_hand(), 1800, random))]


TRIANGLE_CASES = (
    HardCase(
        "thin-sheet",
        "sheets of no thickness, of 1 nm and 1 µm: from above, from below, between two fingers",
        _thin,
        _judge_thin,
        mesh_only=True,
    ),
    HardCase(
        "sharp-edge",
        "a ridge of 90°, of 10° and the edge of a sheet across a phalanx",
        _edge,
        _judge_edge,
        mesh_only=True,
    ),
    HardCase("flat-finger", "a finger that lies on a large face, and slides", _lying, _judge_lying, mesh_only=True),
    HardCase(
        "many-at-a-vertex",
        "a fingertip on the vertex of 100 triangles, and in it",
        _vertex,
        _judge_vertex,
        mesh_only=True,
    ),
    HardCase(
        "facets",
        "a fingertip slides over cylinders and balls of 64 to 1,024 facets: no step, no stop, little ripple",
        _facets,
        _judge_facets,
        mesh_only=True,
    ),
    _floor("slivers", "a floor with triangles 1,000,000 times as long as wide: as on two", "slivers", _slivers),
    _floor("t-junctions", "a floor whose triangles share no vertices: as on two", "T-junctions", _t_junctions),
    _floor("overlaps", "a floor of triangles that overlap in its plane: as on two", "overlaps", _overlapping),
    HardCase("triangle-soup", "random targets among loose triangles that cut each other", _soup, mesh_only=True),
)
