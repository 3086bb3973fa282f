"""Verdicts: one row for each figure of each scene, and one for all."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.gate.input_hash import differences, new_options
from hhsim.gate.metrics import COUNTERS, OF_MISHAPS, RunFigures, compared_metrics, limitable
from hhsim.gate.shown_poses import told_difference
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run_metric import Figure
from hhsim.replay.summary_table import promised

LEAST_PROCESSES = 3
"""Minimum number of processes of each side: a median of fewer follows every outlier."""
BETTER, SAME, WITHIN, WORSE, NOT_COMPARABLE = "better", "same", "within noise", "worse", "not comparable"
CHANGED = "changed"
"""Verdicts."""
ROUNDING = 1e-9
"""Relative difference up to which errors are the same."""
LOST = "no longer told by the method, and the base has it"
SLIGHT = 1e-3
"""Relative difference up to which errors differ by noise."""
NO_VALUE, UNTOLD, OVER = "undefined here", "the method does not tell it", "over the limit"
WORSE_WITHIN = "worse within limits"
"""Verdict of all rows where errors are worse and none misses its limit."""
REFUSED = "refused"
"""Verdict of a scene that cannot be run for bad input."""
UNJUDGED = (REFUSED, NOT_COMPARABLE)
EXIT_OK, EXIT_MISSED, EXIT_REFUSED, EXIT_NOT_COMPARABLE = 0, 1, 2, 3


@dataclass(frozen=True)
class TimeComparison:
    """Comparison of two sides' times."""

    base: float  # median over processes of the p50 [s], or [1] where it is divided by the reference workload
    head: float
    ratio: float  # head / base
    spread: float  # (max - min) / median over the processes of the side with more spread
    verdict: str  # one of the verdicts; never `same`, which times cannot show


def compare_times(base: Sequence[float], head: Sequence[float], limit: float) -> TimeComparison:
    """Compare the p50 of processes of two sides, in one unit; `limit` is the allowed relative slowdown.

    Mean and p99 of identical code differ by whole factors between runs, and even p50 by several percent between
    processes, whose memory layouts differ. The median over processes of the p50 of the CPU time is stable, with base
    and head run in turn so that both see the same machine: ratios of two such medians are compared with a limit of 5 %.

    Raises InputError for fewer than three processes of a side, or times that are not positive.
    """
    for name, times in (("base", base), ("head", head)):
        if len(times) < LEAST_PROCESSES:
            raise InputError(f"{len(times)} timed processes of {name}: at least {LEAST_PROCESSES} are needed")
        if not all(math.isfinite(value) and value > 0.0 for value in times):
            raise InputError(f"times of {name} that are not positive: the clock cannot be used")
    one, other = float(np.median(base)), float(np.median(head))
    ratio = other / one
    verdict = WORSE if ratio > 1.0 + limit else BETTER if ratio < 1.0 / (1.0 + limit) else WITHIN
    spread = max((max(times) - min(times)) / float(np.median(times)) for times in (base, head))
    return TimeComparison(one, other, ratio, spread, verdict)


def base_first(pair: int) -> bool:
    """True if base goes first in this pair: alternating, so that a steady drift favours neither."""
    return pair % 2 == 0


