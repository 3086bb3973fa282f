"""Verdicts: one row for each figure of each scene, and one for all."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hhsim.gate.input_hash import differences, new_options
from hhsim.gate.limits import OF_MISHAPS, limitable
from hhsim.gate.metrics import COUNTERS, RunFigures
from hhsim.gate.timing_test import BETTER, NOT_COMPARABLE, SAME, WITHIN, WORSE, compare_times
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import judged_metrics
from hhsim.replay.limits import promised

ROUNDING = 1e-9
"""Errors that differ by no larger share are the same."""
LOST = "no longer told by the method, and the base has it"
SLIGHT = 1e-3
"""Errors that differ by no larger share differ by noise: last bits that grew."""
EXIT_OK, EXIT_MISSED, EXIT_NOT_COMPARABLE = 0, 1, 3


@dataclass(frozen=True)
class GateRow:
    """One judged figure.

    Attributes:
        scene, kind, name: Which; `kind` is inputs, error, counter, time, or limit of a figure that is judged only where
            the suite limits it.
        label: For people.
        unit: Of the three numbers as `scale` makes them.
        scale: From `unit` to SI.
        head, base, limit: SI, or % where the metric is so; NaN where there is none.
        verdict: One of the words against the base; "" where there is no base.
        passed: False where a limit was missed.
        reason: What a reader should know, or "".
    """

    scene: str
    kind: str
    name: str
    label: str
    unit: str = ""
    scale: float = 1.0
    head: float = math.nan
    base: float = math.nan
    limit: float = math.nan
    verdict: str = ""
    passed: bool = True
    reason: str = ""

    def to_json(self) -> dict[str, Any]:
        """As plain values, SI; what there is none of is None."""
        values = {"head": self.head, "base": self.base, "limit": self.limit}
        numbers = {name: value if math.isfinite(value) else None for name, value in values.items()}
        names = ("scene", "kind", "name", "verdict", "passed", "reason")
        return {**{name: getattr(self, name) for name in names}, **numbers}


def judge_errors(scene: str, head: RunFigures, base: RunFigures | None, limits: Mapping[str, float]) -> list[GateRow]:
    """Errors against absolute limits; what a base had is told beside them and misses nothing.

    What is undefined, such as the force in a hold that the motion does not have, is not judged, unless the base has it.
    """
    rows = []
    method = str(head.inputs.solver.get("method", ""))
    trembling = math.isfinite(head.errors.get(TREMBLING, math.nan))
    for name, metric in judged_metrics().items():
        value = head.errors.get(name, math.nan)
        before = math.nan if base is None else base.errors.get(name, math.nan)
        limit = limits.get(name, math.nan)
        limited = name in limits
        absent = math.isnan(before) and (metric.free_only or name not in head.errors)
        lost = name not in head.errors and not math.isnan(before)
        if math.isnan(value) and (absent or not limited) and not lost:
            continue
        passed, reason = True, ""
        if lost:
            passed, reason = False, LOST
        elif limited and math.isnan(value):
            # What the base had and the head has not is lost, and with it what the limit is for.
            passed = math.isnan(before)
            reason = "undefined here, so not judged" if passed else "undefined here, and the base has it"
        elif limited and not value <= limit:
            passed = False
            reason = "over the limit" if math.isfinite(value) else "not finite"
        elif name == "stuck_ticks" and head.mostly_stuck:
            passed, reason = False, "more than half of the ticks"
        elif not limited and not promised(name, head.promises):
            reason = f"not promised by {method}"
        rounding = max(metric.judged.rounding if metric.judged else 0.0, ROUNDING * abs(before))
        sizes = (abs(value), abs(before)) if metric.signed else (value, before)
        word = _word(*sizes, SLIGHT * abs(before), rounding)
        figure = metric if trembling or metric.moving_hold is None else metric.moving_hold
        shown = figure.label, figure.unit, figure.scale
        rows.append(GateRow(scene, "error", name, *shown, value, before, limit, word, passed, reason))
    return rows


def judge_others(scene: str, head: RunFigures, limits: Mapping[str, float]) -> list[GateRow]:
    """Figures that only the suite's own limits judge; what is undefined is not judged."""
    rows = []
    for name, figure in limitable().items():
        if name not in limits or name not in head.others:
            continue
        value = head.others[name]
        passed = math.isnan(value) or value <= limits[name]
        reason = "undefined here, so not judged" if math.isnan(value) else "" if passed else "over the limit"
        if not passed and name in OF_MISHAPS and head.mishap:
            reason = f"{reason}: {head.mishap}"
        shown = figure.label, figure.unit, figure.scale
        rows.append(GateRow(scene, "limit", name, *shown, value, limit=limits[name], passed=passed, reason=reason))
    return rows


