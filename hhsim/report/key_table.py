"""Table at the top of a report: the figures that a run is judged by."""

import math
from collections.abc import Mapping, Sequence

from hhsim.gate.time_comparison import BETTER, NOT_COMPARABLE, WITHIN, WORSE
from hhsim.metrics.run.force import TREMBLING
from hhsim.report.compare import Comparison, compared
from hhsim.report.run import ReportRun
from hhsim.table.table import MISSING, Marked, Table

KEY_FIGURES: Sequence[Mapping[str, str]] = (
    {"penetration_max": "depth, max"},
    {"contact_error_max": "off the mesh, max"},
    {"force_contact_mean": "force, mean", "force_hold_mean": "force in the hold, mean"},
    {"force_contact_step": "force step", "force_step": "force step, moving"},
    {
        TREMBLING: "variation, trembling",
        "force_variation_contact": "variation in contact",
        "force_variation_hold": "variation in the hold",
    },
    {"tick_cpu_p50": "tick, p50"},
    {"tick_cpu_p99": "tick, p99"},
    {"stuck_ticks": "stuck ticks"},
    {"lag_max": "lag, max"},
)
"""Run metrics that may stand in each column, with short headings: the first that most results have is shown."""
SHOWN_WORDS = (BETTER, WORSE, WITHIN, NOT_COMPARABLE)
"""Words that stand below a figure."""


def key_table(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Table:
    """Return a line for each result; `comparisons` are those of each result but the first with the first."""
    headings: dict[str, str] = {}
    for names in KEY_FIGURES:
        rows = {name: [row for run in runs if (row := run.row(name)) is not None] for name in names}
        known = {name: sum(math.isfinite(row.value) for row in found) for name, found in rows.items()}
        name = max(known, key=lambda name: known[name])
        if known[name]:
            unit = rows[name][0].unit
            headings[name] = f"{names[name]} [{unit}]" if unit else names[name]
    lines = []
    for run, comparison in zip(runs, (None, *comparisons)):
        # Below the verdict stand the figures over their limits that have no column.
        others = (row for name in run.verdict.missed if name not in headings and (row := run.row(name)) is not None)
        missed = "; ".join(f"{row.label} {row.shown} {row.unit}".strip() for row in others)
        cells = (_cell(run, name, runs[0], comparison) for name in headings)
        lines.append([run.label, Marked(run.verdict.word, run.mood, missed), *cells])
    caption = (
        "Key figures. Times are CPU times of ticks in contact. Red: over the limit that hhsim gate has by default."
    )
    if len(runs) > 1:
        caption += f" Below a figure: beside that of {runs[0].letter}, where both were fed with the same."
    return Table.of_cells(["result", "verdict", *headings.values()], lines, caption, numbers=list(headings.values()))


def _cell(run: ReportRun, name: str, first: ReportRun, comparison: Comparison | None) -> str:
    row, base = run.row(name), first.row(name)
    if row is None:
        return MISSING
    word = "" if comparison is None or base is None else compared(base, row, comparison).word
    return Marked(row.shown, "bad" if name in run.verdict.missed else "", word if word in SHOWN_WORDS else "")
