"""The figures that a suite can limit: all of a run, and the times of a live session."""

from collections.abc import Mapping

from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_metric import Figure
from hhsim.metrics.session_times import SESSION_TIMES

OF_SESSIONS = frozenset(figure.name for figure in SESSION_TIMES)
"""Only a recorded session has them: no scene of a suite does."""


def limitable() -> dict[str, Figure]:
    """Every figure that can have a limit, by name."""
    return {**run_metrics(), **{figure.name: figure for figure in SESSION_TIMES}}


def without_times(limits: Mapping[str, float]) -> dict[str, float]:
    """The limits of what is the same on every machine."""
    exact = {name for name, metric in run_metrics().items() if metric.noise == 0.0}
    return {name: limit for name, limit in limits.items() if name in exact}
