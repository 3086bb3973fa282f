"""The rows of the table that `hhsim replay` prints, of a run that has just ended or as its file holds them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_metric import PAPER_RATE, Figure


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


def summary_rows(figures: Mapping[str, float], rate: float) -> tuple[SummaryRow, ...]:
    """The table of figures; those that are no run metric are left out.

    Args:
        figures: By name; SI units, or % where they are defined so.
        rate: Ticks per second [Hz].
    """
    trembling = TREMBLING in figures
    rows = []
    for name, metric in run_metrics().items():
        if name in figures and not (trembling and metric.moving_hold_only):
            figure = metric if trembling or metric.moving_hold is None else metric.moving_hold
            paper = "" if metric.per_tick and rate != PAPER_RATE else figure.paper
            rows.append(SummaryRow(figure, float(figures[name]), paper))
    return tuple(rows)


def stored_rows(summary: Mapping[str, Any], rate: float) -> tuple[SummaryRow, ...]:
    """The table of a result's summary, as its replay printed it."""
    return summary_rows({name: float(summary[name]) for name in run_metrics() if name in summary}, rate)
