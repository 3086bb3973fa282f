"""The figures of a recorded session, as they stand in its file's summary."""

import json
import math
from collections.abc import Mapping
from typing import Any

from hhsim.live.live_tally import LiveTally

Scalar = str | int | float | bool


def session_figures(
    tally: LiveTally, missed: int, penetration_max: float, lost: Mapping[str, int]
) -> dict[str, Scalar]:
    """The summary of a session: of all ticks that were recorded, SI units.

    Args:
        tally: of these ticks.
        missed: periods without a tick since the loop began.
        penetration_max: deepest of all of them [m].
        lost: records that were overwritten before they could be written, by ring.

    Returns:
        What `LiveTally.to_json` names (`wakeup_p999` is the 99.9th percentile [s]), the ticks that were kept free as
        one figure a reason (`kept_free_stale_input`), `missed`, `penetration_max` [m], and `lost_ticks`,
        `lost_samples` and `lost_events`.
    """
    figures = tally.to_json()
    del figures["uncounted_ticks"]
    free: Mapping[str, int] = figures.pop("ticks_kept_free")
    return {
        **{name: value for name, value in figures.items() if isinstance(value, Scalar)},
        "missed": missed,
        **{f"kept_free_{why.lower()}": count for why, count in free.items()},
        "penetration_max": penetration_max,
        **{f"lost_{name}": count for name, count in lost.items()},
    }


def summary_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Label, figure and unit of every line of a session's table, from its file's summary."""
    rows = [
        _count(summary, "ticks", "ticks"),
        _count(summary, "missed", "missed ticks"),
        *(_time(summary, "wakeup", "wake-up after the deadline", p) for p in ("p50", "p99", "p999", "max")),
        *(_time(summary, "latency", "sample in to command out", p) for p in ("p50", "p99", "p999", "max")),
        *(_time(summary, "tick", "the solver's tick, wall", p) for p in ("p50", "p99", "max")),
        ("penetration, max", _number(1e6 * summary["penetration_max"], 3), "µm"),
        ("force, most", _number(summary["force_max"], 2), "N"),
        _count(summary, "ticks_in_contact", "ticks with candidate pairs"),
        _count(summary, "ticks_with_resistance", "ticks that resist a finger"),
        *(
            (f"ticks with free fingers: {name.removeprefix('kept_free_').replace('_', ' ')}", f"{count:,}", "")
            for name, count in summary.items()
            if name.startswith("kept_free_") and count
        ),
        _count(summary, "stuck_ticks", "stuck ticks"),
        _count(summary, "lag_ticks", "ticks with lag"),
        _count(summary, "samples_used", "samples used"),
        _count(summary, "samples_superseded", "samples that a newer one replaced"),
    ]
    lost = [f"{summary[f'lost_{name}']:,}" for name in ("ticks", "samples", "events")]
    return [*rows, ("ticks, samples and events that the recorder lost", ", ".join(lost), "")]


def _count(summary: Mapping[str, Any], name: str, label: str) -> tuple[str, str, str]:
    return label, f"{summary[name]:,}", ""


def _time(summary: Mapping[str, Any], name: str, label: str, which: str) -> tuple[str, str, str]:
    shown = "max" if which == "max" else "p99.9" if which == "p999" else which
    return f"{label}, {shown}", _number(1e6 * summary[f"{name}_{which}"], 1), "µs"


def _number(value: float, digits: int) -> str:
    return "—" if math.isnan(value) else f"{value:,.{digits}f}"


def as_text(value: Any) -> str:
    """Plain values as the JSON text that an attribute of the file holds."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False)
