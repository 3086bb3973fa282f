"""Claims of a recorded session that no second run gives: its periods, samples, reasons, commands and figures.

The loop sleeps until a tick is due, reads, solves, sends commands and sleeps again, or begins the next tick at once.
What was measured cannot be run again: the stamps are held against each other.
"""

import signal
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, FloatArray, IntArray
from hhsim.kernels.live.interlock import FREES_BOTH
from hhsim.kernels.live.phase import LARGEST_SHIFT
from hhsim.metrics.session_faults import MISSED_BY
from hhsim.result.reader import Result
from hhsim.result.safety import Safety, free_counts
from hhsim.verify.claim import Claim, all_true, figures_apart, judged
from hhsim.verify.file_checks import follows
from hhsim.verify.tick_data import CAPACITY_EXCEEDED, INPUT_INVALID

MOST_ANGLE = 2.0 * np.pi
"""Largest plausible joint angle [rad]: samples beyond are not used."""
LOOP_DIED = "the loop failed or was killed"
"""Reason of the end of a session whose loop was not brought to its end."""
BROKEN_OFF = (LOOP_DIED, "the session's supervisor died before the loop began")
ENDS = ("duration", "stopped", "the command was killed", *(number.name for number in signal.Signals), *BROKEN_OFF)
"""Reasons of an end; another one begins with `DRIVER_DIED`."""
DRIVER_DIED = "the glove's driver "
ROUNDING = 1e-9
"""Tolerance of commands, and relative one of figures: a glove has a few thousand steps."""
HALF_A_BIN = 1e-3
"""Relative tolerance of percentiles: half a bin of the loop's histogram, which is 0.2 % wide."""
PERCENTILES = {"p50": 50.0, "p99": 99.0, "p999": 99.9, "max": 100.0}


def session_claims(result: Result) -> list[Claim]:
    """Judge the claims of a session; none of a replay."""
    if result.live is None:
        return []
    rows = SessionRows(result)
    return [judge(rows) for judge in (_periods, _samples, _reasons, _commands, _figures)]


