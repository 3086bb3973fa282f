"""The lines of a session's table: what each figure of its summary is called, and how it is shown."""

import math
from collections.abc import Mapping
from typing import Any

from hhsim.replay.summary_table import LINES, Line, SummaryRow, shown
from hhsim.result.safety import WORDS, Safety

_TIMES = {
    "wakeup": "wake-up after the deadline",
    "latency": "sample in to command out",
    "tick": "the solver's tick, wall",
}
_PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}

SESSION_LINES: dict[str, Line] = {
    "ticks": Line("ticks with a hand", 0),
    "missed": Line("missed ticks", 0),
    **{
        f"{name}_{part}": Line(f"{label}, {told}", 1, "µs", scale=1e-6)
        for name, label in _TIMES.items()
        for part, told in _PERCENTILES.items()
    },
    "ticks_in_contact": Line("ticks with candidate pairs", 0),
    "candidates_max": LINES["candidates_max"],
    "force_max": Line("force, most", 2, "N"),
    "ticks_with_resistance": Line("ticks that resist a finger", 0),
    **{
        f"kept_free_{why.name.lower()}": Line(f"ticks with free fingers: {WORDS[why]}", 0) for why in Safety if why.name
    },
    "stuck_ticks": LINES["stuck_ticks"],
    "lag_ticks": LINES["lag_ticks"],
    "samples_used": Line("samples used", 0),
    "samples_superseded": Line("samples that a newer one replaced", 0),
    "penetration_max": LINES["penetration_max"],
    "lost_ticks": Line("ticks that the recorder lost", 0),
    "lost_samples": Line("samples that the recorder lost", 0),
    "lost_events": Line("events that the recorder lost", 0),
}
"""By the name of the attribute in a session's /summary, in the table's order."""


def session_rows(figures: Mapping[str, Any]) -> tuple[SummaryRow, ...]:
    """The table of a session's figures, SI units, by the names of `SESSION_LINES`.

    What was never the case (fingers free for a reason that never came) has no line.
    """
    rows = []
    for name, line in SESSION_LINES.items():
        if name not in figures or (name.startswith("kept_free_") and not figures[name]):
            continue
        value = float(figures[name])
        told = shown(value / line.scale if math.isfinite(value) else math.nan, line)
        rows.append(SummaryRow(name, line.label, value, told, line.unit))
    return tuple(rows)
