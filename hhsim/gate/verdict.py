"""Verdicts: one row for each figure of each scene, and one for all."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.gate.input_hash import differences, new_options
from hhsim.gate.metrics import COUNTERS, OF_MISHAPS, RunFigures, compared_metrics, limitable
from hhsim.gate.shown_poses import told_difference
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run_metric import Figure, Judged
from hhsim.replay.summary_table import promised
from hhsim.replay.verdict import verdict as missed_limits

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
    spread = max((max(times) - min(times)) / float(np.median(times)) for times in (base, head))
    return TimeComparison(one, other, ratio, spread, word_of(other, one, limit, -1.0))


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


@dataclass(frozen=True)
class Rule:
    """Judgement of a figure; NaN where there is no such limit."""

    figure: Figure
    kind: str  # as of `GateRow`
    absolute: float = math.nan  # largest value
    growth: float = math.nan  # largest excess over the base's value where there is no absolute limit
    relative: float = math.nan  # the same as a share of the base's value, in whole numbers
    noise: float = SLIGHT  # relative difference from the base's value that is noise
    rounding: float = 0.0  # difference up to which values are the same

    def limit(self, base: float) -> float:
        """Return the largest value beside that of the base, NaN for none."""
        if not math.isnan(self.absolute):
            return self.absolute
        share = base * self.relative
        return base + (self.growth if math.isnan(share) else math.floor(share))

    @property
    def allows(self) -> str:
        """Growth over the base that is allowed, in words."""
        if not math.isnan(self.relative):
            return f"{100.0 * self.relative:g} %"
        return f"{self.growth / self.figure.scale:g} {self.figure.unit}"


def judge(scene: str, rule: Rule, head: float | None, base: float = math.nan, remark: str = "") -> GateRow:
    """Judge a figure of head, None where its method does not tell it, by its limit; the base has NaN for none.

    A remark is the reason of a figure within its limit, and the cause of one beyond an absolute one.
    """
    value, limit, limited = math.nan if head is None else head, rule.limit(base), not math.isnan(rule.absolute)
    passed, reason = True, remark
    if head is None and not math.isnan(base):
        passed, reason = False, LOST
    elif math.isnan(value):
        # A figure that only the base has is lost.
        passed = math.isnan(base)
        reason = UNTOLD if head is None else NO_VALUE if passed else f"{NO_VALUE}, and the base has it"
    elif missed_limits({rule.figure.name: value}, {rule.figure.name: limit}):
        over = (OVER if math.isfinite(value) else "not finite") + (f": {remark}" if remark else "")
        passed, reason = False, over if limited else f"more than {rule.allows} above the base"
    sizes = (abs(value), abs(base)) if rule.figure.signed else (value, base)
    word = word_of(*sizes, rule.noise, max(rule.rounding, ROUNDING * abs(base)))
    figure = rule.figure
    return GateRow(
        *(scene, rule.kind, figure.name, figure.label, figure.unit, value, base, limit, word, passed, reason)
    )


def word_of(value: float, before: float, noise: float, rounding: float = 0.0) -> str:
    """Return the word for a value beside an earlier one, of figures of which less is better; "" where one is NaN."""
    if math.isnan(before) or math.isnan(value):
        return ""
    if abs(value - before) <= rounding:
        return SAME
    if before <= value * (1.0 + noise) and value <= before * (1.0 + noise):
        return WITHIN
    return WORSE if value > before else BETTER


def judge_figures(
    scene: str, head: RunFigures, base: RunFigures | None, limits: Mapping[str, float], slack: Mapping[str, float]
) -> list[GateRow]:
    """Judge errors by limits or the base, figures that only limits judge, and work counters, which are exact.

    Undefined figures, such as the force of a missing hold, are not judged, unless the base has them. Work may grow by
    the slack, a share of the base's.
    """
    rows, method = [], str(head.inputs.solver.get("method", ""))
    trembling = math.isfinite(head.errors.get(TREMBLING, math.nan))
    for name, metric in compared_metrics().items():
        value, before = head.errors.get(name), math.nan if base is None else base.errors.get(name, math.nan)
        by, stated = metric.judged or Judged(), limits.get(name, math.nan)
        figure = metric if trembling or metric.moving_hold is None else metric.moving_hold
        of = {"growth": by.growth} if math.isnan(stated) else {} if stated is False else {"absolute": stated}
        limited = "absolute" in of
        absent = value is None or math.isnan(value) or (value == 0.0 and math.isnan(before))
        if absent and not limited and (value is not None or math.isnan(before)):
            continue
        told = "" if limited or promised(name, head.promises) else f"not promised by {method}"
        row = judge(scene, Rule(figure, "error", rounding=by.rounding, **of), value, before, told)
        if name == "stuck_ticks" and head.mostly_stuck and row.passed:
            row = replace(row, passed=False, reason="more than half of the ticks")
        rows.append(row)
    for name, stated in ((name, limits[name]) for name in limitable() if limits.get(name, False) is not False):
        if name not in compared_metrics():
            value, cause = head.others.get(name), ""
            if name in OF_MISHAPS and value is not None and not value <= stated:
                cause = head.mishap
            elif name in OF_MISHAPS[:1]:
                cause = head.stopped
            rows.append(judge(scene, Rule(limitable()[name], "limit", stated), value, remark=cause))
    if head.suspicions:
        rule = Rule(Figure("suspicions", "suspected"), "run", absolute=0.0)
        rows.append(judge(scene, rule, float(len(head.suspicions))))
        rows[-1] = replace(rows[-1], reason="; ".join(head.suspicions))
    for name, (_, figure) in COUNTERS.items() if base is not None else ():
        if base is not None and name in base.counters:
            rule = Rule(figure, "counter", relative=slack[name], noise=slack[name])
            count = head.counters.get(name)
            rows.append(judge(scene, rule, None if count is None else float(count), float(base.counters[name])))
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
    unit, numbers = "" if divided else "µs", (found.head, found.base, found.base * (1.0 + limit))
    return GateRow(scene, "time", "tick_cpu_p50", label, unit, *numbers, found.verdict, found.verdict != WORSE, reason)


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
