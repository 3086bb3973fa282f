"""The limits that a run is held to where a project sets none: one for each figure, the same for every method."""

from collections.abc import Collection, Mapping
from typing import Any

from hhsim.metrics.run.registry import judged_metrics
from hhsim.solver.method import METHODS, PROMISES


def stored_promises(scene: Mapping[str, Any]) -> frozenset[str]:
    """Return what the method of a run promises, of `hhsim.solver.method.PROMISES`, by its file alone.

    The file of a method from outside says it, so that the verdict does not depend on what is installed. A method that
    neither this hhsim nor the file knows is held to everything.

    Args:
        scene: Of the result.
    """
    name = str(scene.get("solver", {}).get("method", ""))
    if name in METHODS:
        return METHODS[name].promises
    return frozenset(map(str, scene.get("promises", PROMISES)))


def promised(figure: str, promises: Collection[str]) -> bool:
    """Return whether a method with these promises is held to a figure's default limit at all."""
    metric = judged_metrics().get(figure)
    return metric is None or metric.judged is None or metric.judged.promise in ("", *promises)


def default_limits(promises: Collection[str]) -> dict[str, float]:
    """Largest value of each figure that has a limit and that a method promises, by name [SI, or %]."""
    return {
        name: metric.judged.limit
        for name, metric in judged_metrics().items()
        if metric.judged is not None and metric.judged.limit is not None and promised(name, promises)
    }
