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
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.metrics.field.hands import FieldHands, FieldPair
from hhsim.metrics.field.volume import SEGMENTS, volumes
from hhsim.metrics.run_metric import Figure, each_with

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

    compute: Callable[[FieldPair, FieldHands], float]  # figure of one of the pair's hands; NaN where it is undefined
    of_repair: bool = False  # True for one that compares both hands: the recorded one has none
    parameters: str | Callable[[FieldPair], str] = ""  # parameters of the definition, as the table prints them


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


def joint_shift(pair: FieldPair) -> FloatArray:
    """Compute the distance of each repaired joint from the recorded one [m], shape (T, 21); NaN in missing frames."""
    shift = np.linalg.norm(pair.repaired.joints - pair.recorded.joints, axis=2)
    return np.where(pair.known[:, None], shift, np.nan)


def was_inside(pair: FieldPair) -> BoolArray:
    """Return the frames whose recorded hand was inside the object by more than `INSIDE`, shape (T,)."""
    hands = pair.recorded
    return np.asarray(np.minimum(hands.distance, hands.joint_distance.min(axis=1)) < -INSIDE)


def _depth(
    statistic: Statistic, distance: Callable[[FieldHands], FloatArray | None], _: FieldPair, hands: FieldHands
) -> float:
    return statistic(depths(distance(hands)))


def _volume(statistic: Statistic, pair: FieldPair, hands: FieldHands) -> float:
    return statistic(volumes(hands, pair.volume_frames))


def _motion(order: int, _: FieldPair, hands: FieldHands) -> float:
    """Mean norm of the joints' acceleration [m/s²], of order 2, or jerk [m/s³], of order 3, in the world."""
    return derivative_norm(hands.time, hands.world_joints, order)


def _acceleration_ratio(pair: FieldPair, _: FieldHands) -> float:
    before, after = (_motion(2, pair, hands) for hands in pair.both)
    return after / before if before > 0.0 else math.nan


def _frames_in_contact(limit: float, _: FieldPair, hands: FieldHands) -> float:
    return 100.0 * mean(np.where(hands.known, hands.distance <= limit, np.nan))


def _fingertips_in_contact(limit: float, _: FieldPair, hands: FieldHands) -> float:
    return 100.0 * mean(np.where(hands.known[:, None], hands.finger_distance <= limit, np.nan))


def _contacts_kept(limit: float, pair: FieldPair, _: FieldHands) -> float:
    """Share of the recording's contacts of a frame and a fingertip that the repair has [%]; NaN if none."""
    before, after = (hands.finger_distance[pair.known] <= limit for hands in pair.both)
    return 100.0 * float(after[before].mean()) if before.any() else math.nan


def _shift_inside(pair: FieldPair, _: FieldHands) -> float:
    values = joint_shift(pair).mean(axis=1)[was_inside(pair)]
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else math.nan


def _shift_of_skin(pair: FieldPair, _: FieldHands) -> float:
    if pair.recorded.skin is None or pair.repaired.skin is None:
        return math.nan
    return mean(np.linalg.norm(pair.repaired.skin - pair.recorded.skin, axis=2)[pair.known])


def _pressing_force(finger: int, pair: FieldPair, _: FieldHands) -> float:
    """Mean force of a finger over the frames in which it presses [N]; NaN if it never does."""
    force = np.zeros(0) if pair.force is None else pair.force[:, finger]
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


STATISTICS = ("max", "max", largest), ("mean", "mean of frames", mean)
SURFACES: tuple[tuple[str, str, Callable[[FieldHands], FloatArray | None]], ...] = (
    ("joints", "21 joint centres", lambda hands: hands.joint_distance),
    ("skin", "vertices of the skin", lambda hands: hands.skin_distance),
    ("cones", "surface of cones and palm spheres", lambda hands: hands.cone_distance),
)
CONTACTS: tuple[tuple[str, str, str, Callable[[float, FieldPair, FieldHands], float]], ...] = (
    ("frames_in_contact", "frames", "any point of the hand, inside counts", _frames_in_contact),
    ("fingertips_in_contact", "fingertips", "distal phalanges, inside counts", _fingertips_in_contact),
    ("contacts_kept", "contacts kept", "distal phalanges, inside counts", _contacts_kept),
)
METRICS = (
    *(
        FieldMetric(
            f"depth_{name}_{kind}", f"PD, {name}, {label}", 3, "mm", parameters=words,
            compute=partial(_depth, of, distance),
        )
        for name, words, distance in SURFACES
        for kind, label, of in STATISTICS
    ),
    *(
        FieldMetric(
            f"volume_exact_{kind}", f"IV, exact, {label}", 3, "cm³", parameters=_volume_words,
            compute=partial(_volume, of),
        )
        for kind, label, of in STATISTICS[::-1]
    ),
    *(
        FieldMetric(
            f"{name}_{1e3 * limit:g}mm", f"{label} within {1e3 * limit:g} mm", 1, "%", less_is_better=False,
            compute=partial(compute, limit), of_repair=compute is _contacts_kept, parameters=words,
        )
        for limit in THRESHOLDS
        for name, label, words, compute in CONTACTS
    ),
    FieldMetric("acceleration", "ACC", 3, "m/s²", compute=partial(_motion, 2), parameters=_rate_words),
    FieldMetric("jerk", "jerk", 1, "m/s³", compute=partial(_motion, 3), parameters=_rate_words),
    *each_with(
        FieldMetric(RATIO, "ACC, after over before", 3, compute=_acceleration_ratio, parameters=_rate_words),
        FieldMetric(
            "mpjpe", "MPJPE", 3, "mm", parameters="21 joints", compute=lambda pair, _: mean(joint_shift(pair))
        ),
        FieldMetric("mpvpe", "MPVPE", 3, "mm", parameters="vertices of the skin", compute=_shift_of_skin),
        FieldMetric(
            "correction_inside", "MPJPE, median of frames that were inside", 3, "mm", parameters="21 joints",
            compute=_shift_inside,
        ),
        FieldMetric(
            "correction_outside", "MPJPE, frames that needed nothing", 3, "mm", parameters="21 joints",
            compute=lambda pair, _: mean(joint_shift(pair)[~was_inside(pair)]),
        ),
        FieldMetric(
            LARGEST, "correction of a joint, max", 3, "mm", parameters="21 joints",
            compute=lambda pair, _: largest(joint_shift(pair)),
        ),
        *(
            FieldMetric(
                f"force_{name}", f"force of the {name} where it presses, mean", 3, "N", parameters="of the coupling",
                compute=partial(_pressing_force, finger),
            )
            for finger, name in enumerate(FINGERS)
        ),
        FieldMetric(
            "force_max", "force of a finger, max", 3, "N", parameters="of the coupling",
            compute=lambda pair, _: largest(np.zeros(0) if pair.force is None else pair.force),
        ),
        of_repair=True,
    ),
)  # fmt: skip
"""Every figure, in the order of the table."""
