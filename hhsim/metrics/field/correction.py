"""Distance of the repaired hand from the recorded one: MPJPE over joints, MPVPE over the vertices of the skin."""

from collections.abc import Callable

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.metrics.field.hands import FieldMetric, FieldPair, largest, mean, of_repair
from hhsim.metrics.run_metric import each_with

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


METRICS = each_with(
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
