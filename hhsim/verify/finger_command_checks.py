"""Claims of the commands to a session's fingers: free for every reason, and within the limits otherwise."""

import math

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.kernels.live.interlock import FREES_BOTH
from hhsim.result.safety import Safety
from hhsim.verify.claim import Claim, all_true, judged
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, HANDED_OVER, INPUT_INVALID, QUIET, SessionRows

ROUNDING = 1e-9
"""Tolerance of commands; a glove has a few thousand steps."""
WHY_ROUNDING = "rounding; a glove has a few thousand steps"


def command_claims(rows: SessionRows) -> list[Claim]:
    """Judge reasons, free fingers, stiffness and set points."""
    return [_reasons(rows), _free(rows), _stiffness(rows), _bounds(rows), _set_points(rows)]


def _reasons(rows: SessionRows) -> Claim:
    result, bits = rows.result, rows.safety
    status = np.asarray(result["status"])
    safety = rows.limits["safety"]
    wrong: dict[str, BoolArray] = {
        "unknown": (bits < 0) | (bits >= 2 * max(Safety)),
        "dry run": (bits & Safety.DRY_RUN > 0) != rows.dry_run,
        # Ticks before the first input are not in the file.
        "no input yet": bits & Safety.NO_INPUT_YET > 0,
        "not finite": (status & INPUT_INVALID > 0) & (bits & Safety.NOT_FINITE == 0),
        "solver failed": (status & CAPACITY_EXCEEDED > 0) & (bits & Safety.SOLVER_FAILED == 0),
        "overrun streak": _overrun(rows, _release_at(rows)) & (bits & Safety.OVERRUN_STREAK == 0),
        "stopping": _stopping(rows),
    }
    known = rows.used >= 0
    if known.any():
        age = rows.woke - rows.samples["time"][np.maximum(rows.used, 0)]
        wrong["stale"] = known & (age > round(1e9 * safety["stale"])) & (bits & Safety.STALE_INPUT == 0)
    clear = rows.clear
    if clear.any():
        # The newest sample that a tick took cannot be used, and so is one after that which it uses.
        after = rows.used + 1
        bad = ~np.append(rows.usable, True)[after]
        came = np.append(rows.samples["time"], np.iinfo(np.int64).max)[after]
        stated = bits & Safety.NOT_FINITE > 0
        # A tick that tells a latency took a sample: where it is not the one in use, it cannot be used.
        took = rows.follows & (rows.latency != -1) & (rows.used == np.concatenate([[-2], rows.used[:-1]]))
        handed = np.append(rows.samples["handed"], np.iinfo(np.int64).max)[after]
        missing = ~stated & bad & (took | (handed < rows.woke - HANDED_OVER))
        groundless = stated & ~(bad & (came < rows.over)) & (status & INPUT_INVALID == 0)
        wrong["not finite"] |= clear & (missing | groundless)
    if rows.dry_run or not safety["watchdog"]:
        wrong["no watchdog"] = bits & Safety.NO_WATCHDOG > 0
    wrong["other hand"] = _other_hand(rows)
    found = [f"{name} at {int(ticks.argmax()):,}" for name, ticks in wrong.items() if ticks.any()]
    says = "the reasons for free fingers are those that the stamps, the samples and the status show"
    any_ = np.any(list(wrong.values()), axis=0)
    return all_true("reasons", says, any_, ticks=rows.numbers, note=f"wrong: {', '.join(found)}" if found else "")


def _other_hand(rows: SessionRows) -> BoolArray:
    """Return True for ticks whose word of a fault of the other hand is groundless, or missing in the tick after it."""
    stated = rows.safety & Safety.OTHER_HAND > 0
    if rows.result.other is None:
        return stated
    faulty = np.asarray(rows.result.other["live/tick/safety"], np.int64) & FREES_BOTH > 0
    before, known = np.append(False, faulty[:-1]), np.append(False, rows.closed[:-1])
    # What is found while a tick is solved frees the other hand in the next one.
    return np.asarray(known & (stated & ~(faulty | before) | ~stated & before))


