"""Figures of the field, the `METRICS` of each module of this package, and their table before and after a repair."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import hhsim.metrics.field
from hhsim.metrics.field.hands import FieldMetric, FieldPair
from hhsim.metrics.run_metric import declared_figures
from hhsim.table.table import Table, number, words


@cache
def field_metrics() -> dict[str, FieldMetric]:
    """Return every figure by its name, in the order of the table; ValueError if two have one name."""
    return declared_figures(hhsim.metrics.field)


@dataclass(frozen=True)
class FieldRow:
    """One row: a figure, its values before and after (SI or %, NaN where undefined), and its parameters."""

    figure: FieldMetric
    before: float
    after: float
    parameters: str

    @property
    def name(self) -> str:
        """Key in JSON."""
        return self.figure.name

    def to_json(self) -> dict[str, Any]:
        """Return the row in stored units, None where a value is undefined."""
        values = {"before": self.before, "after": self.after}
        known: dict[str, Any] = {key: None if math.isnan(value) else value for key, value in values.items()}
        return known | {"unit": self.figure.stored_unit, "parameters": self.parameters}


def field_rows(pair: FieldPair) -> tuple[FieldRow, ...]:
    """Compute every figure that is defined for one of the two hands, in the order of the table."""
    rows = []
    for metric in field_metrics().values():
        before, after = metric.compute(pair)
        if not (math.isnan(before) and math.isnan(after)):
            stated = metric.parameters if isinstance(metric.parameters, str) else metric.parameters(pair)
            rows.append(FieldRow(metric, before, after, stated))
    return tuple(rows)


def field_table(rows: Sequence[FieldRow], title: str = "", doubts: Sequence[str] = ()) -> Table:
    """Return rows as a table: figure, before, after, unit and parameters; doubts about the object stand above them."""
    columns = [
        words("figure", "figure.label"),
        number("before", lambda row: row.figure.shown(row.before)),
        number("after", lambda row: row.figure.shown(row.after)),
        words("unit", "figure.unit"),
        words("parameters"),
    ]
    unknown = math.nan, math.nan
    doubted = FieldMetric("object", "the object is in doubt", compute=lambda _: unknown)
    first = [FieldRow(doubted, *unknown, doubt) for doubt in doubts]
    return Table(columns, [*first, *rows], title)


def to_json(rows: Sequence[FieldRow]) -> dict[str, dict[str, Any]]:
    """Return rows by the names of their figures, as `FieldRow.to_json`."""
    return {row.name: row.to_json() for row in rows}