@dataclass(frozen=True)
class GateRow:
    """One judged figure."""

    # identification; `kind` is run, inputs, bits (poses and forces), error, counter, time, or limit of a figure that
    # only a suite's limit judges
    scene: str
    kind: str
    name: str
    label: str  # label for people
    unit: str = ""  # unit in which people read the three numbers
    head: float = math.nan  # SI, or % where the metric is so; NaN where there is none
    base: float = math.nan
    limit: float = math.nan
    verdict: str = ""  # verdict against the base; "" where there is no base
    passed: bool = True  # False where a limit was missed
    reason: str = ""  # remark for the reader, or ""

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values, SI; None for missing numbers."""
        values = {"head": self.head, "base": self.base, "limit": self.limit}
        numbers = {name: value if math.isfinite(value) else None for name, value in values.items()}
        names = ("scene", "kind", "name", "verdict", "passed", "reason")
        return {**{name: getattr(self, name) for name in names}, **numbers}


def judge_errors(scene: str, head: RunFigures, base: RunFigures | None, limits: Mapping[str, float]) -> list[GateRow]:
    """Judge errors by absolute limits, or by the base's value and `Judged.growth` where there is none.

    Undefined figures, such as the force of a missing hold, are not judged, unless the base has them.
    """
    rows = []
    method = str(head.inputs.solver.get("method", ""))
    trembling = math.isfinite(head.errors.get(TREMBLING, math.nan))
    for name, metric in compared_metrics().items():
        value = head.errors.get(name, math.nan)
        before = math.nan if base is None else base.errors.get(name, math.nan)
        growth = metric.judged.growth if metric.judged else math.nan
        limit = limits.get(name, before + growth)
        limited = name in limits and limit is not False
        limit = math.nan if limit is False else limit
        lost = name not in head.errors and not math.isnan(before)
        nothing = math.isnan(value) or (value == 0.0 and math.isnan(before))
        if nothing and not limited and not lost:
            continue
        passed, reason = True, ""
        if lost:
            passed, reason = False, LOST
        elif limited and math.isnan(value):
            # A figure that only the base has is lost.
            passed = math.isnan(before)
            reason = UNTOLD if name not in head.errors else NO_VALUE if passed else f"{NO_VALUE}, and the base has it"
        elif limited and not value <= limit:
            passed = False
            reason = OVER if math.isfinite(value) else "not finite"
        elif not limited and value > limit:
            passed, reason = False, f"more than {growth / metric.scale:g} {metric.unit} above the base"
        elif name == "stuck_ticks" and head.mostly_stuck:
            passed, reason = False, "more than half of the ticks"
        elif not limited and not promised(name, head.promises):
            reason = f"not promised by {method}"
        rounding = max(metric.judged.rounding if metric.judged else 0.0, ROUNDING * abs(before))
        sizes = (abs(value), abs(before)) if metric.signed else (value, before)
        word = _word(*sizes, SLIGHT * abs(before), rounding)
        figure = metric if trembling or metric.moving_hold is None else metric.moving_hold
        rows.append(_row(scene, "error", name, figure, value, before, limit, word, passed, reason))
    return rows


def judge_others(scene: str, head: RunFigures, limits: Mapping[str, float]) -> list[GateRow]:
    """Judge figures that only the suite limits, and suspicions about a submission."""
    rows = []
    for name, figure in limitable().items():
        value, limit = head.others.get(name, math.nan), limits.get(name, False)
        if limit is False or name in compared_metrics():
            continue
        passed = math.isnan(value) or value <= limit
        reason = "" if passed else OVER
        if math.isnan(value):
            reason = NO_VALUE if name in head.others else UNTOLD
        elif name in OF_MISHAPS and head.mishap and not passed:
            reason = f"{OVER}: {head.mishap}"
        elif name in OF_MISHAPS[:1]:
            reason = head.stopped
        rows.append(_row(scene, "limit", name, figure, value, math.nan, limit, "", passed, reason))
    if head.suspicions:
        count, reason = float(len(head.suspicions)), "; ".join(head.suspicions)
        suspected = Figure("suspicions", "suspected")
        rows.append(_row(scene, "run", suspected.name, suspected, count, math.nan, 0.0, "", False, reason))
    return rows


def judge_counters(scene: str, head: RunFigures, base: RunFigures, slack: Mapping[str, float]) -> list[GateRow]:
    """Judge work counters by those of the base: integers, so that any growth beyond the slack is real."""
    rows = []
    for name, (_, figure) in COUNTERS.items():
        if name not in base.counters:
            continue
        before = float(base.counters[name])
        if name not in head.counters:
            rows.append(_row(scene, "counter", name, figure, math.nan, before, math.nan, "", False, LOST))
            continue
        value, limit = float(head.counters[name]), math.floor(before * (1.0 + slack[name]))
        passed = value <= limit
        reason = "" if passed else f"more than {100.0 * slack[name]:g} % above the base"
        word = _word(value, before, limit - before)
        rows.append(_row(scene, "counter", name, figure, value, before, limit, word, passed, reason))
    return rows


def judge_inputs(scene: str, head: RunFigures, base: RunFigures, motion_may_change: bool = False) -> GateRow:
    """Judge whether two runs can be compared; with `motion_may_change`, another motion leaves the limits."""
    if found := differences(base.inputs, head.inputs, but_the_motion=motion_may_change):
        return inputs_row(scene, f"different inputs: {'; '.join(found)}", NOT_COMPARABLE)
    if differences(base.inputs, head.inputs):
        return inputs_row(scene, "another motion than the base's, which may change: judged by limits, not compared")
    apart = new_options(base.inputs, head.inputs)
    return inputs_row(scene, f"options that only one side has: {', '.join(apart)}" if apart else "", SAME)


def judge_bits(scene: str, head: RunFigures, base: RunFigures) -> list[GateRow]:
    """Tell by how much poses and forces differ from the base's, where the base has their digest."""
    if not base.digest:
        return []
    told, rounding = ("", False) if head.digest == base.digest else told_difference(head.shown, base.shown)
    word, reason = (WITHIN if rounding else CHANGED, f"other than the base's: {told}") if told else (SAME, "")
    return [GateRow(scene, "bits", "digest", "poses and forces", verdict=word, reason=reason)]


