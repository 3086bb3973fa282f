"""Summary that a live session prints at its end."""

import math
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from hhsim.table.table import Table, shown

from ..console import print_line, print_table

if TYPE_CHECKING:
    from hhsim.live.session.supervisor import SessionOutcome
    from hhsim.metrics.session_faults import FaultCounts
    from hhsim.result.reader import Result

Row = tuple[str, str, str]


def print_summary(outcome: "SessionOutcome", title: str) -> None:
    """Print the table, a line of faults, and the path of the recording."""
    print_table(Table.of_cells(("", "hhsim", "unit"), summary_rows(outcome), title, numbers=("hhsim",)))
    print_line(fault_counts(outcome).line)
    mode = outcome.facts.get("real_time")
    if mode:
        from hhsim.live.real_time import described

        print_line(f"real time: {described(mode)}")
    if outcome.record is not None and outcome.recorded:
        whole = "" if not outcome.record_failed else ", as far as it came"
        print_line(f"the session is in {outcome.record}{whole}; hhsim replay {outcome.record} runs it again")


def summary_rows(outcome: "SessionOutcome") -> list[Row]:
    """Return label, figure and unit of every line."""
    from hhsim.live.session.statistics import session_figures
    from hhsim.replay.summary_table import session_rows

    tally, counters = outcome.tally, outcome.counters
    everything = max(outcome.ticks + outcome.missed, 1)
    counted = session_rows(session_figures(tally, outcome.missed, outcome.missed_by, math.nan, {}))
    above = {"ticks", "missed", "penetration_max"}
    unused = counters.rejected, counters.malformed, counters.other, counters.dropped
    rows: list[Row] = [
        ("ticks", f"{outcome.ticks:,}", ""),
        ("missed ticks", f"{outcome.missed:,}", ""),
        ("missed ticks, of all periods", f"{100.0 * outcome.missed / everything:.3f}", "%"),
        *((row.label, row.shown, row.unit) for row in counted if row.name not in above),
        ("frames of the glove", f"{counters.frames:,}", ""),
        ("samples of the hand", f"{counters.samples:,}", ""),
        ("samples rejected, malformed, for others, lost", ", ".join(f"{count:,}" for count in unused), ""),
        ("commands sent, not taken", f"{counters.commands:,}, {counters.commands_refused:,}", ""),
    ]
    if outcome.watchdog_restarts or outcome.watchdog_releases:
        label = "watchdog: restarted, commands to free the fingers"
        rows.append((label, f"{outcome.watchdog_restarts}, {outcome.watchdog_releases}", ""))
    if outcome.record is not None:
        rows.append(("ticks recorded, lost", f"{outcome.recorded:,}, {outcome.record_lost:,}", ""))
        handless = outcome.ticks - outcome.recorded - outcome.record_lost
        if handless > 0 and not outcome.record_failed:
            rows.append(("ticks without a hand, not recorded", f"{handless:,}", ""))
    found = recording_errors(outcome)
    if found:
        rows.append(("penetration in the recording, max", shown(1e6 * found["penetration_max"], 3), "µm"))
    if "object_raised" in found:
        rows.append(("object raised, max", shown(1e3 * found["object_raised"], 2), "mm"))
    return rows


def recorded(outcome: "SessionOutcome") -> "Result | None":
    """Return the recording of the hand; None without one that can be read."""
    from hhsim.errors import InputError
    from hhsim.result.reader import load_result

    if outcome.record is not None and outcome.recorded:
        with suppress(InputError):
            return load_result(outcome.record).hands[outcome.side]
    return None


def fault_counts(outcome: "SessionOutcome") -> "FaultCounts":
    """Count faults in the recording, as the gate does; without one, among the events of the session."""
    from hhsim.errors import InputError
    from hhsim.metrics.session_faults import FaultCounts, recorded_faults
    from hhsim.result.schema import FAULT

    with suppress(InputError):
        if (result := recorded(outcome)) is not None:
            return recorded_faults(result)
    tally, counters, early = outcome.tally, outcome.counters, float(bool(outcome.loop_failed))
    told = max(early, sum(level == FAULT for _, level, _ in outcome.notices))
    return FaultCounts(early, told, counters.malformed, counters.frames, tally.freed, tally.ticks)


def recording_errors(outcome: "SessionOutcome") -> dict[str, float]:
    """Return `penetration_max`, and of a free object `object_raised`, over the recording [m]; empty if not whole."""
    from hhsim.metrics.run_ticks import result_free_run

    result = recorded(outcome)
    if result is None or outcome.record_failed or not result.complete:
        return {}
    free = result_free_run(result)
    raised = {} if free is None else {"object_raised": free.raised}
    return {"penetration_max": float(result.summary["penetration_max"]), **raised}


def session_json(outcome: "SessionOutcome", error: str) -> dict[str, Any]:
    """Return `summary_json` of one hand, or of both by their names."""
    if outcome.beside is None:
        return summary_json(outcome, error)
    hands = {of_hand.side: summary_json(of_hand, "") for of_hand in outcome.hands}
    return {"session": str(outcome.record) if outcome.record else None, "error": error or None, "hands": hands}


def summary_json(outcome: "SessionOutcome", error: str) -> dict[str, Any]:
    """Return the summary as plain values, SI units; `error` is a line, or ""."""
    return {
        "session": str(outcome.record) if outcome.record is not None else None,
        "reason": outcome.reason,
        "error": error or None,
        "fault_at_end": outcome.fault_at_end or None,
        "seconds": outcome.seconds,
        **outcome.tally.figures(),
        "uncounted_ticks": outcome.tally.lost,
        "loop_ticks": outcome.ticks,
        "missed": outcome.missed,
        "missed_by": outcome.missed_by,
        **{name: outcome.facts.get(name) for name in ("device", "pose", "real_time")},
        "counters": asdict(outcome.counters),
        "recorded_ticks": outcome.recorded,
        "recorder_lost": outcome.record_lost,
        "penetration_max": None,
        **recording_errors(outcome),
        **fault_counts(outcome).figures,
        "watchdog_restarts": outcome.watchdog_restarts,
        "watchdog_releases": outcome.watchdog_releases,
        "events": [{"seconds": at, "level": level, "text": text} for at, level, text in outcome.notices],
    }
