"""The rows of the table that `hhsim replay` prints, of a run that has just ended or as its file holds them."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_metric import PAPER_RATE, Figure
from hhsim.replay.limits import promised
from hhsim.table.table import Table, number, words


@dataclass(frozen=True)
class SummaryRow:
    """One line of the table.

    Attributes:
        figure: Whose line it is.
        value: In SI units, or % where the figure is defined so; NaN where it is undefined.
        paper: The paper's figure as printed there, or "".
    """

    figure: Figure
    value: float
    paper: str = ""

    @property
    def name(self) -> str:
        """Of the attribute in the result file and the JSON document."""
        return self.figure.name

    @property
    def label(self) -> str:
        """For people."""
        return self.figure.label

    @property
    def shown(self) -> str:
        """The value as the table shows it."""
        return self.figure.shown(self.value)

    @property
    def unit(self) -> str:
        """Of `shown`."""
        return self.figure.unit

    def limit(self, promises: Collection[str]) -> str:
        """Return the default limit in `unit`; "not promised" where a method is not held to it; "" where there is none.

        Args:
            promises: What the method promises, of `hhsim.solver.method.PROMISES`.
        """
        metric = run_metrics().get(self.name)
        if metric is None or metric.judged is None or metric.judged.limit is None:
            return ""
        if not promised(self.name, promises):
            return "not promised"
        return f"{metric.judged.limit / self.figure.scale:g}"


def figure_table(
    rows: Sequence[SummaryRow], title: str = "", *, name: str = "", promises: Collection[str] | None = None
) -> Table:
    """Return figures as a table: label, value, unit, and the paper's figure where there is one.

    Args:
        rows: Of the table, one a figure.
        title: Of the table.
        name: Heading of the labels.
        promises: As of `SummaryRow.limit`, where the default limits are to stand beside.
    """
    columns = [words(name, "label"), number("hhsim", "shown"), words("unit")]
    if promises is not None:
        columns.append(number("limit", lambda row: row.limit(promises)))
    if any(row.paper for row in rows):
        columns.append(number("paper"))
    return Table(columns, rows, title)


def summary_rows(figures: Mapping[str, float], rate: float, *, of_paper: bool = False) -> tuple[SummaryRow, ...]:
    """The table of figures; those that are no run metric are left out.

    Args:
        figures: By name; SI units, or % where they are defined so.
        rate: Ticks per second [Hz].
        of_paper: Whether the scene is one of the paper's, so that its figures have a place beside ours.
    """
    trembling = TREMBLING in figures
    rows = []
    for name, metric in run_metrics().items():
        if name in figures and not (trembling and metric.moving_hold_only):
            figure = metric if trembling or metric.moving_hold is None else metric.moving_hold
            paper = figure.paper if of_paper and not (metric.per_tick and rate != PAPER_RATE) else ""
            rows.append(SummaryRow(figure, float(figures[name]), paper))
    return tuple(rows)


def stored_rows(summary: Mapping[str, Any], rate: float, *, of_paper: bool = False) -> tuple[SummaryRow, ...]:
    """The table of a result's summary, as its replay printed it."""
    found = {name: float(summary[name]) for name in run_metrics() if name in summary}
    return summary_rows(found, rate, of_paper=of_paper)


def whole_table(rows: Sequence[SummaryRow]) -> tuple[SummaryRow, ...]:
    """Every line that says something: without the largest of what never happened."""
    return tuple(row for row in rows if row.value != 0.0 or not run_metrics()[row.name].unless_zero)


def short_table(rows: Sequence[SummaryRow], missed: Sequence[str] = ()) -> tuple[SummaryRow, ...]:
    """The lines that matter: those of `RunMetric.short`, and what is over its limit.

    Args:
        missed: Names of the figures that are over their limits.
    """
    chosen: dict[str, SummaryRow] = {}
    for row in rows:
        line = run_metrics()[row.name].short
        # An undefined figure stands where no other of its line is defined.
        if line and (line not in chosen or not math.isnan(row.value)):
            chosen[line] = row
    names = {row.name for row in chosen.values()}.union(missed)
    names |= {row.name for row in rows if run_metrics()[row.name].unless_zero and row.value > 0.0}
    return tuple(row for row in whole_table(rows) if row.name in names)