class SessionRows:
    """Tables of a session; arrays have shape (T,) and are as /live/tick unless a comment says otherwise."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.live: dict[str, Any] = dict(result.live or {})  # description of the session
        self.limits: dict[str, Any] = result.told("limits")  # of output and safety
        self.period_ns = round(1e9 / float(result.scene["rate"]))  # of a tick
        self.numbers, self.follows = np.arange(result.ticks), follows(result)
        self.record, self.period, self.deadline, self.early, self.wakeup, self.latency, self.missed, self.safety = (
            np.asarray(result[f"live/tick/{name}"], np.int64)
            for name in ("record", "period", "deadline", "early", "wakeup", "latency", "missed", "safety")
        )
        self.at_once = np.asarray(result["live/tick/at_once"], bool)
        self.bend = np.asarray(result["live/tick/command_bend"])  # command to each finger, (T, 5)
        self.stiffness = np.asarray(result["live/tick/command_stiffness"])  # (T, 5)
        # Wake-up of the loop, or begin of the tick [ns].
        self.woke = self.deadline + self.wakeup % self.period_ns
        # True if the end of the tick's span is known, and that end: the next deadline slept for, or begin [ns].
        self.closed = np.append((self.follows & (np.diff(self.period, prepend=-1) == 1 + self.missed))[1:], False)
        slept = np.where(self.at_once, self.woke, self.deadline - self.wakeup // self.period_ns * self.period_ns)
        self.over = np.append(slept[1:], 0)
        names = ("record", "seq", "time", "handed", "good", "flexion", "abduction")
        self.samples: dict[str, AnyArray] = {name: np.asarray(result[f"live/sample/{name}"]) for name in names}
        # Row of the sample that each tick used, -1 where it is not in the file.
        seq, wanted = self.samples["seq"], np.asarray(result["input_seq"], np.int64)
        order = np.argsort(seq, kind="stable")
        place = np.minimum(np.searchsorted(seq[order], wanted), max(len(seq) - 1, 0))
        self.used: IntArray = np.where(seq[order][place] == wanted, order[place], -1) if len(seq) else wanted * 0 - 1

    @cached_property
    def usable(self) -> BoolArray:
        """True for finite, plausible samples, shape (S,), and for one that never came."""
        angles = [self.samples[name].reshape(len(self.samples["seq"]), -1) for name in ("flexion", "abduction")]
        plausible = (np.abs(np.concatenate(angles, axis=1)) <= MOST_ANGLE).all(axis=1)
        return np.append((self.samples["good"] == 1) & plausible, True)

    @property
    def took_another(self) -> BoolArray:
        """True for ticks that tell of the latency of a sample, which is not the one in use."""
        return np.asarray(self.follows & (self.latency != -1) & (self.used == np.append(-2, self.used[:-1])))

    @property
    def known(self) -> BoolArray:
        """True for ticks whose sample is in the file."""
        return self.used >= 0

    def of_sample(self, name: str) -> AnyArray:
        """Column of the samples that the `known` ticks used."""
        return self.samples[name][self.used[self.known]]


def _named(name: str, says: str, rows: SessionRows, wrong: Mapping[str, BoolArray]) -> Claim:
    """Judge flags by what they are of, shape (T,) each."""
    found = [f"{what} at tick {int(ticks.argmax()):,}" for what, ticks in wrong.items() if ticks.any()]
    any_, note = np.any(list(wrong.values()), axis=0), f"wrong: {', '.join(found)}" if found else ""
    return all_true(name, says, any_, ticks=rows.numbers, note=note)


def _periods(rows: SessionRows) -> Claim:
    """Judge records, deadlines, missed ticks and wake-ups, all by the stamps."""
    lost = False
    for what, record in (("ticks", rows.record), ("samples", rows.samples["record"])):
        missing = int(record[-1]) + 1 - len(record) if len(record) else 0
        # Where the recorder was killed, its last word may be older than its last block.
        lost |= bool((np.diff(record, prepend=-1) < 1).any())
        lost |= rows.result.complete and missing != int(rows.live[f"lost_{what}"])
    ends, periods = rows.deadline + rows.early, np.diff(rows.period, prepend=rows.period[0] - 1)
    apart = np.diff(ends, prepend=ends[0] - rows.period_ns)
    # A tick moves the next one by a share of its period at most, towards the glove's samples.
    most = int(rows.period_ns * LARGEST_SHIFT) * np.maximum(1, periods - rows.missed)
    # A tick that failed in the solver is no row, and is not missed.
    gone = np.diff(rows.period, prepend=-1) - 1 - rows.missed
    failed = bool((rows.safety & Safety.SOLVER_FAILED > 0).any()) or b"the solver failed" in _log(rows)
    work = np.asarray(rows.result["duration/total"], np.int64)
    wrong = {
        "records": np.full(len(rows.numbers), lost),
        "deadlines": (periods < 1) | (np.abs(apart - rows.period_ns * periods) > most) | (rows.early < 0),
        "missed periods": (rows.missed < 0) | (gone < 0) | (rows.follows & (gone > 0) & (not failed)),
        "wake-ups": (rows.wakeup < 0) | (rows.wakeup // rows.period_ns > rows.missed),
        "work": rows.closed & (rows.woke + work > rows.over),
    }
    says = "periods, deadlines and wake-ups follow each other, and every period has a tick or is counted as missed"
    return _named("periods", says, rows, wrong)


def _log(rows: SessionRows) -> bytes:
    return b"\n".join(bytes(text) for text in rows.result["live/event/text"])


def _samples(rows: SessionRows) -> Claim:
    """Judge the order of the samples, and that a tick has the fingers of a usable one that came before it ended."""
    seq, time, handed, good = (rows.samples[name] for name in ("seq", "time", "handed", "good"))
    wrong = (np.diff(seq, prepend=-1) < 1) | (np.diff(time, prepend=0) < 0) | (good > 1)
    wrong |= (handed < time) | (np.diff(handed, prepend=0) < 0)
    whole = rows.result.complete and int(rows.live["lost_samples"]) == 0
    known, after, jumped = rows.known, np.append(False, rows.follows[1:]), np.zeros((len(rows.numbers), 5), bool)
    off = ~known & whole
    off[known] |= ~rows.usable[rows.used[known]] | (rows.closed[known] & (rows.of_sample("time") >= rows.over[known]))
    off |= (after & known & (np.diff(rows.used, prepend=-1) < 0)) | (rows.took_another & rows.usable[rows.used + 1])
    for name in ("flexion", "abduction"):
        differs = np.asarray(rows.result[f"haptic/{name}"])[known] != rows.of_sample(name)
        jumped[known] |= differs.reshape(len(differs), 5, -1).any(axis=2)
    # A finger that jumped is not believed, which the log says, and it is free.
    told = b"jumped by" in _log(rows) or int(rows.live["lost_events"]) > 0
    off |= (jumped & ((rows.stiffness > 0.0) | (not told))).any(axis=1)
    says = "samples are in order, and a tick has the fingers of a usable one that had been handed over"
    at = np.append(rows.numbers, np.full(len(wrong), -1))
    return all_true("samples", says, np.append(off, wrong), ticks=at)


def _reasons(rows: SessionRows) -> Claim:
    bits, status, safety = rows.safety, np.asarray(rows.result["status"]), rows.limits["safety"]
    stopping, dry = bits & Safety.STOPPING > 0, bool(rows.live["dry_run"])
    ends = rows.result.complete and rows.live["ended"] in ("duration", "stopped")
    other = np.zeros(len(bits), bool)
    if rows.result.other is not None:
        faulty = np.asarray(rows.result.other["live/tick/safety"], np.int64) & FREES_BOTH > 0
        other = faulty | np.append(False, faulty[:-1])
    stale = np.zeros(len(bits), bool)
    age = rows.woke[rows.known] - rows.of_sample("time")
    stale[rows.known] = age > round(1e9 * float(safety["stale"]))
    overrun = _streak(rows) >= _release_at(rows)
    bad = (rows.took_another & ~rows.usable[rows.used + 1]) | (status & INPUT_INVALID > 0)
    wrong = {
        "unknown": (bits < 0) | (bits >= 2 * max(Safety)),
        "dry run": (bits & Safety.DRY_RUN > 0) != dry,
        # Ticks before the first input are not in the file.
        "no input yet": bits & Safety.NO_INPUT_YET > 0,
        "not finite": bad & (bits & Safety.NOT_FINITE == 0),
        "solver failed": (status & CAPACITY_EXCEEDED > 0) & (bits & Safety.SOLVER_FAILED == 0),
        "overrun streak": overrun & (bits & Safety.OVERRUN_STREAK == 0),
        "stale": stale & (bits & Safety.STALE_INPUT == 0),
        "no watchdog": (bits & Safety.NO_WATCHDOG > 0) & (dry or not safety["watchdog"]),
        "other hand": (bits & Safety.OTHER_HAND > 0) & ~other,
        "stopping": stopping & (rows.numbers < len(bits) - 1) | ((rows.numbers == len(bits) - 1) & ends & ~stopping),
    }
    says = "the reasons for free fingers are those that the stamps, the samples and the status show"
    return _named("reasons", says, rows, wrong)


def _release_at(rows: SessionRows) -> int:
    """Missed periods in a row that free the fingers; a stall that is held or eased may last as long as a heartbeat."""
    safety = rows.limits["safety"]
    most = int(safety["overruns"])
    if safety["after_stall"] == "release":
        return most
    return max(most, round(1e9 * float(safety["heartbeat_stale"])) // rows.period_ns - 1)


def _streak(rows: SessionRows) -> IntArray:
    """Number of periods missed or begun late in a row before each tick, since the last gap of the file."""
    late, sums = rows.missed + rows.at_once, np.cumsum(rows.missed + rows.at_once)
    # What was missed before a gap, or before a tick that is not in the file, is not counted.
    calm, before = (late == 0) | ~np.append(False, rows.closed[:-1]), np.where(late == 0, sums, sums - late)
    return np.asarray(sums - before[np.maximum.accumulate(np.where(calm, rows.numbers, 0))])


def _commands(rows: SessionRows) -> Claim:
    """Judge the commands by those of the tick before, the shown hand, its forces and the reasons; softer is safe."""
    output, period = rows.limits["output"], 1e-9 * rows.period_ns
    configured, first = np.array(output["stiffness"]), np.asarray(~rows.follows)
    force = np.linalg.norm(np.asarray(rows.result["force/phalanx"]), axis=3).sum(axis=2)
    before, bend = (np.roll(values, 1, axis=0) for values in (rows.stiffness, rows.bend))
    eases = rows.limits["safety"]["after_stall"] == "ease"
    fall = configured * period / float(output["ease"])
    # Where it bears nothing a finger is free, or eased after a stall.
    most = np.where(force < output["contact_force"], np.maximum(0.0, before - fall) if eases else 0.0, configured)
    rise = np.where(first[:, None], configured, before + output["stiffness_rise"] * period)
    unseen = rows.follows & ~np.append(False, rows.closed[:-1])
    # A tick that is not in the file, because its solver failed, freed the fingers, as did one with a reason.
    freed = np.asarray(unseen | np.append(False, rows.safety[:-1] != 0))[:, None]
    ramp = configured * period / output["ramp"] if output["ramp"] > period else configured
    most = np.minimum(most, np.minimum(rise, np.where(freed, ramp, configured)))
    most = np.where(np.asarray(rows.safety != 0)[:, None], 0.0, most)
    wanted, step = np.clip(_bends(rows), 0.0, 1.0), float(output["bend_speed"]) * period
    # A hand that is not finite moves nothing.
    wanted = np.where(np.isfinite(wanted).all(axis=1, keepdims=True), wanted, bend)
    own = np.where(first[:, None], wanted, np.clip(bend + np.clip(wanted - bend, -step, step), 0.0, 1.0))
    # Of the first tick of a file, and after a gap, the one before is not known.
    unknown = np.asarray(first & (rows.record != 0))[:, None]
    moved = np.where(unknown, 0.0, np.abs(rows.bend - own))
    off = np.maximum(np.maximum(0.0, rows.stiffness - most), moved)
    off = np.maximum(np.where((rows.bend < 0.0) | (rows.bend > 1.0), np.inf, off), -rows.stiffness).max(axis=1)
    says = "with a reason for it every finger is free; else each is stopped where the shown hand is, no stiffer than "
    says += "ramp, rise and setting allow where it bears a force"
    return judged("commands", says, off, ROUNDING, "1", "rounding", ticks=rows.numbers)


def _bends(rows: SessionRows) -> FloatArray:
    """Bend nearest to each finger's three angles, shape (T, 5); 0 where a bend moves none of them."""
    slope, offset = (np.array(rows.limits["bend"][name]) for name in ("slope", "offset"))
    size = (slope * slope).sum(axis=1, keepdims=True)
    gain = slope / np.where(size > 0.0, size, 1.0)
    return np.asarray(((np.asarray(rows.result["graphic/flexion"]) - offset) * gain).sum(axis=2))


