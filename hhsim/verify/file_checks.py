"""Claims of a result file about itself: completeness, order, and the consistency of object, tree and checksums."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.tick.state import (
    STATUS_ABDUCTION_HELD,
    STATUS_CAPACITY_EXCEEDED,
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_NO_PLACE,
    STATUS_SNAP,
    STATUS_START_INSIDE,
    STATUS_STUCK,
    UNITS_CONTACT,
    UNITS_LINEARISATION,
    UNITS_NODE_TEST,
    UNITS_PAIR_TEST,
    UNITS_QP_ITERATION,
    UNITS_ROW,
)
from hhsim.mesh.mesh import LARGEST_NUMBER, require_usable_arrays
from hhsim.replay.stored_scene import part_words, stored_checksums
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.result.schema import HANDS_APART
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.script import Script
from hhsim.solver.method import never_penetrates
from hhsim.verify.claim import HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, all_true, judged
from hhsim.verify.coverage import columns_claim
from hhsim.verify.tree_checks import depth_in_spheres

SAMPLES = 10_000
"""Number of random points on the mesh, uniform by area, besides vertices and edge midpoints."""
COVER = 1e-9
"""Tolerance of a point outside all leaves [m]."""
KNOWN_STATUS = STATUS_STUCK | STATUS_LAG | STATUS_INPUT_INVALID | STATUS_ABDUCTION_HELD | STATUS_SNAP
"""Flags that any tick may have."""
LARGEST, LEAST_SQUARE = 1e6, 1e-12
"""Limits of a usable hand: sum of its absolute values [m, rad], and squared length of its quaternion."""
STAMP = 1e-9
"""Tolerance between a stamp and its tick [s]."""
BETWEEN_CLOCKS = 1e-3
"""Longest interrupt between the readings of two clocks [s]."""
DURATIONS = ("detect", "palm", "fingers", "force", "total")


def file_claims(result: Result) -> list[Claim]:
    """Judge the claims that need no geometry but the tree's."""
    return [
        *(judge(result) for judge in (_complete, _checksums, _time, _input)),
        columns_claim(result),
        *_phases(result),
        _status(result),
        _durations(result),
        *_work(result),
        *(judge(result) for judge in (_tree_order, _tree_encloses, cover)),
    ]


def spent(result: Result) -> BoolArray:
    """True for ticks that may end on the way: their work is spent, the arrays are full, or the abduction is held."""
    options, hands = result.scene["solver"], [result, *([] if result.other is None else [result.other])]
    found = np.zeros(result.ticks, bool)
    for hand in hands:
        found |= np.asarray(hand["work/linearisations"]) >= options["linearisations"]
        found |= np.asarray(hand["work/units"]) >= options["budget"]
        found |= np.asarray(hand["status"]) & (STATUS_CAPACITY_EXCEEDED | STATUS_ABDUCTION_HELD) > 0
    return found


def _status(result: Result) -> Claim:
    """Judge whether flags are due: each of them keeps its tick from other claims."""
    status, ticks = np.asarray(result["status"]), np.arange(result.ticks)
    # A hand begins inside once; it is left no place by bodies that move as they are told. Full arrays end a replay.
    may = np.where(ticks == 0, STATUS_START_INSIDE, 0) | KNOWN_STATUS
    may |= STATUS_NO_PLACE if any(body.kind == "driven" for body in result.bodies.values()) else 0
    may |= STATUS_CAPACITY_EXCEEDED if result.live is not None else 0
    wrong = status & ~may != 0
    if result.gives("work") and never_penetrates(result.scene["solver"]["method"]):
        wrong |= (status & STATUS_LAG > 0) & ~spent(result)
        # Only a program without solution holds the abduction; an unfinished tick leaves that to the next.
        rows = np.asarray(result["work/rows"])
        wrong |= (status & STATUS_ABDUCTION_HELD > 0) & (np.maximum(rows, np.append(0, rows[:-1])) == 0)
    says = "flags are due: their ticks can have them, and no tick lags before its work is spent"
    return all_true("status", says, wrong, ticks=ticks)


def follows(result: Result) -> NDArray[np.bool_]:
    """True for ticks whose row before is the tick before: not the first, nor after a session's gap; shape (T,)."""
    after = np.zeros(result.ticks, bool)
    after[1:] = True if result.live is None else np.diff(result["live/tick/record"]) == 1
    return after


