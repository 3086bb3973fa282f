"""Figures as fields of a dataclass: each is a column of a table, and knows what sums it up over runs."""

from collections.abc import Callable, Sequence
from dataclasses import MISSING, field, fields
from typing import Any

from numpy.typing import ArrayLike

from hhsim.metrics.metrics import statistics
from hhsim.metrics.run.registry import run_figure, run_metrics
from hhsim.metrics.run_ticks import RunTicks
from hhsim.system.log_histogram import LogHistogram
from hhsim.table.table import Column

Total = Callable[[Sequence[Any]], Any]


def metric_column(metric: str, name: str = "", of: str | Callable[[Any], Any] = "") -> Column:
    """Return the column of a run metric, with its label and unit; `name` and `of` as of `Column`."""
    shown = run_metrics()[metric]
    return Column(name or metric, shown.label, shown.unit, of)


def mean(values: ArrayLike) -> float:
    """Return the mean of the values that are not NaN; NaN without any."""
    return statistics(values).mean


def worst(values: ArrayLike) -> float:
    """Return the largest of the values that are not NaN; NaN without any."""
    return statistics(values).max


def figure(says: str, unit: str = "", total: Total | None = None, default: Any = MISSING) -> Any:
    """Return a dataclass field that is a column: what it says, its SI unit, and what sums it up over runs, or None."""
    return field(default=default, metadata={"columns": lambda name: [Column(name, says, unit)], "total": total})


def metric(total: Total, default: Any = MISSING, of: str = "") -> Any:
    """Return a dataclass field that is the column of the run metric `of`, or of its own name."""
    metadata = {"columns": lambda name: [metric_column(of or name, name)], "total": total, "metric": of}
    return field(default=default, metadata=metadata)


def metrics_of(figures: type, run: RunTicks) -> dict[str, Any]:
    """Return the run metrics among the fields of a dataclass that follow from the ticks."""
    metrics = {one: one.metadata["metric"] or one.name for one in fields(figures) if "metric" in one.metadata}
    known = {one: run_figure(name, run) for one, name in metrics.items() if run_metrics()[name].compute}
    return {one.name: int(value) if one.type is int else value for one, value in known.items()}


def cpu_times(tick: str) -> Any:
    """Return the field of the CPU times of some ticks, which are three columns."""
    shares = {"cpu_p50": "median", "cpu_p99": "99th percentile", "cpu_max": "largest"}
    columns = [Column(name, f"CPU time of {tick}, {share}", "µs") for name, share in shares.items()]
    metadata = {"columns": lambda name: columns, "total": LogHistogram.sum}
    return field(default_factory=LogHistogram, repr=False, compare=False, metadata=metadata)


def columns_of(figures: type) -> tuple[Column, ...]:
    """Return the columns of the fields of a dataclass, in their order."""
    declared = (one for one in fields(figures) if one.metadata)
    return tuple(column for one in declared for column in one.metadata["columns"](one.name))


def totals_of(figures: type, runs: Sequence[Any]) -> dict[str, Any]:
    """Return what several runs sum up to, by the names of the fields that do."""
    totals = {one.name: one.metadata.get("total") for one in fields(figures)}
    return {name: total([getattr(run, name) for run in runs]) for name, total in totals.items() if total}
