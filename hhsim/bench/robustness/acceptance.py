"""Figures of every hard case: penetration, finite numbers, joint limits, stuck ticks.

Only the bit of a stuck tick is taken from the solver: penetration is recomputed from the recorded poses, and a stuck
tick is explained only if `hhsim.bench.robustness.local_optimality`, which shares nothing with a tick, finds no step.
"""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.robustness.case import DEEPEST, Figure, Outcome
from hhsim.bench.run_errors import placed_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.kernels.tick.block import TickRecord

LIMIT_TOLERANCE = 1e-9
"""Excess of a joint beyond its limit that is rounding [rad]."""


def common_figures(outcomes: list[Outcome]) -> list[Figure]:
    """Return the figures of every case, over all of its runs that were not refused."""
    penetration = float(np.max([outcome.safety.penetration / outcome.run.scale for outcome in outcomes]))
    return [
        Figure("penetration", penetration, DEEPEST, "m"),
        Figure("ticks that are not finite", sum(outcome.safety.not_finite for outcome in outcomes), 0),
        Figure("joint beyond its limit", max(outcome.limit_excess for outcome in outcomes), LIMIT_TOLERANCE, "rad"),
        Figure("stuck ticks that nothing explains", sum(outcome.safety.unexplained for outcome in outcomes), 0),
    ]


def part_of(record: TickRecord, first: int | None, last: int | None = None) -> TickRecord:
    """Return ticks first to last - 1 of a record; negative numbers count from the end."""
    return TickRecord._make(values[first:last] for values in record)


def limit_excess(hand: HandModel, record: TickRecord) -> float:
    """Return the largest excess of a joint beyond its limit [rad]; NaN if an angle is."""
    low = hand.flexion_min - record.flexion
    high = record.flexion - hand.flexion_max
    return float(max(0.0, np.max(low), np.max(high))) if np.isfinite(record.flexion).all() else float("nan")


def shown_points(record: TickRecord) -> FloatArray:
    """Return joints and palm of the graphic hand [m], shape (T, 21, 3)."""
    return placed_of(record).points


def motion_difference(first: TickRecord, second: TickRecord) -> float:
    """Return the largest distance [m] of a joint or the palm of one record from the other's."""
    return float(np.linalg.norm(shown_points(first) - shown_points(second), axis=-1).max())


def sound_samples(motion: HandConfiguration) -> BoolArray:
    """Return the samples that are a hand's, shape (T,), from the input itself."""
    return np.array([is_finite_configuration(*sample) for sample in zip(*motion, strict=True)], dtype=bool)
