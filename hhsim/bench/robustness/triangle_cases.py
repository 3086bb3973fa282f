"""Hard contacts that triangles alone have: sheets, sharp edges, a large face, a vertex of many, facets."""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.robustness import objects as shapes
from hhsim.bench.robustness import postures
from hhsim.bench.robustness.case import (
    Figure,
    Figures,
    HardRun,
    Outcome,
    Runs,
    largest_step,
    named_cases,
    to_convergence,
)
from hhsim.bench.robustness.objects import right_hand
from hhsim.bench.robustness.postures import INDEX, POINTING, shifted
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.metrics import FROZEN_LIMIT, force_ripple
from hhsim.motion.analytic_motion import still

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
    return still(postures.tip_at(np.zeros(3), turn), turn, POINTING)


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
    joints = postures.joints_at_origin(np.full((5, 3), 0.1))
    upright = shapes.sheet_mesh(0.03, 0.03).transformed(shapes.ALONG_X, 0.5 * (joints[1, 2] + joints[2, 2]))
    yield HardRun("between two fingers", postures.squeeze(), mesh=upright)


def _judge_thin(outcome: Outcome) -> Figures:
    yield outcome.through("sheet", 0.5 * SHEET)
    yield outcome.left(AWAY)
    yield outcome.rest(slice(264, 325))


def sharp_edge(seed: int) -> Runs:
    """A ridge of 90°, of 10° and the edge of a sheet across a phalanx."""
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
    for name, mesh in (
        ("a ridge of 90°", shapes.roof_mesh(0.2, 0.02, 0.02)),
        ("a ridge of 10°", shapes.roof_mesh(0.2, 0.05 * np.tan(np.radians(5.0)), 0.05)),
        ("the edge of a sheet", shapes.sheet_mesh(0.2, 0.05).transformed(upright, (0.0, 0.0, -0.025))),
    ):
        yield HardRun(name, motion, mesh=mesh, judge=_judge_edge)


def _judge_edge(outcome: Outcome) -> Figures:
    moving = slice(164, 764)
    hand, motion = outcome.run.hand, outcome.run.motion.at(moving)
    own = largest_step([hand.joints(*sample) for sample in zip(*motion, strict=True)])
    shown = largest_step(outcome.points[moving])
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
        still(postures.tip_at(middle + share * SLID * direction, turn, bent), turn, bent) for share in (-0.5, 0.5)
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
    step = largest_step(force) / float(np.linalg.norm(force, axis=1).mean())
    rate = 1.0 / outcome.options.period
    ripple = force_ripple(force, rate) / force_ripple(optimum.ticks.total[SLIDE], rate)
    yield optimum.left(AWAY)
    yield Figure(f"largest force step over the mean force, {name}", step, STEP)
    yield Figure(least, float(pace.min()), SLOWEST, at_least=True)
    yield Figure(most, float(pace.max()), FASTEST)
    yield Figure(f"ripple over that of the optimum, {name}", ripple, RIPPLE)
    yield outcome.rest(slice(SLIDE.stop, SLIDE.stop + 60))


TRIANGLE_CASES = named_cases(thin_sheet, sharp_edge, flat_finger, many_at_a_vertex, facets, mesh_only=True)
