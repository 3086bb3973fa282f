"""Figures of the field: name, display, parameters and computation from a recorded hand and its repair."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.metrics.field.hands import FieldHands, FieldPair
from hhsim.metrics.run_metric import Figure

BeforeAfter = tuple[float, float]
"""Figure of the recorded hand and of the repaired one, NaN where it is undefined."""


@dataclass(frozen=True, kw_only=True)
class FieldMetric(Figure):
    """Figure of a recorded hand and its repair, in SI units, or in % where it is defined so."""

    compute: Callable[[FieldPair], BeforeAfter]
    place: int = 1000  # place in the table; of equal ones, in the order of their modules
    parameters: str | Callable[[FieldPair], str] = ""  # parameters of the definition, as the table prints them


def placed(first: int, *metrics: FieldMetric, **also: Any) -> tuple[FieldMetric, ...]:
    """Return figures in places of the table one after another; `also` holds for each of them."""
    return tuple(replace(metric, place=place, **also) for place, metric in enumerate(metrics, first))


def of_each(compute: Callable[[FieldHands], float]) -> Callable[[FieldPair], BeforeAfter]:
    """Return the computation of a figure that each hand has by itself."""
    return lambda pair: (compute(pair.recorded), compute(pair.repaired))


def of_frames(
    values: Callable[[FieldPair, FieldHands], FloatArray], statistic: Callable[[FloatArray], float]
) -> Callable[[FieldPair], BeforeAfter]:
    """Return the computation of a statistic of the values that each hand of a pair has in its frames."""
    return lambda pair: (statistic(values(pair, pair.recorded)), statistic(values(pair, pair.repaired)))


def of_repair(compute: Callable[[FieldPair], float]) -> Callable[[FieldPair], BeforeAfter]:
    """Return the computation of a figure that compares both hands: the recorded one has none."""
    return lambda pair: (float("nan"), compute(pair))


def mean(values: FloatArray) -> float:
    """Return the mean of the finite values, NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


def largest(values: FloatArray) -> float:
    """Return the largest finite value, NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else float("nan")
