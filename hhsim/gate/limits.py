"""Figures that a suite can limit: those of a run, of a live session, and of a submission."""

from collections.abc import Mapping

from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_metric import Figure
from hhsim.metrics.session_faults import SESSION_FAULTS, SESSION_TIMES
from hhsim.replay.limits import default_limits
from hhsim.submissions.pose_errors import MESH_DEPTH, OFF_BEST, OFF_BEST_MAX

OF_SESSIONS = frozenset(figure.name for figure in (*SESSION_TIMES, *SESSION_FAULTS))
"""Figures of recorded sessions only."""
OF_SUBMISSIONS = frozenset(figure.name for figure in (MESH_DEPTH, OFF_BEST, OFF_BEST_MAX))
"""Figures of submissions only."""
OF_MISHAPS = ("ended_early", "faults")
"""Figures of a session whose cause its file states in words."""
SESSION_DEFAULTS = {fault.name: fault.limit for fault in SESSION_FAULTS}
"""Default limits of a session."""
OUTSIDE_DEFAULTS = {"free_off_max": default_limits(("follows_input",))["free_off_max"]}
"""Default limits of a replay by a method from outside, which does not report stuck ticks."""


def limitable() -> dict[str, Figure]:
    """Return every figure that can have a limit, by name."""
    more = (*SESSION_TIMES, *SESSION_FAULTS, MESH_DEPTH, OFF_BEST, OFF_BEST_MAX)
    return {**run_metrics(), **{figure.name: figure for figure in more}}


def without_times(limits: Mapping[str, float]) -> dict[str, float]:
    """Return the limits without those of times, which depend on the machine."""
    times = {name for name, metric in run_metrics().items() if metric.noise} | {time.name for time in SESSION_TIMES}
    return {name: limit for name, limit in limits.items() if name not in times}
