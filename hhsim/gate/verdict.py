"""Rows of the gate: one for each figure of each scene, and the verdict on all of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.gate.metrics import COUNTERS, RunFigures, compared_metrics, limitable
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run_metric import Figure, Judged
from hhsim.replay.run_inputs import differences, new_options
from hhsim.replay.summary_table import promised
from hhsim.table.verdict import BETTER, NOT_COMPARABLE, SAME, WITHIN, WORSE, word_of
from hhsim.table.verdict import verdict as missed_limits

CHANGED, REFUSED = "changed", "refused"
"""Verdicts of rows besides those of figures; a scene is refused that cannot be run for bad input."""
WORSE_WITHIN = "worse within limits"
"""Verdict of all rows where errors are worse and none misses its limit."""
UNJUDGED = (REFUSED, NOT_COMPARABLE)
EXIT_OK, EXIT_MISSED, EXIT_REFUSED, EXIT_NOT_COMPARABLE = 0, 1, 2, 3
ROUNDING = 1e-9
"""Relative difference up to which errors are the same."""
SLIGHT = 1e-3
"""Relative difference up to which errors differ by noise."""
LOST = "no longer told by the method, and the base has it"
NO_VALUE, UNTOLD, OVER = "undefined here", "the method does not tell it", "over the limit"


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


def failed_run(scene: str, reason: str, *, refused: bool = False) -> GateRow:
    """Return the row of a head that fails in a scene, which is missed, or refuses it for bad input."""
    word = REFUSED if refused else ""
    return GateRow(scene, "run", "run", "runs to the end", verdict=word, passed=refused, reason=reason)


def inputs_row(scene: str, reason: str, word: str = "", name: str = "inputs") -> GateRow:
    """Return a row with the reason and verdict of a comparison."""
    return GateRow(scene, "inputs", name, name, verdict=word, reason=reason)


def judge_run(
    scene: str, head: RunFigures, base: RunFigures | None, limits: Mapping[str, float], slack: Mapping[str, float]
) -> list[GateRow]:
    """Judge all of a run but its time; figures of a base with other inputs, or not of numbers, are left out.

    `limits` and `slack` are as of `judge_figures`.
    """
    rows = [failed_run(scene, head.unsound)] if head.unsound else []
    if base is not None and base.unsound:
        rows.append(inputs_row(scene, f"base: {base.unsound}", NOT_COMPARABLE))
        base = None
    if base is not None:
        if found := differences(base.inputs, head.inputs):
            rows.append(inputs_row(scene, f"different inputs: {'; '.join(found)}", NOT_COMPARABLE))
            base = None
        else:
            apart = ", ".join(new_options(base.inputs, head.inputs))
            rows.append(inputs_row(scene, f"options that only one side has: {apart}" if apart else "", SAME))
    if base is not None and base.digest:
        word = SAME if head.digest == base.digest else CHANGED
        rows.append(GateRow(scene, "bits", "digest", "poses and forces", verdict=word))
    return [*rows, *judge_figures(scene, head, base, limits, slack)]


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
        # False is no limit, nor one that follows from the base.
        limited = not (stated is False or math.isnan(stated))
        absent = value is None or math.isnan(value) or (value == 0.0 and math.isnan(before))
        if absent and not limited and (value is not None or math.isnan(before)):
            continue
        told = "" if limited or promised(name, head.promises) else f"not promised by {method}"
        growth = by.growth if stated is not False else math.nan
        limit = stated if limited else math.nan
        row = _judged(
            scene, "error", figure, value, before, limit, growth=growth, rounding=by.rounding, remark=told
        )  # fmt: skip
        if name == "stuck_ticks" and head.mostly_stuck and row.passed:
            row = replace(row, passed=False, reason="more than half of the ticks")
        rows.append(row)
    for name, figure in limitable().items():
        if name not in compared_metrics() and limits.get(name, False) is not False:
            rows.append(_judged(scene, "limit", figure, head.others.get(name), limit=limits[name]))
    if head.suspicions:
        suspected = _judged(scene, "run", Figure("suspicions", "suspected"), float(len(head.suspicions)), limit=0.0)
        rows.append(replace(suspected, reason="; ".join(head.suspicions)))
    for name, (_, figure) in COUNTERS.items() if base is not None else ():
        if base is not None and name in base.counters:
            count, before = head.counters.get(name), float(base.counters[name])
            value = None if count is None else float(count)
            rows.append(_judged(scene, "counter", figure, value, before, share=slack[name], noise=slack[name]))
    return rows


def _judged(
    scene: str,
    kind: str,
    figure: Figure,
    head: float | None,
    base: float = math.nan,
    limit: float = math.nan,
    *,
    growth: float = math.nan,
    share: float = math.nan,
    noise: float = SLIGHT,
    rounding: float = 0.0,
    remark: str = "",
) -> GateRow:
    """Judge a figure of head, None where its method does not tell it, beside the base's, NaN for none.

    Without a limit it may exceed the base's by `growth`, or by a `share` of it in whole numbers. Relative differences
    up to `noise`, and differences up to `rounding`, have words of their own. A remark is the reason where it passes.
    """
    value = math.nan if head is None else head
    most = limit
    if math.isnan(limit):
        most = base + (growth if math.isnan(share) else math.floor(base * share))
    passed, reason = True, remark
    if head is None and not math.isnan(base):
        passed, reason = False, LOST
    elif math.isnan(value):
        # A figure that only the base has is lost.
        passed = math.isnan(base)
        reason = UNTOLD if head is None else NO_VALUE if passed else f"{NO_VALUE}, and the base has it"
    elif missed_limits({figure.name: value}, {figure.name: most}):
        allowed = f"{growth / figure.scale:g} {figure.unit}" if math.isnan(share) else f"{100.0 * share:g} %"
        over = OVER if math.isfinite(value) else "not finite"
        passed, reason = False, f"more than {allowed} above the base" if math.isnan(limit) else over
    sizes = (abs(value), abs(base)) if figure.signed else (value, base)
    word = word_of(*sizes, noise, max(rounding, ROUNDING * abs(base)))
    return GateRow(scene, kind, figure.name, figure.label, figure.unit, value, base, most, word, passed, reason)


def judge_time(scene: str, head: Sequence[float], base: Sequence[float], limit: float) -> GateRow:
    """Judge the time of a tick, from the p50 of processes of two sides; `limit` is the allowed relative slowdown.

    Mean and p99 of identical code differ by whole factors between runs, and even p50 by several percent between
    processes, whose memory layouts differ. The median over processes of the p50 of the CPU time is stable, with base
    and head run in turn so that both see the same machine: ratios of two such medians are compared with a limit of 5 %.

    Raises InputError for times [s] that are not positive.
    """
    for name, times in (("base", base), ("head", head)):
        if not all(math.isfinite(value) and value > 0.0 for value in times):
            raise InputError(f"times of {name} that are not positive: the clock cannot be used")
    before, now = float(np.median(base)), float(np.median(head))
    spread = max((max(times) - min(times)) / float(np.median(times)) for times in (base, head))
    word = word_of(now, before, limit, -1.0)
    reason = f"{100.0 * (now / before - 1.0):+.1f} %, processes of a side within {100.0 * spread:.0f} %"
    numbers, label = (now, before, before * (1.0 + limit)), "tick in contact, CPU, p50"
    return GateRow(scene, "time", "tick_cpu_p50", label, "µs", *numbers, word, word != WORSE, reason)


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
