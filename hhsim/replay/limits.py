"""Default limits of a run: one for each figure, the same for every method."""

from collections.abc import Collection, Mapping
from typing import Any

from hhsim.metrics.run.registry import judged_metrics
from hhsim.solver.method import METHODS, PROMISES


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