def _figures(rows: SessionRows) -> Claim:
    """Judge the figures of the summary of a complete session, and the reason of its end."""
    ended, stored = str(rows.live["ended"]), rows.result.summary
    own = {**_counts(rows), **_percentiles(rows)} if rows.result.complete else {}
    share = [HALF_A_BIN if name.endswith(tuple(PERCENTILES)) else ROUNDING for name in own]
    size = share * np.fmax(np.abs(list(own.values())), ROUNDING)
    apart, wrong = figures_apart(stored, own, size, 1.0, "the rows give")
    if rows.result.complete:
        # A loop that was killed had counted its last tick's or not. The most are all periods that have no row.
        least = int(rows.missed.sum()) - (int(rows.missed[-1]) if ended == LOOP_DIED else 0)
        most, missed = int(rows.period[-1]) + 1 - len(rows.period), int(stored.get("missed", -1))
        causes = [int(stored.get(figure.name, -1)) for figure in MISSED_BY]
        if not least <= missed <= most or (sum(causes) != missed and ended != LOOP_DIED):
            allowed = f"{sum(causes):,} by cause; the rows allow {least:,} to {most:,}"
            wrong.append(f"missed is stored as {missed:,}, {allowed}")
        strange = set(stored) - set(own) - {"missed", *(figure.name for figure in MISSED_BY)}
        wrong += [f"{name} has no definition here" for name in sorted(strange)]
        stops = bool(rows.safety[-1] & Safety.STOPPING > 0)
        if (ended not in ENDS and not ended.startswith(DRIVER_DIED)) or (stops and ended in BROKEN_OFF):
            wrong.append(f"it is said to have ended by '{ended}'")
    off = np.append(apart, np.inf if wrong else 0.0)
    says, why = "the figures of the summary are those of the rows", "a billionth; half a bin of 0.2 % for percentiles"
    return judged("session figures", says, off, 1.0, "of what is let pass", why, note="; ".join(wrong))


