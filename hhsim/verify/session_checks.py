"""Claims of a recorded session: its periods, latencies and samples, and its summary."""

import json
import math
import signal
from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.kernels.live.deadlines import EARLIEST
from hhsim.kernels.live.phase import LARGEST_SHIFT
from hhsim.metrics.session_faults import MISSED_BY
from hhsim.result.reader import Result
from hhsim.result.safety import Safety, free_counts
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_JUDGED, Claim, all_true, figures_apart, judged
from hhsim.verify.finger_command_checks import command_claims
from hhsim.verify.tick_data import LOOP_DIED, MOST_READ, SessionRows

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
ONE_CLOCK = "one clock stamps all of them"
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
    of_times = _records, _deadlines, _early, _missed, _causes, _wakeup, _latency
    of_samples = _samples, _newest, _haptic, _ended, _counters
    return [*(judge(rows) for judge in (*of_times, *of_samples)), *command_claims(rows), *_figures(rows)]


def _records(rows: SessionRows) -> Claim:
    wrong, notes = [], []
    for what, record in (("ticks", np.asarray(rows.result["live/tick/record"])), ("samples", rows.samples["record"])):
        wrong.append(bool((np.diff(record, prepend=-1) < 1).any()))
        missing = int(record[-1]) + 1 - len(record) if len(record) else 0
        stated = int(rows.live[f"lost_{what}"])
        # Where the recorder was killed, its last word may be older than its last block.
        wrong.append(rows.result.complete and missing != stated)
        if wrong[-1]:
            notes.append(f"{missing:,} {what} are missing, {stated:,} are said to be lost")
    says = "records are in their order, and those that are missing are said to be lost"
    return all_true("records", says, np.array(wrong), note="; ".join(notes))


def _deadlines(rows: SessionRows) -> Claim:
    ends = rows.deadline + rows.early
    periods = np.diff(rows.period, prepend=rows.period[0] - 1)
    apart = np.diff(ends, prepend=ends[0] - rows.period_ns)
    off = np.where(periods < 1, np.inf, np.abs(apart - rows.period_ns * periods))
    most = int(rows.period_ns * LARGEST_SHIFT) * np.maximum(1, periods - rows.missed)
    says = f"ends of periods are {1e-6 * rows.period_ns:g} ms apart, by their numbers"
    why = f"a tick moves the next one by {LARGEST_SHIFT:g} of its period at most, towards the glove's samples"
    return judged("deadlines", says, 1e-9 * off, 1e-9 * most, "s", why, ticks=rows.numbers)


def _early(rows: SessionRows) -> Claim:
    says = f"a tick is due before its period ends only with a sample that it takes, and by {EARLIEST:g} periods at most"
    pace = next(iter(rows.result.hands.values()))
    if pace.name != rows.result.name:
        return _with_first(rows, SessionRows(pace))
    most, early = int(EARLIEST * rows.period_ns), rows.early > 0
    wrong = (rows.early < 0) | (rows.early > most)
    wrong |= early & ((rows.missed > 0) | rows.at_once | (rows.wakeup >= rows.early))
    if rows.samples_whole:
        # Samples that cannot be used make a tick due as well, but are no tick's.
        at = 1 + np.flatnonzero(early[1:] & rows.follows[1:] & (rows.used[:-1] >= 0))
        first, due, handed = rows.used[at - 1] + 1, rows.deadline[at], rows.samples["handed"]
        last = np.searchsorted(handed, due, side="right") - 1
        there = (last >= first) & ((handed[last] == due) | (rows.early[at] == most))
        wrong[at] |= ~there
    return all_true("early ticks", says, wrong, ticks=rows.numbers)


def _with_first(rows: SessionRows, first: SessionRows) -> Claim:
    """Judge the ticks of a second hand, which come with those of the first one."""
    says = "a tick is due when that of the other hand is, whose samples set the pace"
    of_both = ("period", "deadline", "early", "wakeup", "missed", "at_once")
    wrong = np.any([getattr(rows, name) != getattr(first, name) for name in of_both], axis=0)
    return all_true("early ticks", says, wrong, ticks=rows.numbers)


