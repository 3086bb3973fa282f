"""Figures that the gate takes from a result and that a suite can limit: errors, work counters, time, and inputs.

Errors that need no solver are computed anew from the stored poses and forces, so that a stale summary does not pass.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.metrics import metrics, session_faults
from hhsim.metrics.metrics import Penetration
from hhsim.metrics.run.contact import NO_DEPTH
from hhsim.metrics.run.registry import judged_metrics, known_figures, run_metrics, tick_figures
from hhsim.metrics.run.ticks import is_mostly_stuck
from hhsim.metrics.run_metric import Figure, Judged, RunMetric
from hhsim.metrics.run_ticks import PLACED, RunTicks, result_ticks, touched_object
from hhsim.metrics.session_faults import SESSION_FAULTS, SESSION_TIMES
from hhsim.replay.run_inputs import RunInputs, run_inputs, tick_digest
from hhsim.replay.summary_table import default_limits, stored_promises
from hhsim.result.reader import Result
from hhsim.result.schema import CONTACT_COLUMNS, TICK_COLUMNS, Column
from hhsim.solver.method import EVERYTHING, WORK
from hhsim.submissions.score import MESH_DEPTH, OFF_BEST, OFF_BEST_MAX

COUNTERS: dict[str, tuple[str, Figure]] = {
    "node_tests": ("work/node_tests", Figure("node_tests", "tree nodes tested")),
    "pair_tests": ("work/pair_tests", Figure("pair_tests", "exact distances")),
    "qp_iterations": ("work/qp_iterations", Figure("qp_iterations", "QP iterations")),
    "linearisations": ("work/linearisations", Figure("linearisations", "linearisations")),
    "candidates": ("contacts/candidates", Figure("candidates", "candidate pairs")),
    "work_units": ("work/units", Figure("work_units", "work units")),
}
"""Dataset and figure of each counter, the sum over all ticks: exact integers."""

UNITS_OF_WORK = "work/units"
"""Dataset of the only counter of a method from outside."""

OF_SESSIONS = frozenset(figure.name for figure in (*SESSION_TIMES, *SESSION_FAULTS))
"""Figures of recorded sessions only."""
OF_SUBMISSIONS = frozenset(figure.name for figure in (MESH_DEPTH, OFF_BEST, OFF_BEST_MAX))
"""Figures of submissions only."""
SESSION_DEFAULTS = {fault.name: fault.limit for fault in SESSION_FAULTS}
"""Default limits of a session."""
OUTSIDE_DEFAULTS = {"free_off_max": default_limits(("follows_input",))["free_off_max"]}
"""Default limits of a replay by a method from outside, which does not report stuck ticks."""


def _depth(run: RunTicks, finger: int, mean: bool) -> float:
    """Largest or mean depth of a finger, or of the palm (-1), in all ticks [m]; NaN for one that is not modelled."""
    depth = run["penetration_palm"] if finger < 0 else run["penetration_finger"][:, finger]
    depth = depth[~np.isnan(depth)]
    return float(np.mean(depth) if mean else np.max(depth)) if depth.size else np.nan


PART_DEPTHS = {
    (name := f"penetration_{part}_{of}"): RunMetric(
        *(name, f"penetration, {part}, {of}", 3, "µm"),
        compute=partial(_depth, finger=finger, mean=of == "mean"),
        judged=Judged(rounding=1e-9, growth=NO_DEPTH),
    )
    for finger, part in enumerate(("palm", *FINGERS), -1)
    for of in ("max", "mean")
}
"""Figures of palm and fingers by name: a deeper palm does not hide a finger's depth."""


def limitable() -> dict[str, Figure]:
    """Return every figure that can have a limit, by name."""
    more = (*SESSION_TIMES, *SESSION_FAULTS, MESH_DEPTH, OFF_BEST, OFF_BEST_MAX)
    return {**run_metrics(), **PART_DEPTHS, **{figure.name: figure for figure in more}}


def compared_metrics() -> dict[str, RunMetric]:
    """Return every figure that has a verdict against the base, by name."""
    return {**judged_metrics(), **PART_DEPTHS}


def without_times(limits: Mapping[str, float]) -> dict[str, float]:
    """Return the limits without those of times, which depend on the machine."""
    times = {name for name, metric in run_metrics().items() if metric.noise} | {time.name for time in SESSION_TIMES}
    return {name: limit for name, limit in limits.items() if name not in times}