def _complete(result: Result) -> Claim:
    says = "the run was not stopped: the file is complete"
    if result.complete:
        return Claim("complete", says, HOLDS, checked=result.ticks)
    if figures := sorted(result.summary):
        # The summary is written when the run has ended.
        return all_true("complete", says, [True], note=f"it is said to be stopped, and has figures: {figures[0]}, …")
    return Claim("complete", says, NOT_CLAIMED, checked=result.ticks, note="the run was stopped; its ticks are judged")


def _checksums(result: Result) -> Claim:
    found, stated = stored_checksums(result), result.scene["checksums"]
    wrong = {part_words(part): digest != stated.get(part) for part, digest in found.items()}
    names = ", ".join(what for what, differs in wrong.items() if differs)
    note = f"not those of the run: {names}" if names else ""
    return all_true("checksums", "bodies, trees and hand are those of the run", list(wrong.values()), note=note)


def _time(result: Result) -> Claim:
    ticks, time, why = np.arange(result.ticks), result["time"], "rounding of time stamps"
    if result.live is not None:
        deadline = np.asarray(result["live/tick/deadline"])
        off = np.abs(time - 1e-9 * (deadline - deadline[0]))
        return judged("time", "the time of a tick is that of its deadline", off, 1e-9, "s", why, ticks=ticks)
    period = float(result.scene["solver"]["period"])
    if "recording" in result.scene:
        # The frames of a repaired recording are those that it had: some may be lost.
        step = np.diff(time)
        off = np.append(abs(time[0]), np.where(step > 0.0, abs(np.median(step) - 1.0 / result.rate), np.inf))
        off = np.maximum(off, abs(period - 1.0 / result.rate))
        says = f"frames one after the other from 0 s on, in the median {1e3 * period:.6g} ms apart, the solver's period"
        return judged(
            "time", says, off, STAMP, "s", why, ticks=ticks, note="what lies between frames is the recording's"
        )
    off = np.maximum(np.abs(time - ticks / result.rate), abs(period - 1.0 / result.rate))
    says = f"a tick every {1e3 / result.rate:g} ms from 0 on, which is the solver's period"
    return judged("time", says, off, 1e-9, "s", why, ticks=ticks)


def usable(result: Result) -> BoolArray:
    """True for ticks whose haptic hand is finite, of plausible size, with a quaternion of some length; shape (T,)."""
    parts = [np.asarray(result[f"haptic/{name}"]) for name in ("position", "flexion", "abduction")]
    total = np.sum([np.abs(values).reshape(result.ticks, -1).sum(axis=1) for values in parts], axis=0)
    square = (np.asarray(result["haptic/orientation"]) ** 2).sum(axis=1)
    return np.asarray((total < LARGEST) & (square > LEAST_SQUARE) & (square < LARGEST))


def own_script(result: Result) -> Script | None:
    """Script of the catalogue that a replay names; None for another motion."""
    name = result.scene.get("trajectory")
    return load_script(name) if result.live is None and name in script_names() else None


def _input(result: Result) -> Claim:
    held = result["status"] & STATUS_INPUT_INVALID > 0
    numbers = np.asarray(result["input_seq"])
    wrong = np.diff(numbers, prepend=numbers[0]) < 0
    wrong[0] |= numbers[0] < 0 or (result.live is None and numbers[0] != 0)
    wrong |= held == usable(result) if result.gives("status") else ~usable(result)
    script = own_script(result)
    if script is not None:
        # A stamp within `STAMP` of a tick belongs to it.
        newest = np.floor((np.arange(result.ticks) / result.rate + STAMP) * script.rate)
        wrong |= numbers != np.minimum(newest, script.sample_count - 1)
    says = "samples are used in their order, from the first on, and those and no others are held that are no hand"
    return all_true("input", says, wrong, ticks=np.arange(result.ticks))


