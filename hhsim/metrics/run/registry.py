"""Registry of every figure of a run: the `METRICS` of each module of this package."""

import importlib
import pkgutil
from collections.abc import Collection
from functools import cache

import hhsim.metrics.run
from hhsim.metrics.run_metric import RunMetric
from hhsim.metrics.run_ticks import RunTicks
from hhsim.result.schema import TICK_COLUMNS


@cache
def run_metrics() -> dict[str, RunMetric]:
    """Return every figure by its name, in the order of the table; ValueError for one declared twice or in part."""
    package = hhsim.metrics.run
    names = [module.name for module in pkgutil.iter_modules(package.__path__)]
    found: list[RunMetric] = []
    for name in (*package.ORDER, *(name for name in names if name not in package.ORDER)):
        found += getattr(importlib.import_module(f"{package.__name__}.{name}"), "METRICS", ())
    metrics = {metric.name: metric for metric in found}
    if len(metrics) < len(found):
        raise ValueError(f"two figures of one name among {sorted(metric.name for metric in found)}")
    strange = [metric.name for metric in metrics.values() if (metric.compute is None) != bool(metric.own_run)]
    if strange:
        raise ValueError(f"run metrics with both or neither of compute and own_run: {strange}")
    return metrics


def needed_columns() -> tuple[str, ...]:
    """Datasets of /tick that the figures are computed from."""
    return tuple(dict.fromkeys(name for metric in run_metrics().values() for name in metric.needs))


def known_figures(gives: Collection[str]) -> set[str]:
    """Names of the figures of a method that `gives` some of `hhsim.solver.method.EVERYTHING`."""
    by = {column.name: column.known_by for column in TICK_COLUMNS}
    return {
        name
        for name, metric in run_metrics().items()
        if all(by.get(needed, "") in ("", *gives) for needed in metric.needs)
    }


def tick_figures(run: RunTicks, but: Collection[str] = ()) -> dict[str, float]:
    """Compute every figure that follows from the ticks, `but` some, by name; SI units, or % where it is defined so."""
    return {
        name: float(metric.compute(run))
        for name, metric in run_metrics().items()
        if metric.compute is not None and name not in but and not (metric.free_only and run.free is None)
    }


def run_figure(name: str, run: RunTicks) -> float:
    """Compute one figure that follows from the ticks; as `tick_figures`."""
    compute = run_metrics()[name].compute
    if compute is None:
        raise ValueError(f"{name} does not follow from the ticks")
    return float(compute(run))


def judged_metrics() -> dict[str, RunMetric]:
    """Return the figures that the gate judges, by name."""
    return {name: metric for name, metric in run_metrics().items() if metric.judged is not None}
