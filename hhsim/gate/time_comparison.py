"""Compare the tick times of two sides: the one statistic by which head is slower than base.

Mean and p99 of identical code differ by whole factors between runs, and even p50 differs from process to process by
several percent, since each process has its own memory layout. What repeats is the median over processes of the p50 of
the CPU time, with base and head run in turn so that both see the same machine: ratios of two such medians are compared
with a limit of 5 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hhsim.errors import InputError

LEAST_PROCESSES = 3
"""Of each side: a median of fewer follows every outlier."""

BETTER, SAME, WITHIN, WORSE, NOT_COMPARABLE = "better", "same", "within noise", "worse", "not comparable"
"""The verdict words."""


@dataclass(frozen=True)
class TimeComparison:
    """Two sides' times.

    Attributes:
        base, head: Median over processes of the p50 [s], or [1] where it is divided by the reference workload.
        ratio: Head / base.
        spread: Of the larger side, (max - min) / median of its processes.
        verdict: One of the words; never `same`, which times cannot show.
    """

    base: float
    head: float
    ratio: float
    spread: float
    verdict: str


def compare_times(base: Sequence[float], head: Sequence[float], limit: float) -> TimeComparison:
    """Compare the p50 of processes of two sides.

    Args:
        base: Median of each process, any unit.
        head: The same, in the same unit.
        limit: Share by which head may be slower.

    Raises:
        InputError: Fewer than three processes of a side, or times that are not positive.
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
    """Whether base goes first in this pair: base head, head base, …, so that a steady drift favours neither."""
    return pair % 2 == 0
