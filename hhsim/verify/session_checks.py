"""Claims of a recorded session: its periods, samples, reasons, commands and figures.

The loop sleeps until a tick is due, reads, solves, sends commands and sleeps again, or begins the next tick at once.
So a tick's work lies between its wake-up and the next deadline, or the next begin, and a sample belongs to the tick in
whose span its bytes were read. What was measured cannot be run again: the stamps are held against each other.
"""

import json
import math
import signal
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, FloatArray, IntArray
from hhsim.kernels.live.deadlines import EARLIEST
from hhsim.kernels.live.interlock import FREES_BOTH
from hhsim.kernels.live.phase import LARGEST_SHIFT
from hhsim.metrics.session_faults import MISSED_BY
from hhsim.result.reader import Result
from hhsim.result.safety import WORDS, Safety, free_counts
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_JUDGED, Claim, all_true, figures_apart, judged
from hhsim.verify.file_checks import follows
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, INPUT_INVALID

MOST_ANGLE = 2.0 * np.pi
"""Largest plausible joint angle [rad]: samples beyond are not used."""
MOST_READ = 64
"""Most samples taken by one tick."""
HANDED_OVER = 20_000_000
"""Longest time from the stamp of a sample's hand-over to the end of it [ns]: a driver may be stopped in between."""
QUIET = 1_000_000_000
"""Time in which the log does not repeat a line [ns]."""
LOOP_DIED = "the loop failed or was killed"
"""Reason of the end of a session whose loop was not brought to its end."""
FINGER_NAMES = ("thumb", "index finger", "middle finger", "ring finger", "little finger")
JUMPED = "jumped by"
"""Text after a finger's name in the log line on a rejected jump."""
IN_ORDER = ("duration", "stopped", "the command was killed", *(number.name for number in signal.Signals))
"""Reasons of an end by the loop itself."""
DRIVER_DIED = "the glove's driver "
"""Begin of the reason of an end by a dead driver, where the loop survived."""
BROKEN_OFF = (LOOP_DIED, "the session's supervisor died before the loop began")
"""Reasons of an end without the loop."""
COUNTERS = "frames", "samples", "rejected", "other", "malformed", "resyncs", "dropped", "commands", "commands_refused"
"""Counts of a glove's driver."""
TAKES_COMMANDS = frozenset({"POSITION_LIMIT", "STIFFNESS", "FORCE", "POWER"})
"""Capabilities of a glove that takes commands."""
AT_THE_END = 100
"""Most commands that free a glove at the begin and the end of a session."""
ROUNDING = 1e-9
"""Tolerance of commands; a glove has a few thousand steps."""
SAME = 1e-9
"""Relative tolerance of figures: the rounding of sums in another order."""
HALF_A_BIN = 1e-3
"""Relative tolerance of percentiles: half a bin of the loop's histogram, which is 0.2 % wide."""
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p999": 99.9}


def session_claims(result: Result) -> list[Claim]:
    """Judge the claims of a session; none of a replay."""
    if result.live is None:
        return []
    rows = SessionRows(result)
    claims = [judge(rows) for judge in (_periods, _causes, _latency, _samples, _reasons, _commands, _ended, _counters)]
    return [*claims, *_figures(rows)]


