"""The limits that a run is held to where a project sets none: one for each figure, the same for every method."""

from hhsim.errors import InputError
from hhsim.metrics.run.registry import judged_metrics
from hhsim.solver.known_methods import find_method


def promised(figure: str, method: str) -> bool:
    """Whether a method is held to a figure's limit at all; one that is not known here is held to every limit."""
    metric = judged_metrics().get(figure)
    if metric is None or metric.judged is None or not metric.judged.promise:
        return True
    try:
        return bool(getattr(find_method(method), metric.judged.promise))
    except InputError:
        return True


def default_limits(method: str) -> dict[str, float]:
    """Largest value of each figure that has a limit and that the method promises, by name [SI, or %]."""
    return {
        name: metric.judged.limit
        for name, metric in judged_metrics().items()
        if metric.judged is not None and metric.judged.limit is not None and promised(name, method)
    }