def _counts(rows: SessionRows) -> dict[str, float]:
    """Counts and maxima of the rows, SI units."""
    result = rows.result
    status, steps = np.asarray(result["status"]), np.diff(np.asarray(result["input_seq"], np.int64), prepend=-1)
    free = free_counts(lambda why: int((rows.safety & why > 0).sum()))
    found = {
        "ticks": result.ticks,
        "ticks_in_contact": (result["contacts/candidates"] > 0).sum(),
        "ticks_with_resistance": (rows.stiffness > 0.0).any(axis=1).sum(),
        "candidates_max": result["contacts/candidates"].max(initial=0),
        "force_max": np.nan_to_num(np.linalg.norm(result["force/total"], axis=1)).max(initial=0.0),
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
    """Percentiles and maxima of wake-up, latency and tick time [s]; NaN where nothing was timed."""
    timed = {
        "wakeup": np.maximum(rows.wakeup, 0),
        "latency": rows.latency[rows.latency >= 0],
        "tick": np.asarray(rows.result["duration/total"], np.int64),
    }
    # The loop's lowest bin begins at a nanosecond.
    return {
        f"{what}_{name}": 1e-9 * float(max(np.percentile(values, percent, method="inverted_cdf"), name != "max"))
        if len(values)
        else np.nan
        for what, values in timed.items()
        for name, percent in PERCENTILES.items()
    }