class SessionRows:
    """Tables of a session; arrays have shape (T,) and are as /live/tick unless a comment says otherwise."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.live: dict[str, Any] = dict(result.live or {})  # description of the session
        self.limits: dict[str, Any] = result.told("limits")  # of output and safety
        self.dry_run = bool(self.live["dry_run"])  # True if nothing was sent
        self.period_ns = round(1e9 / float(result.scene["rate"]))  # of a tick
        # Most that a bend moves in it.
        self.bend_step = float(self.limits["output"]["bend_speed"]) * 1e-9 * self.period_ns
        self.numbers = np.arange(result.ticks)
        self.follows = follows(result)  # True if the row before is the tick before
        self.period, self.deadline, self.early, self.wakeup, self.latency, self.missed, self.safety = (
            np.asarray(result[f"live/tick/{name}"], np.int64)
            for name in ("period", "deadline", "early", "wakeup", "latency", "missed", "safety")
        )
        self.at_once = np.asarray(result["live/tick/at_once"], bool)
        self.bend = np.asarray(result["live/tick/command_bend"])  # command to each finger, (T, 5)
        self.stiffness = np.asarray(result["live/tick/command_stiffness"])  # (T, 5)
        slept_over = self.wakeup // self.period_ns * self.period_ns
        self.woke = self.deadline + self.wakeup - slept_over  # wake-up of the loop, or begin of the tick [ns]
        # The span of a tick that is not in the file, because the solver failed, is unknown.
        whole = np.zeros(result.ticks, bool)
        whole[1:] = np.diff(self.period) == 1 + self.missed[1:]
        whole &= self.follows
        self.closed = np.append(whole[1:], False)  # True where the end of the tick's span is known
        # That end: the next deadline slept for, or the begin of a tick at once [ns].
        self.over = np.append(np.where(self.at_once, self.woke, self.deadline - slept_over)[1:], 0)

    @cached_property
    def samples(self) -> dict[str, AnyArray]:
        """Columns of /live/sample, by name."""
        names = ("record", "seq", "time", "handed", "good", "flexion", "abduction")
        return {name: np.asarray(self.result[f"live/sample/{name}"]) for name in names}

    @property
    def samples_whole(self) -> bool:
        """True if every sample that came should be in the file."""
        return self.result.complete and int(self.live["lost_samples"]) == 0

    @cached_property
    def usable(self) -> BoolArray:
        """True for finite, plausible samples, shape (S,)."""
        angles = np.concatenate(
            [self.samples["flexion"].reshape(-1, 15), self.samples["abduction"].reshape(-1, 5)], axis=1
        )
        # NaN compares false.
        return np.asarray((self.samples["good"] == 1) & (np.abs(angles) <= MOST_ANGLE).all(axis=1))

    @cached_property
    def used(self) -> IntArray:
        """Row of the sample that each tick used, -1 where it is not in the file, shape (T,)."""
        seq, wanted = self.samples["seq"], np.asarray(self.result["input_seq"], np.int64)
        if len(seq) == 0:
            return np.full(len(wanted), -1)
        order = np.argsort(seq, kind="stable")
        place = np.clip(np.searchsorted(seq[order], wanted), 0, len(seq) - 1)
        row = order[place]
        return np.where(seq[row] == wanted, row, -1)

    @cached_property
    def newest(self) -> IntArray:
        """Row of the last sample that was certainly there when each tick began, -1 for none, shape (T,).

        The driver hands samples over one by one: at the stamp of one, the one before is there.
        """
        handed = self.samples["handed"]
        return np.maximum(np.searchsorted(handed, self.woke - HANDED_OVER) - 1, np.searchsorted(handed, self.woke) - 2)

    @cached_property
    def clear(self) -> BoolArray:
        """True for ticks whose samples are known: a burst of more than `MOST_READ` is taken by several ticks."""
        if not self.samples_whole:
            return np.zeros(self.result.ticks, bool)
        before = np.concatenate([[-1], self.used[:-1]])
        return np.asarray(self.closed & (self.used >= 0) & (self.newest - before < MOST_READ))

    def solver_failed(self, begin: IntArray, end: IntArray) -> BoolArray:
        """True where the log tells, or may have lost, a failed solver between stamps [ns] (N,) or shortly before."""
        if int(self.live["lost_events"]) > 0:
            return np.ones(len(begin), bool)
        stamps = np.asarray(self.result["live/event/time"], np.int64)
        failed = stamps[np.array([text.startswith(WORDS[Safety.SOLVER_FAILED]) for text in self.log], bool)]
        return np.asarray(((failed > begin[:, None] - QUIET) & (failed < end[:, None])).any(axis=1))

    @cached_property
    def log(self) -> list[str]:
        """Lines of the session's log."""
        return [bytes(text).rstrip(b"\0").decode("utf-8", "replace") for text in self.result["live/event/text"]]


def _periods(rows: SessionRows) -> Claim:
    """Judge records, deadlines, early and missed ticks and wake-ups, all by the stamps."""
    wrong = {
        "records": _unrecorded(rows),
        "deadlines": _deadlines(rows),
        "early ticks": _early(rows),
        "missed periods": _missed(rows),
        "wake-ups": _wakeup(rows),
    }
    found = [f"{name} at tick {int(ticks.argmax()):,}" for name, ticks in wrong.items() if ticks.any()]
    says = "periods, deadlines and wake-ups follow each other, every period has a tick or is counted as missed, and a "
    says += "tick is early with a sample that it takes alone"
    any_ = np.any(list(wrong.values()), axis=0)
    return all_true("periods", says, any_, ticks=rows.numbers, note=f"wrong: {', '.join(found)}" if found else "")


