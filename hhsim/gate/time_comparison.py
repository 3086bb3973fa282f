"""Comparison of the tick times of two sides.

Mean and p99 of identical code differ by whole factors between runs, and even p50 by several percent between processes,
whose memory layouts differ. The median over processes of the p50 of the CPU time is stable, with base and head run in
turn so that both see the same machine: ratios of two such medians are compared with a limit of 5 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hhsim.errors import InputError

LEAST_PROCESSES = 3
"""Minimum number of processes of each side: a median of fewer follows every outlier."""

BETTER, SAME, WITHIN, WORSE, NOT_COMPARABLE = "better", "same", "within noise", "worse", "not comparable"
"""Verdicts."""


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