def _phases(result: Result) -> list[Claim]:
    wrong, after = [], -1
    for phase in result.phases:
        late = phase.last_tick >= result.ticks and result.complete
        wrong.append(phase.first_tick <= after or phase.last_tick < phase.first_tick or late)
        after = phase.last_tick
    script = own_script(result)
    says = "phases follow each other within the ticks"
    if script is None:
        claims = [all_true("phases", says, np.array(wrong, bool))]
        if not result.phases:
            return claims
        says, note = "phases begin where the motion has them", "it is no script of the catalogue; --again reads it"
        return [*claims, Claim("begin of phases", says, NOT_JUDGED, note=note)]
    ends = np.cumsum([phase.duration for phase in script.phases])
    first = np.ceil((np.append(0.0, ends[:-1]) - STAMP) * result.rate).astype(np.int64)
    own = [(phase.name, int(tick)) for phase, tick in zip(script.phases, first) if tick < result.ticks]
    wrong += [own != [(phase.name, phase.first_tick) for phase in result.phases]]
    wrong += [before.last_tick + 1 != phase.first_tick for before, phase in zip(result.phases, result.phases[1:])]
    wrong += [result.complete and after != result.ticks - 1]
    return [all_true("phases", f"{says}, as in the script", np.array(wrong, bool))]


def _durations(result: Result) -> Claim:
    detect, palm, fingers, force, total = (np.asarray(result[f"duration/{name}"], np.int64) for name in DURATIONS)
    parts = detect + palm + fingers + force
    negative = np.min([detect, palm, fingers, force, total, result["duration/total_cpu"]], axis=0)
    off = np.maximum(0, np.maximum(parts - total, -negative)) * 1e-9
    if result.gives("work"):
        cpu = 1e-9 * np.asarray(result["duration/total_cpu"], np.float64)
        threads = int(result.scene["solver"]["threads"])
        off = np.maximum(off, np.maximum(0.0, cpu - 1e-9 * threads * total - BETWEEN_CLOCKS))
    method, contact = result.scene["solver"]["method"], np.asarray(result["work/rows"]) > 0
    if result.live is not None:
        method = ""
    if method == "coupled":
        off = np.where(fingers != 0, np.inf, off)
    elif method == "progressive" and contact.any() and not fingers[contact].any():
        off = np.where(contact, np.inf, off)
    says = "the parts of a tick's time fit in the whole, as do its threads, and are those that the method has"
    why = "one clock measures all, the parts inside of the whole; of CPU time an interrupt of 1 ms; programs of the "
    why += "fingers alone are progressive's"
    return judged("durations", says, off, 0.0, "s", why, ticks=np.arange(result.ticks))


def _work(result: Result) -> list[Claim]:
    """Judge the weighted work by its parts, with bounds where a program's own counts are not stored."""
    if not never_penetrates(result.scene["solver"]["method"]):
        return []
    work = {name: np.asarray(result[f"work/{name}"], np.int64) for name in ("node_tests", "pair_tests", "units")}
    steps, rows = np.asarray(result["work/linearisations"]), np.asarray(result["work/rows"])
    least = UNITS_LINEARISATION * steps + UNITS_QP_ITERATION * np.asarray(result["work/qp_iterations"])
    least += UNITS_NODE_TEST * work["node_tests"] + UNITS_PAIR_TEST * work["pair_tests"]
    # A pair has at most two contacts: a flat phalanx has one at each end.
    found = 2 * np.asarray(result["contacts/candidates"])
    most = least + (UNITS_CONTACT * found + UNITS_ROW * rows) * steps
    # Two hands that meet look at each other besides, as often as their steps would bring together what has no row.
    most += np.iinfo(np.int64).max // 2 * bool(result.scene.get(HANDS_APART))
    # Rows of a free object's table, of the other hand and of the hand's own parts are no contacts with the object.
    own_rows = result.body.is_free or result.scene.get(HANDS_APART) or result.scene["solver"].get("self_contact", False)
    least += (UNITS_ROW if own_rows else UNITS_CONTACT + UNITS_ROW) * rows
    outside = (work["units"] < least) | (work["units"] > most)
    # A hand that gives way to parts makes more, in as many sub-steps as they take.
    outside |= (steps > int(result.scene["solver"]["linearisations"])) & (len(result.bodies) == 1)
    says = "the weighted work is that of its parts, in no more linearisations than are allowed"
    return [all_true("work", says, outside, ticks=np.arange(result.ticks))]


