"""One verdict on figures by their limits, and one word for a figure beside that of another run."""

import math
from collections.abc import Collection, Mapping

BETTER, SAME, WITHIN, WORSE, NOT_COMPARABLE = "better", "same", "within noise", "worse", "not comparable"
"""Words for a figure beside that of another run."""


def verdict(figures: Mapping[str, float], limits: Mapping[str, float], least: Collection[str] = ()) -> tuple[str, ...]:
    """Return the names of the figures beyond their limits, in the order of the limits, in one unit.

    A replay, a session, a score, a repair and the gate are judged by it. Limits are upper ones, but for those of
    `least`. A limit without a figure, or of NaN, is none; an undefined figure (NaN) is beyond no limit, an infinite one
    over any.
    """
    known = {name: limit for name, limit in limits.items() if not math.isnan(figures.get(name, math.nan))}
    missed = []
    for name, limit in known.items():
        is_kept = figures[name] >= limit if name in least else figures[name] <= limit
        if not (is_kept or math.isnan(limit)):
            missed.append(name)
    return tuple(missed)


def word_of(value: float, before: float, noise: float, rounding: float = 0.0) -> str:
    """Return the word for a value beside an earlier one, of figures of which less is better; "" where one is NaN."""
    if math.isnan(before) or math.isnan(value):
        return ""
    if abs(value - before) <= rounding:
        return SAME
    if before <= value * (1.0 + noise) and value <= before * (1.0 + noise):
        return WITHIN
    return WORSE if value > before else BETTER
