"""Acceleration (ACC) and jerk of the joints in the world, as ARCTIC and GRAB measure smoothness.

They are the second and third differences at the stamps, as the mean norm over frames and joints. At uneven stamps they
are divided differences, times 2 and 6: exact for motions of the second and third degree.
"""

import math

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.metrics.field.hands import FieldHands, FieldMetric, FieldPair, mean, of_each, of_repair
from hhsim.metrics.run_metric import each_with

RATIO = "acceleration_ratio"
"""Name of the figure that the verdict judges."""


def derivative_norm(time: FloatArray, points: FloatArray, order: int) -> float:
    """Compute the mean norm of a derivative of points, shape (T, n, 3), by divided differences at the stamps [s].

    Differences across a missing frame, or between equal stamps, are left out; NaN if none is left.
    """
    found = np.asarray(points, dtype=np.float64)
    for degree in range(1, order + 1):
        span = (time[degree:] - time[:-degree])[:, None, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            found = np.where(span > 0.0, np.diff(found, axis=0) / span, np.nan)
    return math.factorial(order) * mean(np.linalg.norm(found, axis=-1))


def acceleration(hands: FieldHands) -> float:
    """Compute the mean norm of the joints' acceleration in the world [m/s²]."""
    return derivative_norm(hands.time, hands.world_joints, 2)


def jerk(hands: FieldHands) -> float:
    """Compute the mean norm of the joints' jerk in the world [m/s³]."""
    return derivative_norm(hands.time, hands.world_joints, 3)


def acceleration_ratio(pair: FieldPair) -> float:
    """Compute the acceleration after over that before; NaN for a hand that does not accelerate."""
    before, after = map(acceleration, pair.both)
    return after / before if before > 0.0 else float("nan")


def _rate(pair: FieldPair) -> str:
    steps = np.diff(pair.recorded.time)
    steps = steps[steps > 0.0]
    return f"{1.0 / float(np.median(steps)):.4g} Hz" if steps.size else ""


METRICS = each_with(
    FieldMetric("acceleration", "ACC", 3, "m/s²", compute=of_each(acceleration)),
    FieldMetric("jerk", "jerk", 1, "m/s³", compute=of_each(jerk)),
    FieldMetric(RATIO, "ACC, after over before", 3, compute=of_repair(acceleration_ratio)),
    parameters=_rate,
)
