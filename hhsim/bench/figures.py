"""Figures of suites: each is a column of a table, and knows what sums it up over runs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from hhsim.metrics.metrics import statistics
from hhsim.metrics.run.registry import run_metrics
from hhsim.table.table import Column

Total = Callable[[Sequence[Any]], Any]


class Figure(NamedTuple):
    """Figure of a run: its column, and what sums it up over runs."""

    column: Column
    total: Total


def figure(name: str, says: str, unit: str, total: Total) -> Figure:
    """Return a figure by its name, meaning, and shown unit."""
    return Figure(Column(name, says, unit), total)


def metric(name: str, total: Total) -> Figure:
    """Return a figure of a replay's table, by its name there."""
    shown = run_metrics()[name]
    return Figure(Column(name, shown.label, shown.unit), total)


def summed(figures: Sequence[Figure], runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what the figures of several runs sum up to, NaN for one that a run does not have."""
    nan = float("nan")
    return {one.column.name: one.total([run.get(one.column.name, nan) for run in runs]) for one in figures}


def mean(values: ArrayLike) -> float:
    """Return the mean of the values that are not NaN; NaN without any."""
    return statistics(values).mean


def worst(values: ArrayLike) -> float:
    """Return the largest of the values that are not NaN; NaN without any."""
    return statistics(values).max
