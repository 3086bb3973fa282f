"""Figures by which papers judge a repaired recording, before and after the repair, in the order of the table.

Penetration depth (PD) of skin vertices is GraspTTA's (Jiang et al. 2021, metric/penetration.py): the largest distance
to the object's surface of a vertex inside the object. The field has no single definition of a contact: each figure
states its threshold, and a point inside the object is in contact.

Acceleration (ACC) and jerk of the joints in the world are the second and third differences at the stamps, as the mean
norm over frames and joints, as ARCTIC and GRAB measure smoothness. At uneven stamps they are divided differences, times
2 and 6: exact for motions of the second and third degree. MPJPE is over joints, MPVPE over the vertices of the skin.
Forces are what the virtual coupling bears at the corrected hand: nobody else publishes one that is not made of the
depth, as EgoPHI's is (-k d n).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.metrics.field.hands import FieldHands, FieldPair
from hhsim.metrics.field.volume import SEGMENTS, volumes
from hhsim.metrics.run_metric import Figure

THRESHOLDS = (0.005, 0.002)
"""Largest distance of a contact from the object's surface [m]."""
INSIDE = 1e-6
"""Depth of the hand's surface or joints above which a frame was inside [m]."""
KEPT, TOUCHING = "contacts_kept_5mm", "frames_in_contact_5mm"
RATIO, LARGEST = "acceleration_ratio", "correction_max"
"""Names of figures that the verdict judges, besides the depths."""
Statistic = Callable[[FloatArray], float]


@dataclass(frozen=True, kw_only=True)
class FieldMetric(Figure):
    """Figure of a recorded hand and its repair, in SI units, or in % where it is defined so."""

    # Figure of the recorded hand and of the repaired one, NaN where it is undefined.
    compute: Callable[[FieldPair], tuple[float, float]]
    parameters: str | Callable[[FieldPair], str] = ""  # parameters of the definition, as the table prints them


def of_each(compute: Callable[[FieldHands], float]) -> Callable[[FieldPair], tuple[float, float]]:
    """Return the computation of a figure that each hand has by itself."""
    return lambda pair: (compute(pair.recorded), compute(pair.repaired))


def of_repair(compute: Callable[[FieldPair], float]) -> Callable[[FieldPair], tuple[float, float]]:
    """Return the computation of a figure that compares both hands: the recorded one has none."""
    return lambda pair: (math.nan, compute(pair))


def mean(values: FloatArray) -> float:
    """Return the mean of the finite values, NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else math.nan


def largest(values: FloatArray) -> float:
    """Return the largest finite value, NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else math.nan


def depths(distance: FloatArray | None) -> FloatArray:
    """Compute the depth of each frame [m], shape (T,), from signed distances, shape (T,) or (T, n); empty for None."""
    if distance is None:
        return np.zeros(0)
    return np.asarray(np.maximum(-distance.reshape(len(distance), -1).min(axis=1), 0.0))


def frames_in_contact(hands: FieldHands, threshold: float) -> float:
    """Compute the share of frames whose hand is in contact [%]."""
    return 100.0 * mean(np.where(hands.known, hands.distance <= threshold, np.nan))


def fingertips_in_contact(hands: FieldHands, threshold: float) -> float:
    """Compute the share of frames and fingertips in contact [%]."""
    return 100.0 * mean(np.where(hands.known[:, None], hands.finger_distance <= threshold, np.nan))


def contacts_kept(pair: FieldPair, threshold: float) -> float:
    """Compute the share of the recording's contacts of a frame and a fingertip that the repair has [%]; NaN if none."""
    before, after = (hands.finger_distance[pair.known] <= threshold for hands in pair.both)
    return 100.0 * float(after[before].mean()) if before.any() else math.nan


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
    return after / before if before > 0.0 else math.nan


def joint_shift(pair: FieldPair) -> FloatArray:
    """Compute the distance of each repaired joint from the recorded one [m], shape (T, 21); NaN in missing frames."""
    shift = np.linalg.norm(pair.repaired.joints - pair.recorded.joints, axis=2)
    return np.where(pair.known[:, None], shift, np.nan)


def was_inside(pair: FieldPair) -> BoolArray:
    """Return the frames whose recorded hand was inside the object by more than `INSIDE`, shape (T,)."""
    hands = pair.recorded
    return np.asarray(np.minimum(hands.distance, hands.joint_distance.min(axis=1)) < -INSIDE)


def _median_inside(pair: FieldPair) -> float:
    values = joint_shift(pair).mean(axis=1)[was_inside(pair)]
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else math.nan


def vertex_error(pair: FieldPair) -> float:
    """Compute the mean distance of the skin's vertices from the recorded ones [m]; NaN without skins."""
    if pair.recorded.skin is None or pair.repaired.skin is None:
        return math.nan
    return mean(np.linalg.norm(pair.repaired.skin - pair.recorded.skin, axis=2)[pair.known])


