"""Smoothness of the joints, and how far the repaired hand is off the recorded one.

Acceleration (ACC) and jerk of the joints in the world are the second and third differences at the stamps, as the mean
norm over frames and joints, as ARCTIC and GRAB measure smoothness. At uneven stamps they are divided differences, times
2 and 6: exact for motions of the second and third degree. MPJPE is over joints, MPVPE over the vertices of the skin.
"""

import math
from collections.abc import Callable

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.metrics.field.hands import FieldHands, FieldMetric, FieldPair, largest, mean, of_each, of_repair
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


_SMOOTHNESS = each_with(
    FieldMetric("acceleration", "ACC", 3, "m/s²", compute=of_each(acceleration)),
    FieldMetric("jerk", "jerk", 1, "m/s³", compute=of_each(jerk)),
    FieldMetric(RATIO, "ACC, after over before", 3, compute=of_repair(acceleration_ratio)),
    parameters=_rate,
)


INSIDE = 1e-6
"""Depth of the hand's surface or joints above which a frame was inside [m]."""
LARGEST = "correction_max"
"""Name of the figure that the verdict judges."""


def joint_shift(pair: FieldPair) -> FloatArray:
    """Compute the distance of each repaired joint from the recorded one [m], shape (T, 21); NaN in missing frames."""
    shift = np.linalg.norm(pair.repaired.joints - pair.recorded.joints, axis=2)
    return np.where(pair.known[:, None], shift, np.nan)


def was_inside(pair: FieldPair) -> BoolArray:
    """Return the frames whose recorded hand was inside the object by more than `INSIDE`, shape (T,)."""
    hands = pair.recorded
    return np.asarray(np.minimum(hands.distance, hands.joint_distance.min(axis=1)) < -INSIDE)


def vertex_error(pair: FieldPair) -> float:
    """Compute the mean distance of the skin's vertices from the recorded ones [m]; NaN without skins."""
    if pair.recorded.skin is None or pair.repaired.skin is None:
        return float("nan")
    return mean(np.linalg.norm(pair.repaired.skin - pair.recorded.skin, axis=2)[pair.known])


def _median(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def _figure(name: str, label: str, parameters: str, compute: Callable[[FieldPair], float]) -> FieldMetric:
    return FieldMetric(name, label, 3, "mm", parameters=parameters, compute=of_repair(compute))


_CORRECTION = each_with(
    _figure("mpjpe", "MPJPE", "21 joints", lambda pair: mean(joint_shift(pair))),
    _figure("mpvpe", "MPVPE", "vertices of the skin", vertex_error),
    _figure(
        "correction_inside", "MPJPE, median of frames that were inside", "21 joints",
        lambda pair: _median(joint_shift(pair).mean(axis=1)[was_inside(pair)]),
    ),
    _figure(
        "correction_outside", "MPJPE, frames that needed nothing", "21 joints",
        lambda pair: mean(joint_shift(pair)[~was_inside(pair)]),
    ),
    _figure(LARGEST, "correction of a joint, max", "21 joints", lambda pair: largest(joint_shift(pair))),
)  # fmt: skip


METRICS = (*_SMOOTHNESS, *_CORRECTION)