def _release_at(rows: SessionRows) -> int:
    """Missed periods in a row that free the fingers; a stall that is held or eased may last as long as a heartbeat."""
    safety = rows.limits["safety"]
    most = int(safety["overruns"])
    if safety["after_stall"] == "release":
        return most
    return max(most, round(1e9 * float(safety["heartbeat_stale"])) // rows.period_ns - 1)


def _eased(rows: SessionRows) -> BoolArray:
    """True for ticks after a stall that begin to ease the stiffness, where that was configured."""
    safety = rows.limits["safety"]
    if safety["after_stall"] != "ease":
        return np.zeros(len(rows.numbers), bool)
    return _streak(rows) >= int(safety["overruns"])


def _overrun(rows: SessionRows, most: int) -> BoolArray:
    """True for ticks after at least `most` missed periods in a row, or that lasted as long."""
    lasted = np.asarray(rows.result["duration/total"], np.int64) >= most * rows.period_ns
    return np.asarray((_streak(rows) >= most) | lasted)


def _streak(rows: SessionRows) -> IntArray:
    """Number of periods missed or begun late in a row before each tick, since the last gap of the file."""
    late = rows.missed + rows.at_once
    sums = np.cumsum(late)
    # What was missed before a gap, or before a tick that is not in the file, is not counted.
    calm = (late == 0) | ~np.append(False, rows.closed[:-1])
    before = np.where(late == 0, sums, sums - late)
    return np.asarray(sums - before[np.maximum.accumulate(np.where(calm, rows.numbers, 0))])


def _stopping(rows: SessionRows) -> BoolArray:
    """True for ticks wrong about stopping: only the last tick stops, and it does if the session ended in order."""
    stopping = rows.safety & Safety.STOPPING > 0
    wrong = stopping & (rows.numbers < len(stopping) - 1)
    if rows.result.complete and rows.live["ended"] in ("duration", "stopped"):
        # Unless the last tick of all is not in the file.
        wrong[-1] |= not (stopping[-1] or rows.solver_failed(rows.woke[-1:], rows.woke[-1:] + QUIET)[0])
    return np.asarray(wrong)


def _free(rows: SessionRows) -> Claim:
    free = rows.safety != 0
    pushed = np.where(free, np.abs(rows.stiffness).max(axis=1), 0.0)
    says = "with a reason for it, every finger is free"
    return judged("free fingers", says, pushed, 0.0, "1", "exact", ticks=rows.numbers)


def _stiffness(rows: SessionRows) -> Claim:
    output, period = rows.limits["output"], 1e-9 * rows.period_ns
    eases = _eased(rows)
    good = _good_ticks(rows, eases)
    ramp = max(1, math.ceil(output["ramp"] / period))
    target = np.array(output["stiffness"]) * (np.minimum(good, ramp) / ramp)[:, None]
    force = np.linalg.norm(np.asarray(rows.result["force/phalanx"]), axis=3).sum(axis=2)
    least = float(output["contact_force"])
    before = np.concatenate([np.zeros((1, 5)), rows.stiffness[:-1]])
    before[_freed_unseen(rows)] = 0.0
    # After a gap nobody knows what was allowed before it.
    most = np.where(rows.follows[:, None], before + output["stiffness_rise"] * period, np.inf)
    if rows.result["live/tick/record"][0] == 0:
        most[0] = output["stiffness_rise"] * period
    allowed = np.minimum(target, most)
    eased = _since(eases) < _since(rows.safety != 0)
    fall = np.array(output["stiffness"]) * period / float(output["ease"])
    allowed = np.where(eased[:, None], np.maximum(allowed, before - fall), allowed)
    beyond = rows.stiffness - allowed
    sure = np.isfinite(most) & ~_after_gap(rows)[:, None]
    off = np.where(sure, np.abs(beyond), np.maximum(0.0, beyond))
    # A sum in another order: a force at the limit may be on either side of it.
    bears = force >= least * (1.0 - ROUNDING)
    off = np.where(bears, off, np.abs(rows.stiffness))
    off = np.where(rows.stiffness == 0.0, 0.0, off)
    says = "a finger is free, or bears a force and is as stiff as its ramp, its rise and its setting let it be"
    return judged("stiffness", says, off.max(axis=1), ROUNDING, "1", WHY_ROUNDING, ticks=rows.numbers)


def _freed_unseen(rows: SessionRows) -> BoolArray:
    """True for ticks after one that is not in the file because its solver failed: that one freed the fingers."""
    return np.asarray(rows.follows & ~np.append(False, rows.closed[:-1]))


def _good_ticks(rows: SessionRows, eases: BoolArray) -> IntArray:
    """Number of ticks since the fingers were freed or eased, this one included; the maximum after a gap."""
    freed = rows.safety != 0
    begun = np.where(eases, rows.numbers - 1, -1)
    last = np.where(freed, rows.numbers, np.where(_freed_unseen(rows), rows.numbers - 1, -1))
    since = rows.numbers - np.maximum.accumulate(np.maximum(last, begun))
    return np.where(_after_gap(rows), np.iinfo(np.int32).max, since)


def _since(happened: BoolArray) -> IntArray:
    """Number of ticks since a flag was True; more than there are for never."""
    numbers = np.arange(len(happened))
    return numbers - np.maximum.accumulate(np.where(happened, numbers, -len(happened)))


def _after_gap(rows: SessionRows) -> BoolArray:
    """True for ticks between a gap in the records and the next freeing of the fingers: their ramp is unknown."""
    gap = ~rows.follows
    gap[0] = rows.result["live/tick/record"][0] > 0
    last_gap = np.maximum.accumulate(np.where(gap, rows.numbers, -1))
    freed = (rows.safety != 0) | _freed_unseen(rows)
    last_freed = np.maximum.accumulate(np.where(freed, rows.numbers, -1))
    return np.asarray(last_gap > last_freed)


def _bounds(rows: SessionRows) -> Claim:
    outside = np.maximum(0.0, np.maximum(-rows.bend, rows.bend - 1.0)).max(axis=1)
    stiff = np.maximum(-rows.stiffness, rows.stiffness - np.array(rows.limits["output"]["stiffness"])).max(axis=1)
    step = np.abs(np.diff(rows.bend, axis=0)).max(axis=1, initial=0.0)
    fast = np.zeros(len(outside))
    fast[1:] = np.where(rows.follows[1:], np.maximum(0.0, step - rows.bend_step), 0.0)
    off = np.max([outside, np.maximum(0.0, stiff), fast], axis=0)
    says = "bends are 0 to 1 and move no faster than their limit; no finger is stiffer than its setting"
    return judged("command bounds", says, off, ROUNDING, "1", WHY_ROUNDING, ticks=rows.numbers)


def _set_points(rows: SessionRows) -> Claim:
    says = "each finger is stopped where the shown hand is, or as near as its speed lets it be"
    bend = rows.limits["bend"]
    flexion = np.asarray(rows.result["graphic/flexion"]) - np.array(bend["offset"])
    own = np.stack([_fitted(np.array(slope), flexion[:, f]) for f, slope in enumerate(bend["slope"])], axis=1)
    own = np.clip(own, 0.0, 1.0)
    before, move = np.concatenate([own[:1], rows.bend[:-1]]), rows.bend_step
    expected = np.clip(before + np.clip(own - before, -move, move), 0.0, 1.0)
    finite = np.isfinite(own).all(axis=1)
    finite &= np.isfinite(np.asarray(rows.result["force/phalanx"]).reshape(len(own), -1)).all(axis=1)
    # A hand that is not finite moves nothing.
    expected = np.where(finite[:, None], expected, before)
    known = rows.follows.copy()
    known[0] = bool(finite[0]) and rows.result["live/tick/record"][0] == 0
    off = np.abs(rows.bend - expected).max(axis=1)[known]
    return judged("set points", says, off, ROUNDING, "1", WHY_ROUNDING, ticks=rows.numbers[known])


def _fitted(slope: FloatArray, flexion: FloatArray) -> FloatArray:
    """Bend nearest to a finger's three angles (T, 3) [rad]; 0 where a bend moves none of them."""
    if not slope.any():
        return np.zeros(len(flexion))
    return np.asarray((np.linalg.pinv(slope[:, None]) @ flexion.T)[0], np.float64)