def pressing_force(pair: FieldPair, finger: int) -> float:
    """Compute the mean force of a finger over the frames in which it presses [N]; NaN if it never does."""
    if pair.force is None:
        return math.nan
    force = pair.force[:, finger]
    return mean(force[force > 0.0])


def _volume_words(pair: FieldPair) -> str:
    surface = "cones" if pair.recorded.skin is None else "open wrist closed with a fan"
    known = int(pair.known.sum())
    some = f"; {pair.volume_frames} of {known} frames and the deepest" if 0 < pair.volume_frames < known else ""
    return f"Boolean of meshes, {SEGMENTS} edges around a cone; {surface}{some}"


def _rate_words(pair: FieldPair) -> str:
    steps = np.diff(pair.recorded.time)
    steps = steps[steps > 0.0]
    return f"{1.0 / float(np.median(steps)):.4g} Hz" if steps.size else ""


def _depth_figures(
    name: str, words: str, distance: Callable[[FieldHands], FloatArray | None]
) -> tuple[FieldMetric, FieldMetric]:
    most, usual = of_each(lambda hands: largest(depths(distance(hands)))), of_each(lambda h: mean(depths(distance(h))))
    return (
        FieldMetric(f"depth_{name}_max", f"PD, {name}, max", 3, "mm", compute=most, parameters=words),
        FieldMetric(f"depth_{name}_mean", f"PD, {name}, mean of frames", 3, "mm", compute=usual, parameters=words),
    )


def _volume_figure(name: str, label: str, statistic: Statistic) -> FieldMetric:
    def compute(pair: FieldPair) -> tuple[float, float]:
        before, after = (statistic(volumes(hands, pair.volume_frames)) for hands in pair.both)
        return before, after

    return FieldMetric(name, label, 3, "cm³", compute=compute, parameters=_volume_words)


def _contact_figures(limit: float) -> Iterator[FieldMetric]:
    size, within = f"{1e3 * limit:g}mm", f"within {1e3 * limit:g} mm"
    hand, tips = "any point of the hand, inside counts", "distal phalanges, inside counts"
    for name, label, words, compute in (
        ("frames_in_contact", "frames", hand, of_each(lambda hands: frames_in_contact(hands, limit))),
        ("fingertips_in_contact", "fingertips", tips, of_each(lambda hands: fingertips_in_contact(hands, limit))),
        ("contacts_kept", "contacts kept", tips, of_repair(lambda pair: contacts_kept(pair, limit))),
    ):
        label, name = f"{label} {within}", f"{name}_{size}"
        yield FieldMetric(name, label, 1, "%", compute=compute, parameters=words, less_is_better=False)


def _repair_figure(name: str, label: str, unit: str, words: str, compute: Callable[[FieldPair], float]) -> FieldMetric:
    return FieldMetric(name, label, 3, unit, parameters=words, compute=of_repair(compute))


def _force_figure(finger: int) -> FieldMetric:
    label = f"force of the {FINGERS[finger]} where it presses, mean"
    return _repair_figure(
        f"force_{FINGERS[finger]}", label, "N", "of the coupling", lambda pair: pressing_force(pair, finger)
    )


METRICS = (
    *_depth_figures("joints", "21 joint centres", lambda hands: hands.joint_distance),
    *_depth_figures("skin", "vertices of the skin", lambda hands: hands.skin_distance),
    *_depth_figures("cones", "surface of cones and palm spheres", lambda hands: hands.cone_distance),
    _volume_figure("volume_exact_mean", "IV, exact, mean of frames", mean),
    _volume_figure("volume_exact_max", "IV, exact, max", largest),
    *_contact_figures(THRESHOLDS[0]),
    *_contact_figures(THRESHOLDS[1]),
    FieldMetric("acceleration", "ACC", 3, "m/s²", compute=of_each(acceleration), parameters=_rate_words),
    FieldMetric("jerk", "jerk", 1, "m/s³", compute=of_each(jerk), parameters=_rate_words),
    FieldMetric(RATIO, "ACC, after over before", 3, compute=of_repair(acceleration_ratio), parameters=_rate_words),
    _repair_figure("mpjpe", "MPJPE", "mm", "21 joints", lambda pair: mean(joint_shift(pair))),
    _repair_figure("mpvpe", "MPVPE", "mm", "vertices of the skin", vertex_error),
    _repair_figure(
        "correction_inside", "MPJPE, median of frames that were inside", "mm", "21 joints", _median_inside
    ),
    _repair_figure(
        "correction_outside", "MPJPE, frames that needed nothing", "mm", "21 joints",
        lambda pair: mean(joint_shift(pair)[~was_inside(pair)]),
    ),
    _repair_figure(LARGEST, "correction of a joint, max", "mm", "21 joints", lambda pair: largest(joint_shift(pair))),
    *map(_force_figure, range(len(FINGERS))),
    _repair_figure(
        "force_max", "force of a finger, max", "N", "of the coupling",
        lambda pair: math.nan if pair.force is None else largest(pair.force),
    ),
)  # fmt: skip
"""Every figure, in the order of the table."""
