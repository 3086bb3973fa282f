"""Table and page of the repairs of a manifest: yield, distribution of each figure, worst rows, and all rows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import quote

import numpy as np

from hhsim import __version__
from hhsim.arrays import FloatArray
from hhsim.metrics.field.field_table import field_metrics
from hhsim.repair.request import REPORT
from hhsim.sweep.repair_manifest import PlannedRepair, RowOutcome
from hhsim.system.counted import counted
from hhsim.table.html import render
from hhsim.table.table import MISSING, Column, Marked, Table, number, shown, unit_size, words

WORST = 10
"""Number of rows of each list of the worst."""
RANKINGS = (
    ("depth_cones_max_after", "Deepest after the repair", 1.0),
    ("correction_max_after", "Largest correction", 1.0),
    ("contacts_kept_5mm_after", "Most contacts lost", -1.0),
)
"""Figure of each list of the worst, its heading, and 1 if large values are bad, -1 if small ones are."""
BRIEF = {
    "PD before": ("depth_skin_max_before", "depth_cones_max_before"),
    "PD after": ("depth_skin_max_after", "depth_cones_max_after"),
    "kept, 5 mm": ("contacts_kept_5mm_after",),
    "ACC ratio": ("acceleration_ratio_after",),
    "MPJPE": ("mpjpe_after",),
    "correction": ("correction_max_after",),
    "a frame": ("time_per_frame",),
}
"""Columns of the table in a terminal: each has the first of these figures that a row has."""
STATES = {
    "repaired": "within all limits",
    "missed": "repaired, but a limit is missed",
    "refused": "a recording that cannot be read or used",
    "failed": "for another reason",
}
MOODS = {"repaired": "good", "missed": "note", "refused": "bad", "failed": "bad"}
LOOKS = {"time_per_frame": Column("CPU time a frame", unit="ms", digits=1)}
"""Columns of figures that are none of the field (`field_metrics`); any other has its own name, and no unit."""


@dataclass(frozen=True)
class RepairedRow:
    """Row of the manifest with its outcome."""

    planned: PlannedRepair
    outcome: RowOutcome

    @property
    def name(self) -> str:
        """Name of the row."""
        return self.planned.name

    def figure(self, name: str) -> float:
        """Return a figure, SI; NaN if it has none of that name."""
        found = self.outcome.figures.get(name)
        return float("nan") if found is None else found


def repair_table(rows: Sequence[RepairedRow]) -> Table:
    """Return the table of all rows in their order; its figures are all that any row has, by their names."""
    return Table(
        [
            words("name"),
            words("state", "outcome.state"),
            words("recording", lambda row: row.planned.request.recording.name),
            words("object", lambda row: row.planned.request.object.replace("\\", "/").rpartition("/")[2]),
            number("frames", "outcome.frames"),
            number("marked", lambda row: len(row.outcome.marked)),
            words("doubt", lambda row: "; ".join(row.outcome.doubts)),
            *(_column(name, name) for name in _figure_names(rows)),
            words("reason", "outcome.reason"),
        ],
        rows,
        "All recordings",
    )


def brief_table(rows: Sequence[RepairedRow]) -> Table:
    """Return the table of all rows that a terminal has room for."""
    known = _figure_names(rows)

    def column(called: str, names: tuple[str, ...]) -> Column:
        def value(row: RepairedRow) -> float | None:
            return next((found for name in names if (found := row.outcome.figures.get(name)) is not None), None)

        return replace(_column(names[0], called), of=value)

    figures = [column(called, names) for called, names in BRIEF.items() if any(name in known for name in names)]
    counts = number("frames", "outcome.frames"), number("marked", lambda row: len(row.outcome.marked))
    return Table(
        [words("name"), words("state", "outcome.state"), *counts, *figures, words("reason", "outcome.reason")],
        rows,
        "All recordings",
    )


def repair_page(rows: Sequence[RepairedRow], table: Table, manifest: str) -> str:
    """Return the HTML page of the rows and their table; `manifest` is the name of its file."""
    names, good = _figure_names(rows), sum(row.outcome.state == "repaired" for row in rows)
    rankings = [(heading, _ranking(rows, name, sign)) for name, heading, sign in RANKINGS if name in names]
    kept = [replace(column, name=_look(column.name).name) for column in table.columns]
    kept[:2] = [words("name", _linked), words("state", lambda row: Marked(row.outcome.state, MOODS[row.outcome.state]))]
    return render(
        "sweep/repair_page.html",
        title=f"Repair of {counted(len(rows), 'recording')}",
        generator="hhsim repair",
        version=__version__,
        manifest=manifest,
        sentence=f"{good:,} of {counted(len(rows), 'recording')} repaired within all limits.",
        mood="good" if good == len(rows) else "bad",
        shares=_shares(rows),
        spread=_spread(rows, names),
        rankings=rankings,
        table=replace(table, columns=kept),
    )


def _figure_names(rows: Sequence[RepairedRow]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.outcome.figures))


def _look(name: str) -> Column:
    """Return the column of a figure, by its name with or without _before or _after."""
    base, _, when = name.rpartition("_")
    metric = field_metrics().get(base if when in ("before", "after") else name)
    if metric is None:
        return LOOKS.get(name, Column(name.replace("_", " ")))
    label = f"{metric.label} {when}" if metric.name == base else metric.label
    return Column(label, unit=metric.unit, digits=metric.digits)


def _column(name: str, called: str = "") -> Column:
    look = _look(name)
    return replace(look, name=called or look.name, of=lambda row: row.outcome.figures.get(name))


def _linked(row: RepairedRow) -> str:
    """Return the name of a row, which leads to its report if it has one."""
    from markupsafe import Markup

    report = row.planned.request.beside(REPORT)
    if not report.is_file():
        return row.name
    return Markup('<a href="{}/{}">{}</a>').format(quote(row.name), quote(report.name), row.name)


def _shares(rows: Sequence[RepairedRow]) -> Table:
    counts = {state: sum(row.outcome.state == state for row in rows) for state in STATES}
    lines = [("imported", "repaired, within the limits or not", counts["repaired"] + counts["missed"])]
    lines += [(state, says, counts[state]) for state, says in STATES.items()]
    cells = [(f"{name}: {says}", f"{count:,}", f"{100.0 * count / len(rows):.1f} %") for name, says, count in lines]
    return Table.of_cells(("outcome", "recordings", "share"), cells, "Yield", numbers=("recordings", "share"))


def _spread(rows: Sequence[RepairedRow], names: Sequence[str]) -> Table:
    headings = ("figure", "recordings", "least", "median", "mean", "p90", "largest")
    marks: Sequence[Callable[[FloatArray], Any]] = (
        np.min, np.median, np.mean, lambda values: np.quantile(values, 0.9), np.max,
    )  # fmt: skip
    cells = []
    for name in names:
        every, digits = np.array([row.figure(name) for row in rows]) / unit_size(_look(name).unit), _look(name).digits
        values = every[np.isfinite(every)]
        found = [shown(float(mark(values)), digits) if len(values) else MISSING for mark in marks]
        cells.append((_look(name).heading, f"{len(values):,}", *found))
    return Table.of_cells(headings, cells, "Figures over all recordings", numbers=headings[1:])


def _ranking(rows: Sequence[RepairedRow], name: str, sign: float) -> Table:
    """Return the worst rows by a figure, the worst first."""
    known = [row for row in rows if np.isfinite(row.figure(name))]
    worst = sorted(known, key=lambda row: -sign * row.figure(name))[:WORST]
    return Table([words("name", _linked), _column(name)], worst, "Worst first")
