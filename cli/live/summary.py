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

Row = tuple[str, str, str]


def print_summary(outcome: "SessionOutcome", title: str) -> None:
    """Print the table, a line of faults, and the path of the recording."""
    faults, depths = judged(outcome)
    print_table(Table.of_cells(("", "hhsim", "unit"), summary_rows(outcome, depths), title, numbers=("hhsim",)))
    print_line(faults.line)
    mode = outcome.facts.get("real_time")
    if mode:
        from hhsim.live.real_time import described

        print_line(f"real time: {described(mode)}")
    if outcome.record is not None and outcome.recorded:
        whole = "" if not outcome.record_failed else ", as far as it came"
        print_line(f"the session is in {outcome.record}{whole}; hhsim replay {outcome.record} runs it again")


def summary_rows(outcome: "SessionOutcome", depths: dict[str, float]) -> list[Row]:
    """Return label, figure and unit of every line; `depths` as `judged` has them."""
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
    for name, label, factor, digits, unit in (
        ("penetration_max", "penetration in the recording, max", 1e6, 3, "µm"),
        ("object_raised", "object raised, max", 1e3, 2, "mm"),
    ):
        if name in depths:
            rows.append((label, shown(factor * depths[name], digits), unit))
    return rows


def judged(outcome: "SessionOutcome") -> "tuple[FaultCounts, dict[str, float]]":
    """Return the faults of a hand's recording, counted as the gate does, and how deep it is [m].

    Without a recording faults are counted among the events of the session. The depths are `penetration_max`, and of a
    free object `object_raised`; none where the recording is not whole.
    """
    from hhsim.errors import InputError
    from hhsim.metrics.run_ticks import result_free_run
    from hhsim.metrics.session_faults import FaultCounts, recorded_faults
    from hhsim.result.reader import load_result
    from hhsim.result.schema import FAULT

    tally, counters, early = outcome.tally, outcome.counters, float(bool(outcome.loop_failed))
    told = max(early, sum(level == FAULT for _, level, _ in outcome.notices))
    faults = FaultCounts(early, told, counters.malformed, counters.frames, tally.freed, tally.ticks)
    depths: dict[str, float] = {}
    with suppress(InputError):
        if outcome.record is not None and outcome.recorded:
            result = load_result(outcome.record).hands[outcome.side]
            if result.complete and not outcome.record_failed:
                free = result_free_run(result)
                depths["penetration_max"] = float(result.summary["penetration_max"])
                depths |= {} if free is None else {"object_raised": free.raised}
            faults = recorded_faults(result)
    return faults, depths


def session_json(outcome: "SessionOutcome") -> dict[str, Any]:
    """Return `summary_json` of one hand, or of both by their names."""
    if outcome.beside is None:
        return summary_json(outcome)
    whole = {"session": str(outcome.record) if outcome.record else None, "error": outcome.error or None}
    return whole | {"hands": {of_hand.side: summary_json(of_hand) for of_hand in outcome.hands}}


def summary_json(outcome: "SessionOutcome") -> dict[str, Any]:
    """Return the summary of a hand as plain values, SI units."""
    faults, depths = judged(outcome)
    return {
        "session": str(outcome.record) if outcome.record is not None else None,
        **{name: getattr(outcome, name) or None for name in ("error", "fault_at_end")},
        **outcome.tally.figures(),
        "uncounted_ticks": outcome.tally.lost,
        "loop_ticks": outcome.ticks,
        "counters": asdict(outcome.counters),
        "recorded_ticks": outcome.recorded,
        "recorder_lost": outcome.record_lost,
        "penetration_max": None,
        **depths,
        **faults.figures,
        **{name: outcome.facts.get(name) for name in ("device", "pose", "real_time")},
        **{name: getattr(outcome, name) for name in ("reason", "seconds", "missed", "missed_by")},
        **{name: getattr(outcome, name) for name in ("watchdog_restarts", "watchdog_releases")},
        "events": [{"seconds": at, "level": level, "text": text} for at, level, text in outcome.notices],
    }