def _tree(body: Body) -> tuple[Any, ...]:
    return tuple(np.array(body.static[f"tree/{name}"]) for name in ("center", "radius", "level", "parent"))


def leaves(body: Body) -> tuple[FloatArray, FloatArray]:
    """Centres (L, 3) and radii (L,) of a body's leaf spheres [m], where its mesh is stored."""
    center, radius, level, _ = _tree(body)
    last = level == level.max(initial=0)
    return center[last], radius[last]


def _tree_order(result: Result) -> Claim:
    found = []
    for body in result.bodies.values():
        _, radius, level, parent = _tree(body)
        index = np.arange(len(radius))
        wrong = (parent < 0) | (parent >= index)
        wrong[0] = parent[0] != -1
        above = np.where(wrong, 0, parent)
        wrong |= (index > 0) & (level != level[above] + 1)
        wrong |= ~(radius > 0.0)
        # Breadth first: a descent relies on adjacent children.
        wrong[1:] |= parent[1:] < parent[:-1]
        found.append(wrong)
    says = "each sphere has its parent on the level above, children together"
    return all_true("tree order", says, np.concatenate(found))


def _tree_encloses(result: Result) -> Claim:
    """No leaf sticks out of a sphere above it, which a descent of a tree relies on."""
    found = []
    for body in result.bodies.values():
        center, radius, level, parent = _tree(body)
        leaf = np.flatnonzero(level == level.max(initial=0))
        out = np.zeros(len(leaf))
        above = leaf.copy()
        # At most as many steps as there are spheres, whatever levels a damaged file states.
        for _ in range(min(int(level.max(initial=0)), len(radius) - 1)):
            above = np.clip(parent[above], 0, len(radius) - 1)
            away = np.linalg.norm(center[leaf] - center[above], axis=1)
            out = np.maximum(out, away + radius[leaf] - radius[above])
        found.append(out)
    says = "every leaf lies inside of the spheres above it"
    return judged("tree encloses", says, np.concatenate(found), 1e-9, "m", "rounding of a world frame")


def cover(result: Result) -> Claim:
    """Judge whether the leaves cover the meshes: their vertices, edge midpoints and random points."""
    surfaces = [(np.array(body.vertices), np.array(body.faces), *leaves(body)) for body in result.bodies.values()]
    claim = covered("cover", "the leaf spheres cover the surfaces of all bodies", *surfaces)
    if claim.note or covers(result):
        return claim
    note = "this tree was not built to cover the mesh, or the file does not say how it was"
    return replace(claim, verdict=NOT_CLAIMED, tick=None, note=note)


def covered(name: str, says: str, *surfaces: tuple[Any, ...]) -> Claim:
    """Judge whether spheres cover meshes: `surfaces` are the arguments of `outside_spheres` of each."""
    try:
        outside = np.concatenate([outside_spheres(*surface) for surface in surfaces])
        return judged(name, says, outside, COVER, "m", "less than any figure is stated to")
    except MeshError as error:
        return judged(name, says, [np.inf], COVER, "m", "exact", note=str(error))


def outside_spheres(vertices: FloatArray, faces: IntArray, center: FloatArray, radius: FloatArray) -> FloatArray:
    """Distance [m] of a mesh's vertices, edge midpoints and random points outside spheres, 0 inside, shape (N,).

    Raises:
        MeshError: Arrays that are no mesh.
    """
    require_usable_arrays(vertices, faces, "its mesh")
    # Squares of areas would overflow.
    if np.abs(vertices).max() > LARGEST_NUMBER:
        return np.array([np.inf])
    a, b, c = vertices[faces].transpose(1, 0, 2)
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    which = rng.choice(len(faces), SAMPLES, p=area / area.sum())
    s, t = rng.random((2, SAMPLES, 1))
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    inner = a[which] + s * (b - a)[which] + t * (c - a)[which]
    points = np.concatenate([vertices[np.unique(faces)], 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a), inner])
    return np.asarray(np.maximum(-depth_in_spheres(center, radius)(points), 0.0))


def covers(result: Result) -> bool:
    """True if hhsim built the tree to cover the mesh."""
    options = result.scene.get("tree_options") or {}
    return result.scene.get("tree") is None and options.get("cover") == "outer"
