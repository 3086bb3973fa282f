"""The table at the top of a report: the figures that a run is judged by, of all its results."""

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
"""The run metrics that may stand in each column, with their short headings: the first of those that most results
have."""
SHOWN_WORDS = (BETTER, WORSE, WITHIN, NOT_COMPARABLE)
"""Words that stand below a figure; where both are the same there is nothing to say."""


def key_table(runs: Sequence[ReportRun], comparisons: Sequence[Comparison]) -> Table:
    """A line for each result; of the others than the first each figure has a word where it is better or worse.

    Args:
        comparisons: Of each but the first one with the first one.
    """
    figures = {name: names[name] for names in KEY_FIGURES if (name := _chosen(runs, tuple(names)))}
    headings = ["result", "verdict", *(_heading(runs, name, heading) for name, heading in figures.items())]
    rows = []
    for run, comparison in zip(runs, (None, *comparisons)):
        cells = (_cell(run, name, runs[0], comparison) for name in figures)
        rows.append([run.label, _verdict(run, tuple(figures)), *cells])
    caption = (
        "Key figures. Times are CPU times of ticks in contact. Red: over the limit that hhsim gate has by default."
    )
    if len(runs) > 1:
        caption += f" Below a figure: beside that of {runs[0].letter}, where both were fed with the same."
    return Table.of_cells(headings, rows, caption, numbers=headings[2:])


def _heading(runs: Sequence[ReportRun], name: str, heading: str) -> str:
    row = next(row for run in runs if (row := run.row(name)) is not None)
    return f"{heading} [{row.unit}]" if row.unit else heading


def _verdict(run: ReportRun, shown: Sequence[str]) -> Marked:
    """The word, and below it the figures over their limits that have no column to be red in."""
    rows = [row for name in run.verdict.missed if name not in shown and (row := run.row(name)) is not None]
    missed = (f"{row.label} {row.shown} {row.unit}".strip() for row in rows)
    return Marked(run.verdict.word, run.mood, "; ".join(missed))


def _cell(run: ReportRun, name: str, first: ReportRun, comparison: Comparison | None) -> str:
    row, base = run.row(name), first.row(name)
    if row is None:
        return MISSING
    word = "" if comparison is None or base is None else compared(base, row, comparison).word
    return Marked(row.shown, "bad" if name in run.verdict.missed else "", word if word in SHOWN_WORDS else "")


def _chosen(runs: Sequence[ReportRun], names: Sequence[str]) -> str:
    having = {name: sum(_known(run, name) for run in runs) for name in names}
    return next((name for name in names if having[name] == max(having.values()) > 0), "")


def _known(run: ReportRun, name: str) -> bool:
    row = run.row(name)
    return row is not None and math.isfinite(row.value)
