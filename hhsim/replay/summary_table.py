"""Rows of the tables that `hhsim replay` and sessions print, of a run that has just ended or as its file holds them.

A figure has one default limit, the same for every method.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import judged_metrics, run_metrics
from hhsim.metrics.run_metric import Figure
from hhsim.metrics.session_faults import MISSED_BY, SESSION_TIMES
from hhsim.result.safety import WORDS, Safety
from hhsim.solver.method import METHODS, PROMISES
from hhsim.table.table import Table, number, words


@dataclass(frozen=True)
class SummaryRow:
    """One row of the table: a figure, its value (SI, or %; NaN where undefined), and the paper's as printed, or ""."""

    figure: Figure
    value: float
    paper: str = ""

    @property
    def name(self) -> str:
        """Name in the result file and in JSON."""
        return self.figure.name

    @property
    def label(self) -> str:
        """Label in tables."""
        return self.figure.label

    @property
    def shown(self) -> str:
        """Value as the table shows it."""
        return self.figure.shown(self.value)

    @property
    def unit(self) -> str:
        """Unit of `shown`."""
        return self.figure.unit

    def limit(self, promises: Collection[str]) -> str:
        """Return the default limit in `unit`, "not promised" for a method with these promises, or "" without one."""
        metric = run_metrics().get(self.name)
        if metric is None or metric.judged is None or metric.judged.limit is None:
            return ""
        if not promised(self.name, promises):
            return "not promised"
        return f"{metric.judged.limit / self.figure.scale:g}"


def figure_table(
    rows: Sequence[SummaryRow], title: str = "", *, name: str = "", promises: Collection[str] | None = None
) -> Table:
    """Return figures as a table: label (under a heading), value, unit, and the paper's figure where there is one.

    `promises`, as for `SummaryRow.limit`, adds the default limits.
    """
    columns = [words(name, "label"), number("hhsim", "shown"), words("unit")]
    if promises is not None:
        columns.append(number("limit", lambda row: row.limit(promises)))
    if any(row.paper for row in rows):
        columns.append(number("paper"))
    return Table(columns, rows, title)


def hands_table(hands: Mapping[str, Sequence[SummaryRow]], promises: Collection[str]) -> Table:
    """Return the figures of hands that were run together: a column for each, and those of a body once."""
    known = {hand: {row.name: row for row in rows} for hand, rows in hands.items()}
    first = {name: row for rows in reversed(known.values()) for name, row in rows.items()}

    def shown(hand: str, row: SummaryRow) -> str:
        own = known[hand].get(row.name)
        return "" if own is None or (run_metrics()[row.name].of_body and own is not row) else own.shown

    columns = [words("", "label"), *(number(hand, partial(shown, hand)) for hand in hands), words("unit")]
    rows = [first[name] for name in run_metrics() if name in first]
    return Table([*columns, number("limit", lambda row: row.limit(promises))], rows)


def summary_rows(figures: Mapping[str, float], *, of_paper: bool = False) -> tuple[SummaryRow, ...]:
    """Return the rows of figures by name, without those that are no run metric.

    `of_paper` is True if the scene is one of the paper's, whose figures of the same quantities then stand beside.
    """
    trembling = TREMBLING in figures
    rows = []
    for name, metric in run_metrics().items():
        if name in figures and not (trembling and metric.moving_hold_only):
            figure = metric if trembling or metric.moving_hold is None else metric.moving_hold
            paper = figure.paper if of_paper else ""
            rows.append(SummaryRow(figure, float(figures[name]), paper))
    return tuple(rows)


def whole_table(rows: Sequence[SummaryRow]) -> tuple[SummaryRow, ...]:
    """Return every row that says something: without the largest of what never happened."""
    return tuple(row for row in rows if row.value != 0.0 or not run_metrics()[row.name].unless_zero)


def short_table(rows: Sequence[SummaryRow], missed: Sequence[str] = ()) -> tuple[SummaryRow, ...]:
    """Return the important rows: those of `RunMetric.short`, and the missed figures."""
    chosen: dict[str, SummaryRow] = {}
    for row in rows:
        line = run_metrics()[row.name].short
        # An undefined figure stands where no other of its line is defined.
        if line and (line not in chosen or not math.isnan(row.value)):
            chosen[line] = row
    names = {row.name for row in chosen.values()}.union(missed)
    names |= {row.name for row in rows if run_metrics()[row.name].unless_zero and row.value > 0.0}
    return tuple(row for row in whole_table(rows) if row.name in names)


def stored_promises(scene: Mapping[str, Any]) -> frozenset[str]:
    """Return the promises of a run's method, of `hhsim.solver.method.PROMISES`, by its result's scene alone.

    The file of an outside method states them, so that the verdict does not depend on what is installed. An unknown
    method is held to everything.
    """
    name = str(scene.get("solver", {}).get("method", ""))
    if name in METHODS:
        return METHODS[name].promises
    return frozenset(map(str, scene.get("promises", PROMISES)))


def promised(figure: str, promises: Collection[str]) -> bool:
    """Return True if a method with these promises is held to a figure's default limit."""
    metric = judged_metrics().get(figure)
    return metric is None or metric.judged is None or metric.judged.promise in ("", *promises)


def default_limits(promises: Collection[str]) -> dict[str, float]:
    """Return the default limits that hold for a method with these promises, by figure [SI, or %]."""
    return {
        name: metric.judged.limit
        for name, metric in judged_metrics().items()
        if metric.judged is not None and metric.judged.limit is not None and promised(name, promises)
    }


SESSION_FIGURES: tuple[Figure, ...] = (
    Figure("ticks", "ticks with a hand"),
    *(figure for time in SESSION_TIMES for figure in (time, *(MISSED_BY if time.name == "missed" else ()))),
    Figure("ticks_in_contact", "ticks with candidate pairs"),
    run_metrics()["candidates_max"],
    Figure("force_max", "force, most", 2, "N"),
    Figure("ticks_with_resistance", "ticks that resist a finger"),
    *(Figure(f"kept_free_{why.name.lower()}", f"ticks with free fingers: {WORDS[why]}") for why in Safety if why.name),
    run_metrics()["stuck_ticks"],
    run_metrics()["lag_ticks"],
    Figure("samples_used", "samples used"),
    Figure("samples_superseded", "samples that a newer one replaced"),
    run_metrics()["penetration_max"],
    *(Figure(f"lost_{ring}", f"{ring} that the recorder lost") for ring in ("ticks", "samples", "events")),
)
"""Figures of a session's /summary, in the table's order."""


def session_rows(figures: Mapping[str, Any]) -> tuple[SummaryRow, ...]:
    """Return the table rows of a session's figures by name, SI units; reasons and causes with count 0 are left out."""
    return tuple(
        SummaryRow(figure, float(figures[figure.name]))
        for figure in SESSION_FIGURES
        if figure.name in figures and (figures[figure.name] or not figure.name.startswith(("kept_free_", "missed_")))
    )