def _unrecorded(rows: SessionRows) -> BoolArray:
    """True at all ticks where records are out of order, or missing ones are not said to be lost."""
    wrong = False
    for what, record in (("ticks", np.asarray(rows.result["live/tick/record"])), ("samples", rows.samples["record"])):
        wrong |= bool((np.diff(record, prepend=-1) < 1).any())
        missing = int(record[-1]) + 1 - len(record) if len(record) else 0
        # Where the recorder was killed, its last word may be older than its last block.
        wrong |= rows.result.complete and missing != int(rows.live[f"lost_{what}"])
    return np.full(len(rows.numbers), wrong)


def _deadlines(rows: SessionRows) -> BoolArray:
    """A tick moves the next one by a share of its period at most, towards the glove's samples."""
    ends = rows.deadline + rows.early
    periods = np.diff(rows.period, prepend=rows.period[0] - 1)
    apart = np.diff(ends, prepend=ends[0] - rows.period_ns)
    most = int(rows.period_ns * LARGEST_SHIFT) * np.maximum(1, periods - rows.missed)
    return np.asarray((periods < 1) | (np.abs(apart - rows.period_ns * periods) > most))


def _early(rows: SessionRows) -> BoolArray:
    pace = next(iter(rows.result.hands.values()))
    if pace.name != rows.result.name:
        # A second hand's ticks come with those of the first one, whose samples set the pace.
        first, of_both = SessionRows(pace), ("period", "deadline", "early", "wakeup", "missed", "at_once")
        return np.asarray(np.any([getattr(rows, name) != getattr(first, name) for name in of_both], axis=0))
    most, early = int(EARLIEST * rows.period_ns), rows.early > 0
    wrong = (rows.early < 0) | (rows.early > most)
    wrong |= early & ((rows.missed > 0) | rows.at_once | (rows.wakeup >= rows.early))
    if rows.samples_whole:
        # Samples that cannot be used make a tick due as well, but are no tick's.
        at = 1 + np.flatnonzero(early[1:] & rows.follows[1:] & (rows.used[:-1] >= 0))
        newest, due, handed = rows.used[at - 1] + 1, rows.deadline[at], rows.samples["handed"]
        last = np.searchsorted(handed, due, side="right") - 1
        there = (last >= newest) & ((handed[last] == due) | (rows.early[at] == most))
        wrong[at] |= ~there
    return np.asarray(wrong)


def _missed(rows: SessionRows) -> BoolArray:
    gone = np.diff(rows.period, prepend=-1) - 1 - rows.missed
    wrong = (rows.missed < 0) | (gone < 0)
    odd = np.flatnonzero(rows.follows & (gone > 0))
    wrong[odd] |= ~rows.solver_failed(rows.woke[odd - 1], rows.woke[odd])
    return np.asarray(wrong)