def judge_time(
    scene: str, head: Sequence[float], base: Sequence[float], limit: float, *, divided: bool = False
) -> GateRow:
    """Judge the time of a tick; `divided` by the reference workload it has no unit."""
    found = compare_times(base, head, limit)
    reason = f"{100.0 * (found.ratio - 1.0):+.1f} %, processes of a side within {100.0 * found.spread:.0f} %"
    label = "tick in contact, CPU, p50" + (" / reference workload" if divided else "")
    figure = Figure("tick_cpu_p50", label, unit="" if divided else "µs")
    figures = found.head, found.base, found.base * (1.0 + limit)
    return _row(scene, "time", figure.name, figure, *figures, found.verdict, found.verdict != WORSE, reason)


def failed_run(scene: str, reason: str, *, refused: bool = False) -> GateRow:
    """Return the row of a head that fails in a scene, which is missed, or refuses it for bad input."""
    word = REFUSED if refused else ""
    return GateRow(scene, "run", "run", "runs to the end", verdict=word, passed=refused, reason=reason)


def inputs_row(scene: str, reason: str, word: str = "", name: str = "inputs") -> GateRow:
    """Return a row with the reason and verdict of a comparison."""
    return GateRow(scene, "inputs", name, name, verdict=word, reason=reason)


def overall(rows: Sequence[GateRow]) -> tuple[str, int]:
    """Return verdict and exit code of all rows; "" where nothing was compared.

    A refusal weighs most, then a missed limit, then a failed comparison.
    """
    words = {row.verdict for row in rows if row.verdict and row.kind != "error"}
    if REFUSED in words:
        return REFUSED, EXIT_REFUSED
    if not all(row.passed for row in rows):
        return WORSE, EXIT_MISSED
    if NOT_COMPARABLE in words:
        return NOT_COMPARABLE, EXIT_NOT_COMPARABLE
    if any(row.kind == "error" and row.verdict == WORSE for row in rows):
        return WORSE_WITHIN, EXIT_OK
    # A counter or a time that is worse within its limit is noise.
    for word in (BETTER, CHANGED, WORSE, WITHIN):
        if word in words:
            return (WITHIN if word == WORSE else word), EXIT_OK
    return (SAME if words else ""), EXIT_OK


def _row(scene: str, kind: str, name: str, figure: Figure, *judged: Any) -> GateRow:
    return GateRow(scene, kind, name, figure.label, figure.unit, *judged)


def _word(value: float, before: float, slack: float, rounding: float = 0.0) -> str:
    if math.isnan(before) or math.isnan(value):
        return ""
    if abs(value - before) <= rounding:
        return SAME
    if abs(value - before) <= slack:
        return WITHIN
    return WORSE if value > before else BETTER