@dataclass(frozen=True)
class RunFigures:
    """Figures of one run."""

    inputs: RunInputs  # inputs of the run
    # figures of `compared_metrics` that its method gives; NaN where undefined
    errors: dict[str, float]
    counters: dict[str, int]  # figures of `COUNTERS` that its method gives
    # figures of `limitable` judged only by a suite's limits, SI or %; NaN where undefined
    others: dict[str, float] = field(default_factory=dict)
    mostly_stuck: bool = False  # True if more than half of its ticks are stuck, which no suite allows
    promises: frozenset[str] = frozenset()  # promises of its method, of `hhsim.solver.method.PROMISES`
    suspicions: tuple[str, ...] = ()  # probable mistakes of a submission, a line each
    digest: str = ""  # of poses and forces, `hhsim.replay.run_inputs.tick_digest`; "" where a baseline has none
    unsound: str = ""  # datasets that hold what is no number, in words; "" for none


def run_figures(result: Result) -> RunFigures:
    """Compute a result's figures from its ticks; InputError for an invalid tree, or a dataset not in its schema."""
    inputs, digest = run_inputs(result), tick_digest(result)
    unsound, result = _not_finite(result), result.seen_from_object
    gives = {what for what in EVERYTHING if result.gives(what)}
    known = _known_columns(result)
    # The number of near pairs follows from the pose; it is work only for hhsim's methods.
    own = known.keys() if WORK in gives else known.keys() & {UNITS_OF_WORK}
    counters = {name: int(np.sum(result[dataset])) for name, (dataset, _) in COUNTERS.items() if dataset in own}
    told = known_figures(gives) if result.live is None else known_figures(gives) | OF_SESSIONS
    ticks, judged = result_ticks(result, _ComputedAnew(result)), compared_metrics()
    computed = tick_figures(ticks) | {
        name: depth.compute(ticks) for name, depth in PART_DEPTHS.items() if depth.compute
    }
    told |= PART_DEPTHS.keys()
    stored = {name: float(result.summary.get(name, np.nan)) for name in told if name not in computed}
    found = stored | {name: value for name, value in computed.items() if name in told}
    errors = {name: found[name] for name in judged if name in found}
    others = {name: value for name, value in found.items() if name not in judged}
    others |= {name: float(value) for name, value in result.score.items() if name in OF_SUBMISSIONS}
    if result.live is not None:
        others |= session_faults.recorded_faults(result).figures
    stuck = is_mostly_stuck(errors.get("stuck_ticks", 0.0), result.ticks)
    suspicions = tuple(map(str, result.scene.get("submission", {}).get("suspicions", ())))
    of_run = inputs, errors, counters, others, stuck, stored_promises(result.scene), suspicions
    return RunFigures(*of_run, digest=digest, unsound=unsound)


def _known_columns(result: Result) -> dict[str, Column]:
    """The hand's columns that the method gives, by name."""
    return {column.name: column for column in TICK_COLUMNS if not column.known_by or result.gives(column.known_by)}


def _not_finite(result: Result) -> str:
    """Return in words which datasets hold what is no number, though a run's are finite; "" for none."""
    found = {name: (column, result[name]) for name, column in _known_columns(result).items()}
    for body in result.bodies.values():
        found |= {f"{body.group}/{column.name}": (column, body[column.name]) for column in body.columns}
    if result.body.is_free:
        found |= {(name := f"contact/{column.name}"): (column, result[name]) for column in CONTACT_COLUMNS}
    sure = ((name, values) for name, (column, values) in found.items() if not column.may_be_undefined)
    wrong = [name for name, values in sure if not np.isfinite(values).all()]
    return f"not finite: {', '.join(sorted(wrong))}" if wrong else ""


def cpu_p50(result: Result) -> float:
    """Median CPU time of the ticks in contact, of all ticks without contact [s]."""
    contact = result["contacts/candidates"] > 0
    cpu = result["duration/total_cpu"]
    return float(np.median(cpu[contact] if contact.any() else cpu)) * 1e-9


class _ComputedAnew:
    """Datasets of a result, with those that follow from poses and forces computed anew."""

    def __init__(self, result: Result) -> None:
        self._result = result

    def __getitem__(self, name: str) -> AnyArray:
        stored = self._result[name]
        if name == "force_variation_rate":
            return metrics.force_variation_rate(self._result["force/total"])
        part = name.removeprefix("penetration_")
        if part == name:
            return stored
        deepest = np.maximum(stored, getattr(self._depths, part))
        # A pose that is not finite does not pass as free; a finger that is not modelled has no depth.
        counts = [finger in self._result.fingers for finger in FINGERS] if part == "finger" else True
        return np.where(np.isnan(deepest) & counts, np.inf, deepest)

    @cached_property
    def _depths(self) -> Penetration:
        """Depths [m] of the stored graphic hand in the surface that it touched."""
        return touched_object(self._result).penetration(PlacedHand(*(self._result[name] for name in PLACED)))
