"""What a live session prints at its end."""

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..console import number, print_table

if TYPE_CHECKING:
    from hhsim.live.session.supervisor import SessionOutcome

Row = tuple[str, str, str]


def print_summary(outcome: "SessionOutcome", title: str) -> None:
    """Print the table, and where the recording is."""
    print_table(("", "hhsim", "unit"), summary_rows(outcome), title=title, numbers=("hhsim",))
    mode = outcome.facts.get("real_time")
    if mode:
        from hhsim.live.real_time import described

        print(f"real time: {described(mode)}")
    if outcome.record is not None and outcome.recorded:
        whole = "" if not outcome.record_failed else ", as far as it came"
        print(f"the session is in {outcome.record}{whole}; hhsim replay {outcome.record} runs it again")


def summary_rows(outcome: "SessionOutcome") -> list[Row]:
    """Label, figure and unit of every line."""
    from hhsim.live.session.statistics import session_figures
    from hhsim.live.session.summary_table import session_rows

    tally, counters = outcome.tally, outcome.counters
    everything = max(outcome.ticks + outcome.missed, 1)
    counted = session_rows(session_figures(tally, outcome.missed, math.nan, {}))
    above = {"ticks", "missed", "penetration_max"}
    rows: list[Row] = [
        ("ticks", f"{outcome.ticks:,}", ""),
        ("missed ticks", f"{outcome.missed:,}", ""),
        ("missed ticks, of all periods", f"{100.0 * outcome.missed / everything:.3f}", "%"),
        *((row.label, row.shown, row.unit) for row in counted if row.name not in above),
        ("frames of the glove", f"{counters.frames:,}", ""),
        ("samples of the hand", f"{counters.samples:,}", ""),
        ("samples rejected, malformed, for others, lost", _several(counters), ""),
        ("commands sent, not taken", f"{counters.commands:,}, {counters.commands_refused:,}", ""),
    ]
    if outcome.watchdog_restarts or outcome.watchdog_releases:
        rows.append(("watchdog: restarts, releases", f"{outcome.watchdog_restarts}, {outcome.watchdog_releases}", ""))
    if outcome.record is not None:
        rows.append(("ticks recorded, lost", f"{outcome.recorded:,}, {outcome.record_lost:,}", ""))
        handless = outcome.ticks - outcome.recorded - outcome.record_lost
        if handless > 0 and not outcome.record_failed:
            rows.append(("ticks without a hand, not recorded", f"{handless:,}", ""))
    deepest = _deepest(outcome)
    if deepest is not None:
        rows.append(("penetration in the recording, max", number(deepest, 3, 1e6), "µm"))
    return rows


def _deepest(outcome: "SessionOutcome") -> float | None:
    """Deepest penetration of the recorded ticks [m]; None where there is no whole recording."""
    from hhsim.errors import InputError
    from hhsim.result.reader import load_result

    if outcome.record is None or outcome.record_failed or not outcome.recorded:
        return None
    try:
        result = load_result(outcome.record)
    except InputError:
        return None
    return float(result.summary["penetration_max"]) if result.complete else None


def summary_json(outcome: "SessionOutcome", error: str) -> dict[str, Any]:
    """The same for machines, SI units; `error` is what went wrong, or ""."""
    return {
        "session": str(outcome.record) if outcome.record is not None else None,
        "reason": outcome.reason,
        "error": error or None,
        "seconds": outcome.seconds,
        **outcome.tally.to_json(),
        "loop_ticks": outcome.ticks,
        "missed": outcome.missed,
        "device": outcome.facts.get("device"),
        "pose": outcome.facts.get("pose"),
        "real_time": outcome.facts.get("real_time"),
        "counters": asdict(outcome.counters),
        "recorded_ticks": outcome.recorded,
        "recorder_lost": outcome.record_lost,
        "penetration_max": _deepest(outcome),
        "watchdog_restarts": outcome.watchdog_restarts,
        "watchdog_releases": outcome.watchdog_releases,
        "events": [{"seconds": at, "level": level, "text": text} for at, level, text in outcome.notices],
    }


def _several(counters: Any) -> str:
    return f"{counters.rejected:,}, {counters.malformed:,}, {counters.other:,}, {counters.dropped:,}"
