"""The lines of the table that `hhsim replay` prints: what each is called, how it is shown, and the paper's figure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

PAPER_RATE = 1000.0
"""Ticks per second of the paper's haptic loop [Hz]."""


class Line(NamedTuple):
    """How a figure is shown.

    Attributes:
        label: For people.
        digits: Behind the point.
        unit: Of what is shown.
        paper: The paper's figure as printed there, or "".
        scale: From what is shown to SI.
        less_is_better: False where more is neither better nor worse.
    """

    label: str
    digits: int
    unit: str = ""
    paper: str = ""
    scale: float = 1.0
    less_is_better: bool = True


LINES: dict[str, Line] = {
    "candidates_max": Line("candidate pairs, most", 0, "", "≈ 250", less_is_better=False),
    "touching_max": Line("touching pairs, most", 0, less_is_better=False),
    "tick_cpu_p50": Line("tick in contact, CPU, p50", 1, "µs", "310 to ≈ 1,000", 1e-6),
    "tick_cpu_p99": Line("tick in contact, CPU, p99", 1, "µs", "< 1,500", 1e-6),
    "tick_cpu_max": Line("tick, CPU, max", 1, "µs", "< 1,500", 1e-6),
    "tick_wall_p50": Line("tick in contact, wall, p50", 1, "µs", "", 1e-6),
    "tick_wall_over_1ms": Line("ticks over 1 ms, wall", 2, "%"),
    "penetration_max": Line("penetration, max", 3, "µm", "≈ 100", 1e-6),
    "force_hold_mean": Line("force in the hold, mean", 2, "N", less_is_better=False),
    "force_variation_hold": Line("force variation in the hold, frozen input", 6, "%"),
    "force_variation_hold_std": Line("force variation in the hold, std", 4, "%", "0.32"),
    "force_variation_tremor": Line("force variation in the hold, trembling hand, mean", 4, "%", "0.18"),
    "force_variation_tremor_std": Line("force variation in the hold, trembling hand, std", 4, "%", "0.32"),
    "force_ripple_hold": Line("force ripple in the hold, 50 to 400 Hz", 5, "N"),
    "force_step": Line("largest force step while moving", 1, "% of hold"),
    "tracking_excess": Line("coupling energy over the local optimum", 3, "%"),
    "tracking_palm": Line("palm off the user's in the hold, mean", 2, "mm", "", 1e-3),
    "fingers_modelled": Line("fingers modelled, of 5", 0, less_is_better=False),
    "bodies_near": Line("bodies near the object in contact, of 16", 1, less_is_better=False),
    "rows_max": Line("contacts in a program, most", 0, less_is_better=False),
    "tests_mean": Line("distances computed a tick, mean", 0),
    "tests_share": Line("share of all pairs of body and sphere", 3, "%"),
    "work_mean": Line("work a tick, mean", 0, "units"),
    "stuck_ticks": Line("stuck ticks", 0),
    "lag_ticks": Line("ticks with lag", 0),
    "lag_max": Line("lag, max", 2, "mm", "", 1e-3),
}
"""By the name of the attribute in the result file, in the table's order."""

MOVING_HOLD = Line("force variation in the hold, mean", 4, "%", "0.18")
"""Of `force_variation_hold` where the input is not frozen: the hold of a live hand, as the paper's."""
PER_TICK = ("force_variation_hold", "force_variation_hold_std", "force_variation_tremor", "force_variation_tremor_std")
"""Changes from tick to tick: they depend on how long a tick is, and the paper's is 1 ms."""


@dataclass(frozen=True)
class SummaryRow:
    """One line of the table.

    Attributes:
        name: Of the attribute in the result file and the JSON document.
        label: For people.
        value: In SI units, or % where the metric is defined so; NaN where it is undefined.
        shown: As the table shows it.
        unit: Of `shown`.
        paper: The paper's figure as printed there, or "".
    """

    name: str
    label: str
    value: float
    shown: str
    unit: str
    paper: str = ""


def summary_rows(figures: Mapping[str, float], rate: float) -> tuple[SummaryRow, ...]:
    """The table of figures in the units that it shows, by name; those that have no line are left out.

    Args:
        figures: By the names of `LINES`; NaN where undefined.
        rate: Ticks per second [Hz].
    """
    lines = LINES
    if "force_variation_tremor" not in figures:
        lines = {**LINES, "force_variation_hold": MOVING_HOLD}
    rows = []
    for name, line in lines.items():
        if name in figures:
            paper = "" if name in PER_TICK and rate != PAPER_RATE else line.paper
            number = float(figures[name])
            rows.append(SummaryRow(name, line.label, number * line.scale, shown(number, line), line.unit, paper))
    return tuple(rows)


def stored_rows(summary: Mapping[str, Any], rate: float) -> tuple[SummaryRow, ...]:
    """The table of a result's summary, SI units, as its replay printed it."""
    figures = {name: float(summary[name]) / line.scale for name, line in LINES.items() if name in summary}
    return summary_rows(figures, rate)


def shown(number: float, line: Line) -> str:
    """A figure, in the unit of its line, as the table shows it; "—" where it is undefined."""
    # Rounded first: what rounds to nothing has no sign.
    return "—" if math.isnan(number) else f"{round(number, line.digits) + 0.0:,.{line.digits}f}"