def _wakeup(rows: SessionRows) -> BoolArray:
    """A tick is done before the next one is due, or that begins then, at most half a period late and not twice."""
    again = rows.follows & np.concatenate([[False], rows.at_once[:-1]])
    wrong = (rows.wakeup < 0) | (rows.wakeup // rows.period_ns > rows.missed)
    wrong |= rows.at_once & (again | (rows.missed != 0) | (2 * rows.wakeup > rows.period_ns))
    work = np.asarray(rows.result["duration/total"], np.int64)
    return np.asarray(wrong | (rows.closed & (rows.woke + work > rows.over)))


def _causes(rows: SessionRows) -> Claim:
    """Judge that a missed period's cause took most of the measured time, and fits the stamps."""
    says = "what was missed is named by who took most of the time, which is as much as the stamps leave"
    cause = np.asarray(rows.result["live/tick/cause"], np.int64)
    parts = ("computed", "kept", "run_delay", "steal", "device")
    taken = {part: np.asarray(rows.result[f"live/tick/taken/{part}"], np.int64) for part in parts}
    wrong = ((rows.missed > 0) != (cause > 0)) | (cause > 4) | (np.array(list(taken.values())) < 0).any(axis=0)
    left = np.maximum(0, taken["kept"] - taken["run_delay"])
    host = np.minimum(left, taken["steal"])
    device = np.minimum(left - host, taken["device"])
    took = np.stack([np.zeros_like(host), taken["computed"], taken["kept"] - host - device, host, device])
    wrong |= (cause > 0) & (took[np.clip(cause, 0, 4), rows.numbers] < took.max(axis=0))
    # The tick before worked until some time in the period before the deadline that was then slept for. Where it had
    # begun at once, the time is that of both. One that began early may have been done a period and more before.
    at = 1 + np.flatnonzero(rows.closed[:-1] & (rows.missed[1:] > 0))
    since = at - 1 - rows.at_once[at - 1]
    at, since = at[rows.closed[since]], since[rows.closed[since]]
    period = rows.period_ns + int(rows.period_ns * LARGEST_SHIFT) + rows.early[since]
    most = rows.over[at - 1] - rows.woke[since] - taken["computed"][at]
    kept = taken["kept"][at] - rows.wakeup[at] - rows.wakeup[since] % rows.period_ns
    wrong[at] |= (kept < np.maximum(0, most - period)) | (kept > np.maximum(0, most))
    return all_true("causes", says, wrong, ticks=rows.numbers)


def _latency(rows: SessionRows) -> Claim:
    sampled = np.flatnonzero(rows.latency != -1)
    lost = (rows.safety[sampled] & Safety.DEVICE_LOST > 0) & (not rows.dry_run)
    off = np.where((rows.latency[sampled] < 0) | lost, np.inf, 0.0)
    # The time of a newest sample that was not used is unknown.
    usable = np.append(rows.usable, True)
    clear = rows.clear[sampled] & usable[rows.used[sampled] + 1]
    at = sampled[clear]
    sent = rows.samples["time"][rows.used[at]] + rows.latency[at]
    begin = rows.woke[at] + np.asarray(rows.result["duration/total"], np.int64)[at]
    outside = np.maximum(np.maximum(0, begin - sent), sent - rows.over[at])
    # Without a sample of its own, a tick has no latency to tell.
    before = np.concatenate([[-1], rows.used[:-1]])[at]
    off[clear] = np.maximum(off[clear], np.where((rows.used[at] == before) & rows.follows[at], np.inf, 1e-9 * outside))
    says = "from a sample that the tick took to a command after its work and before the next deadline"
    return judged("latency", says, off, 0.0, "s", "one clock stamps all of them", ticks=sampled)


def _samples(rows: SessionRows) -> Claim:
    """Judge the order of the samples, that a tick uses the newest, and that the user's fingers are those of it."""
    seq, time, handed, good = (rows.samples[name] for name in ("seq", "time", "handed", "good"))
    finite = np.isfinite(rows.samples["flexion"]).all(axis=(1, 2)) & np.isfinite(rows.samples["abduction"]).all(axis=1)
    wrong = (np.diff(seq, prepend=-1) < 1) | (np.diff(time, prepend=0) < 0) | (good > 1) | ((good == 1) & ~finite)
    wrong |= (handed < time) | (np.diff(handed, prepend=0) < 0)
    old, jumped = _passed_over(rows), _fingers_apart(rows)
    named = np.array([any(line.startswith(f"{name} {JUMPED}") for line in rows.log) for name in FINGER_NAMES])
    named |= int(rows.live["lost_events"]) > 0
    # A finger that jumped is not believed: the log names it, and it is free.
    other = (jumped & ((rows.stiffness > 0.0) | ~named)).any(axis=1)
    count = int(jumped.any(axis=1).sum())
    note = f"in {counted(count, 'tick')} a finger jumped and was not believed" if count and not other.any() else ""
    unclear = int((~rows.clear).sum())
    if unclear > 1:
        note += f"{'; ' if note else ''}of {unclear:,} ticks it is not known when they ended or what they read"
    says = "samples are in order, and a tick has the fingers of the newest usable one that had been handed over"
    at = np.append(rows.numbers, np.full(len(wrong), -1))
    return all_true("samples", says, np.append(old | other, wrong), ticks=at, note=note)


def _passed_over(rows: SessionRows) -> BoolArray:
    """True for ticks whose sample cannot be used, is older than the one before, or passes over one that was there."""
    used, known = rows.used, rows.used >= 0
    wrong = ~known if rows.samples_whole else np.zeros(len(used), bool)
    wrong[known] |= ~rows.usable[used[known]]
    late = known & rows.closed
    wrong[late] |= rows.samples["time"][used[late]] >= rows.over[late]
    wrong[1:] |= rows.follows[1:] & known[1:] & known[:-1] & (used[1:] < used[:-1])
    # A tick that tells a latency took a sample: the one that it uses, or one after that which cannot be used.
    again = np.flatnonzero(rows.follows & known & (rows.latency != -1) & (used == np.concatenate([[-2], used[:-1]])))
    wrong[again] |= np.append(rows.usable, True)[used[again] + 1]
    usable = np.flatnonzero(rows.usable)
    # The first tick has the hand at which the shown one was put, while others came.
    clear = np.flatnonzero(rows.clear[1:]) + 1
    place = np.searchsorted(usable, rows.newest[clear], side="right") - 1
    wrong[clear] |= (place >= 0) & (usable[np.maximum(place, 0)] > used[clear]) if len(usable) else True
    return np.asarray(wrong)


def _fingers_apart(rows: SessionRows) -> BoolArray:
    """True for fingers of the user that are not those of the tick's sample, shape (T, 5)."""
    differs = np.zeros((len(rows.numbers), 5), bool)
    known = np.flatnonzero(rows.used >= 0)
    for name in ("flexion", "abduction"):
        given, came = np.asarray(rows.result[f"haptic/{name}"])[known], rows.samples[name][rows.used[known]]
        differs[known] |= (given != came).reshape(len(known), 5, -1).any(axis=2)
    return differs


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


def _commands(rows: SessionRows) -> Claim:
    """Judge the command of each tick by that of the tick before, from the shown hand, its forces and the reasons."""
    output, period, tick_zero = rows.limits["output"], 1e-9 * rows.period_ns, rows.result["live/tick/record"][0] == 0
    configured, ramp = np.array(output["stiffness"]), max(1, math.ceil(output["ramp"] / period))
    fall, rise = configured * period / float(output["ease"]), output["stiffness_rise"] * period
    wanted, force = _bends(rows), np.asarray(rows.result["force/phalanx"])
    force = np.sqrt((force * force).sum(axis=3)).sum(axis=2)
    finite = np.isfinite(wanted).all(axis=1) & np.isfinite(force).all(axis=1)
    # A tick that is not in the file, because its solver failed, freed the fingers.
    unseen, eases = rows.follows & ~np.append(False, rows.closed[:-1]), _eased(rows)
    off, good, easing, known = np.zeros(len(finite)), 0, False, bool(tick_zero)
    for t in rows.numbers.tolist():
        first = t == 0 or not rows.follows[t]
        known &= not first or (t == 0 and bool(tick_zero))
        bend, stiffness = (values[max(t - 1, 0)] for values in (rows.bend, rows.stiffness))
        own = np.clip(wanted[t], 0.0, 1.0)
        if not first:
            own = np.clip(bend + np.clip(own - bend, -rows.bend_step, rows.bend_step), 0.0, 1.0)
        if finite[t] and (known or not first):
            off[t] = np.abs(rows.bend[t] - own).max()
        elif not finite[t] and not first:
            # A hand that is not finite moves nothing.
            off[t] = np.abs(rows.bend[t] - bend).max()
        if unseen[t] or t == 0:
            stiffness, good, easing, known = np.zeros(5), 0, False, known or bool(unseen[t])
        if rows.safety[t] != 0:
            good, easing, known = 0, False, True
            off[t] = np.inf if rows.stiffness[t].any() else off[t]
            continue
        good, easing = (0, True) if eases[t] else (good, easing)
        good = min(good + 1, ramp)
        free = force[t] < output["contact_force"]
        now = np.minimum(np.where(free, 0.0, configured * good / ramp), stiffness + rise)
        if easing:
            least = np.where(free, 0.0, stiffness - fall)
            easing, now = bool((least > now).any()), np.maximum(now, least)
        # The watch may keep a finger free that bears a force.
        apart = np.where(rows.stiffness[t] == 0.0, 0.0, np.abs(rows.stiffness[t] - now))
        if not known:
            apart = np.maximum(0.0, np.maximum(-rows.stiffness[t], rows.stiffness[t] - configured))
        off[t] = max(off[t], apart.max())
    says = "with a reason for it every finger is free; else each is stopped where the shown hand is, as stiff as ramp, "
    says += "rise and setting allow where it bears a force"
    off = np.where(((rows.bend < 0.0) | (rows.bend > 1.0)).any(axis=1), np.inf, off)
    return judged("commands", says, off, ROUNDING, "1", "rounding", ticks=rows.numbers)


def _bends(rows: SessionRows) -> FloatArray:
    """Bend nearest to each finger's three angles, shape (T, 5); 0 where a bend moves none of them."""
    slope, offset = (np.array(rows.limits["bend"][name]) for name in ("slope", "offset"))
    size = (slope * slope).sum(axis=1, keepdims=True)
    gain = slope / np.where(size > 0.0, size, 1.0)
    return np.asarray(((np.asarray(rows.result["graphic/flexion"]) - offset) * gain).sum(axis=2))


def _ended(rows: SessionRows) -> Claim:
    ended = str(rows.live["ended"])
    of_loop = ended in IN_ORDER or ended.startswith(DRIVER_DIED)
    stops = bool(rows.safety[-1] & Safety.STOPPING > 0)
    wrong = [rows.result.complete and not (of_loop or ended in BROKEN_OFF), stops and ended in BROKEN_OFF]
    says = "the session ended by a known cause, which its last tick agrees with"
    return all_true("end", says, wrong, note=f"it is said to have ended by '{ended}'" if any(wrong) else "")


def _counters(rows: SessionRows) -> Claim:
    name, says = "counters", "the driver counted the samples that are here, and no more commands than periods"
    if not rows.result.complete or str(rows.live["ended"]) not in IN_ORDER:
        return Claim(name, says, NOT_JUDGED, note="the session was cut short, and its driver's last word is older")
    try:
        stated = {what: int(count) for what, count in json.loads(str(rows.live["counters"])).items()}
    except (ValueError, TypeError, AttributeError):
        return all_true(name, says, [True], note="they cannot be read")
    found = {**dict.fromkeys(COUNTERS, 0), **stated}
    good, last = int((rows.samples["good"] == 1).sum()), int(rows.samples["seq"].max(initial=-1)) + 1
    samples, commands = found["samples"], found["commands"]
    came = samples + found["rejected"]
    # Each period has a command, each of which may be sent once more to be sure, and the end has some of its own.
    periods = int(rows.period.max(initial=0)) + 1
    held = bool((rows.stiffness > 0.0).any()) and not rows.dry_run
    takes = not TAKES_COMMANDS.isdisjoint(rows.result.told("device").get("capabilities", TAKES_COMMANDS))
    wrong = {
        f"nobody counts {', '.join(sorted(set(stated) - set(COUNTERS)))}": len(found) > len(COUNTERS),
        "a count is below zero": min(found.values()) < 0,
        f"{last:,} samples are numbered, {came:,} are counted": came < last,
        f"{good:,} good samples are here, {samples:,} are counted": samples < good,
        f"{came:,} samples are counted, {last:,} are numbered": rows.samples_whole and came > last + MOST_READ,
        f"{commands:,} commands in {periods:,} periods": commands > 2 * periods + AT_THE_END,
        "commands of a dry run": rows.dry_run and commands > 0,
        "no command, though fingers were held": held and takes and commands == 0,
    }
    return all_true(name, says, list(wrong.values()), note="; ".join(what for what, is_so in wrong.items() if is_so))


def _figures(rows: SessionRows) -> list[Claim]:
    """Judge the figures of the summary of a complete session."""
    if not rows.result.complete:
        return []
    stored = rows.result.summary
    own = {**_counts(rows), **_percentiles(rows)}
    share = [HALF_A_BIN if name.endswith(tuple(PERCENTILES)) else SAME for name in own]
    size = share * np.fmax(np.abs(list(own.values())), SAME)
    apart, wrong = figures_apart(stored, own, size, 1.0, "the rows give")
    off = apart.tolist()
    # A loop that was killed had counted its last tick's or not. The most are all periods that have no row.
    least = int(rows.missed.sum()) - (int(rows.missed[-1]) if rows.live["ended"] == LOOP_DIED else 0)
    most = int(rows.period[-1]) + 1 - len(rows.period)
    missed = int(stored.get("missed", -1))
    off.append(0.0 if least <= missed <= most else math.inf)
    if off[-1]:
        wrong.append(f"missed is stored as {missed:,}, the rows allow {least:,} to {most:,}")
    by_cause = _causes_off(rows, stored, missed)
    off.append(math.inf if by_cause else 0.0)
    wrong += by_cause
    strange = sorted(set(stored) - set(own) - {"missed", *(figure.name for figure in MISSED_BY)})
    off += [math.inf] * len(strange)
    wrong += [f"{name} has no definition here" for name in strange]
    says, why = "the figures of the summary are those of the rows", "a billionth; half a bin of 0.2 % for percentiles"
    return [judged("session figures", says, off, 1.0, "of what is let pass", why, note="; ".join(wrong))]


def _causes_off(rows: SessionRows, stored: Mapping[str, Any], missed: int) -> list[str]:
    """Errors of the missed periods by cause, as text."""
    died = rows.live["ended"] == LOOP_DIED
    # A loop that was killed had counted its last tick's or not.
    counted = rows.numbers < len(rows.numbers) - died
    cause = np.asarray(rows.result["live/tick/cause"])
    given = {figure.name: int(stored.get(figure.name, -1)) for figure in MISSED_BY}
    least = {name: int(rows.missed[counted & (cause == i)].sum()) for i, name in enumerate(given, 1)}
    short = {name: own for name, own in least.items() if given[name] < own}
    found = [f"{name} is stored as {given[name]:,}, the rows have {own:,}" for name, own in short.items()]
    total = sum(given.values())
    if total != missed and not (died and total <= missed):
        found.append(f"the causes are {total:,} missed periods together, missed is stored as {missed:,}")
    return found


def _counts(rows: SessionRows) -> dict[str, float]:
    """Counts and maxima of the rows, SI units."""
    result = rows.result
    status, seq = np.asarray(result["status"]), np.asarray(result["input_seq"], np.int64)
    steps = np.diff(seq, prepend=-1)
    force = np.sqrt((np.asarray(result["force/total"]) ** 2).sum(axis=1))
    free = free_counts(lambda why: int((rows.safety & why > 0).sum()))
    found = {
        "ticks": result.ticks,
        "ticks_in_contact": (result["contacts/candidates"] > 0).sum(),
        "ticks_with_resistance": (rows.stiffness > 0.0).any(axis=1).sum(),
        "candidates_max": result["contacts/candidates"].max(initial=0),
        "force_max": np.nan_to_num(force).max(initial=0.0),
        "stuck_ticks": (status & 1 > 0).sum(),
        "lag_ticks": (status & 2 > 0).sum(),
        "samples_used": (steps > 0).sum(),
        "samples_superseded": (steps[steps > 1] - 1).sum(),
        "penetration_max": np.nan_to_num(result["penetration_depth"]).max(initial=0.0),
        **{f"kept_free_{why.lower()}": count for why, count in free.items()},
        **{f"lost_{what}": rows.live[f"lost_{what}"] for what in ("ticks", "samples", "events")},
    }
    return {name: float(value) for name, value in found.items()}


def _percentiles(rows: SessionRows) -> dict[str, float]:
    """Percentiles of wake-up, latency and tick time [s]; NaN where nothing was timed."""
    found = {}
    timed = {
        "wakeup": np.maximum(rows.wakeup, 0),
        "latency": rows.latency[rows.latency >= 0],
        "tick": np.asarray(rows.result["duration/total"], np.int64),
    }
    for what, values in timed.items():
        ordered = np.sort(values)
        for name, percent in PERCENTILES.items():
            rank = max(1, math.ceil(0.01 * percent * len(ordered)))
            # The loop's lowest bin begins at a nanosecond.
            value = min(max(ordered[rank - 1], 1), ordered[-1]) if len(ordered) else math.nan
            found[f"{what}_{name}"] = 1e-9 * float(value)
        found[f"{what}_max"] = 1e-9 * float(ordered[-1]) if len(ordered) else math.nan
    return found