def judge_counters(scene: str, head: RunFigures, base: RunFigures, slack: Mapping[str, float]) -> list[GateRow]:
    """Work counters against those of the base: integers, so that any growth beyond the slack is a real one."""
    rows = []
    for name, (_, figure) in COUNTERS.items():
        if name not in base.counters:
            continue
        shown = figure.label, figure.unit, figure.scale
        if name not in head.counters:
            before = float(base.counters[name])
            rows.append(GateRow(scene, "counter", name, *shown, base=before, passed=False, reason=LOST))
            continue
        value, before = float(head.counters[name]), float(base.counters[name])
        limit = math.floor(before * (1.0 + slack[name]))
        verdict = _word(value, before, limit - before)
        passed = value <= limit
        reason = "" if passed else f"more than {100.0 * slack[name]:g} % above the base"
        rows.append(GateRow(scene, "counter", name, *shown, value, before, limit, verdict, passed, reason))
    return rows


def judge_suspicions(scene: str, head: RunFigures) -> list[GateRow]:
    """Return a missed row of a submission that probably is not what it says; none of any other run."""
    if not head.suspicions:
        return []
    count, reason = float(len(head.suspicions)), "; ".join(head.suspicions)
    return [GateRow(scene, "run", "suspicions", "suspected", head=count, limit=0.0, passed=False, reason=reason)]


def judge_inputs(scene: str, head: RunFigures, base: RunFigures, motion_may_change: bool = False) -> GateRow:
    """Whether two runs can be compared at all.

    Args:
        motion_may_change: Whether another motion is no fault: the run is then judged by its limits alone.
    """
    found = differences(base.inputs, head.inputs, but_the_motion=motion_may_change)
    if not found and differences(base.inputs, head.inputs):
        reason = "another motion than the base's, which may change: judged by limits, not compared"
        return GateRow(scene, "inputs", "inputs", "inputs", reason=reason)
    if found:
        reason = f"different inputs: {'; '.join(found)}"
        return GateRow(scene, "inputs", "inputs", "inputs", verdict=NOT_COMPARABLE, reason=reason)
    apart = new_options(base.inputs, head.inputs)
    reason = f"options that only one side has: {', '.join(apart)}" if apart else ""
    return GateRow(scene, "inputs", "inputs", "inputs", verdict=SAME, reason=reason)


def judge_time(
    scene: str, head: Sequence[float], base: Sequence[float], limit: float, *, divided: bool = False
) -> GateRow:
    """The time of a tick; `divided` by the reference workload, and then without a unit."""
    found = compare_times(base, head, limit)
    passed = found.verdict != WORSE
    reason = f"{100.0 * (found.ratio - 1.0):+.1f} %, processes of a side within {100.0 * found.spread:.0f} %"
    label = "tick in contact, CPU, p50" + (" / reference workload" if divided else "")
    unit, scale = ("", 1.0) if divided else ("µs", 1e-6)
    allowed = found.base * (1.0 + limit)
    figures = found.head, found.base, allowed
    return GateRow(scene, "time", "tick_cpu_p50", label, unit, scale, *figures, found.verdict, passed, reason)


def failed_run(scene: str, reason: str) -> GateRow:
    """A head that cannot even run the scene."""
    return GateRow(scene, "run", "run", "runs to the end", passed=False, reason=reason)


def unjudged(scene: str, what: str, reason: str) -> GateRow:
    """Something that cannot be compared, and why."""
    return GateRow(scene, "inputs", what, what, verdict=NOT_COMPARABLE, reason=reason)


def new_scene(scene: str, reason: str) -> GateRow:
    """A scene that the base cannot run for lack of a file or a method: it is judged by limits alone."""
    return GateRow(scene, "inputs", "inputs", "inputs", reason=f"new, so judged by limits alone: {reason}")


def overall(rows: Sequence[GateRow]) -> tuple[str, int]:
    """Verdict word and exit code of all rows; a missed limit weighs more than what cannot be compared.

    The word is "" where nothing was compared with anything.
    """
    if not all(row.passed for row in rows):
        return WORSE, EXIT_MISSED
    words = {row.verdict for row in rows if row.verdict and row.kind != "error"}
    if NOT_COMPARABLE in words:
        return NOT_COMPARABLE, EXIT_NOT_COMPARABLE
    # What is worse within its limit is noise to the gate; an error within its limit is told in its row alone.
    for word in (BETTER, WORSE, WITHIN):
        if word in words:
            return (BETTER if word == BETTER else WITHIN), EXIT_OK
    return (SAME if words else ""), EXIT_OK


def _word(value: float, before: float, slack: float, rounding: float = 0.0) -> str:
    if math.isnan(before) or math.isnan(value):
        return ""
    if abs(value - before) <= rounding:
        return SAME
    if abs(value - before) <= slack:
        return WITHIN
    return WORSE if value > before else BETTER