def _missed(rows: SessionRows) -> Claim:
    gone = np.diff(rows.period, prepend=-1) - 1 - rows.missed
    wrong = (rows.missed < 0) | (gone < 0)
    odd = np.flatnonzero(rows.follows & (gone > 0))
    wrong[odd] |= ~rows.solver_failed(rows.woke[odd - 1], rows.woke[odd])
    says = "every period without a tick is counted as missed"
    return all_true("missed periods", says, wrong, ticks=rows.numbers)


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
    return all_true("causes of missed periods", says, wrong, ticks=rows.numbers)


def _wakeup(rows: SessionRows) -> Claim:
    early = np.maximum(0, -rows.wakeup)
    wrong = rows.wakeup // rows.period_ns > rows.missed
    again = rows.follows & np.concatenate([[False], rows.at_once[:-1]])
    wrong |= rows.at_once & (again | (rows.missed != 0) | (2 * rows.wakeup > rows.period_ns))
    work = np.asarray(rows.result["duration/total"], np.int64)
    long_ = np.where(rows.closed, np.maximum(0, rows.woke + work - rows.over), 0)
    off = np.where(wrong, np.inf, 1e-9 * np.maximum(early, long_))
    says = "a tick wakes after its deadline and is done before the next one's, or that one begins then, at most half a "
    says += "period late and not twice in a row; periods slept over are missed ones"
    return judged("wake-up", says, off, 0.0, "s", ONE_CLOCK, ticks=rows.numbers)


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
    return judged("latency", says, off, 0.0, "s", ONE_CLOCK, ticks=sampled, note=_unclear(rows))


def _samples(rows: SessionRows) -> Claim:
    seq, time, handed, good = (rows.samples[name] for name in ("seq", "time", "handed", "good"))
    finite = np.isfinite(rows.samples["flexion"]).all(axis=(1, 2)) & np.isfinite(rows.samples["abduction"]).all(axis=1)
    wrong = (np.diff(seq, prepend=-1) < 1) | (np.diff(time, prepend=0) < 0) | (good > 1) | ((good == 1) & ~finite)
    wrong |= (handed < time) | (np.diff(handed, prepend=0) < 0)
    says = "samples are in the order in which they came and were handed over, and good ones are finite"
    return all_true("samples", says, wrong)


def _newest(rows: SessionRows) -> Claim:
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
    says = "a tick has a usable sample no older than the one before, and none is passed over that had been handed over"
    return all_true("newest sample", says, wrong, ticks=rows.numbers, note=_unclear(rows))


def _haptic(rows: SessionRows) -> Claim:
    known = np.flatnonzero(rows.used >= 0)
    differs = np.zeros((len(known), 5), bool)
    for name in ("flexion", "abduction"):
        given = np.asarray(rows.result[f"haptic/{name}"])[known]
        came = rows.samples[name][rows.used[known]]
        differs |= (given != came).reshape(len(known), 5, -1).any(axis=2)
    named = np.array([any(line.startswith(f"{name} {JUMPED}") for line in rows.log) for name in FINGER_NAMES])
    if int(rows.live["lost_events"]) > 0:
        named[:] = True
    wrong = (differs & ((rows.stiffness[known] > 0.0) | ~named)).any(axis=1)
    count = int(differs.any(axis=1).sum())
    note = f"in {counted(count, 'tick')} a finger jumped and was not believed" if count and not wrong.any() else ""
    says = "the user's fingers are those of the sample; where one is not, the log names it and it is free"
    return all_true("fingers of the sample", says, wrong, ticks=known, note=note)


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


def _unclear(rows: SessionRows) -> str:
    """Note on the ticks that cannot be judged by their samples; the last one never can."""
    unclear = int((~rows.clear).sum())
    return f"of {unclear:,} ticks it is not known when they ended or what they read" if unclear > 1 else ""


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
