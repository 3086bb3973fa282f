"""Joint angles of hhsim's hand from the directions of recorded finger bones.

The abduction is the plane nearest to the three bones: the least eigenvector of a 2 × 2 matrix, which is defined for a
fist too. The flexions are angles in that plane. Live tracking computes the same; recordings are fitted over time by
`hhsim.recordings.joint_fit`. Bones of a recording are medians.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import BREADTH_PER_LENGTH, DEFAULT_HAND_LENGTH, MIRROR, PALM_CENTER, default_fingers
from hhsim.hand.quaternion import conjugate, quaternion_product
from hhsim.kernels.hand.tracked_hand import EXACT, LEAST, STRAIGHT
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import in_palm, quaternions_of, turned


def finger_angles(bones: FloatArray, side: HandSide) -> tuple[FloatArray, FloatArray]:
    """Compute the flexion and abduction that fit recorded bones best.

    `bones` are directions of the three bones of each finger from base to tip (thumb: metacarpal first), palm frame, any
    length, NaN where missing, shape (T, 5, 3, 3). Returns flexion, shape (T, 5, 3), and abduction, shape (T, 5) [rad];
    NaN where a bone of the finger is missing.
    """
    distal, dorsal, across = finger_axes(side)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    along, aside, above = (np.einsum("tfki,fi->tfk", unit, axes) for axes in (distal, across, dorsal))
    # The flexion axis is cos β · across - sin β · distal; β minimises the bones' components along it.
    pp, pq, qq = (aside**2).sum(axis=2), (aside * along).sum(axis=2), (along**2).sum(axis=2)
    off_plane = np.maximum(0.5 * (pp + qq - np.hypot(pp - qq, 2.0 * pq)), 0.0)
    qq = qq + STRAIGHT * off_plane / (off_plane + EXACT) + LEAST
    abduction = 0.5 * np.arctan2(2.0 * pq, qq - pp)
    cosine, sine = np.cos(abduction)[..., None], np.sin(abduction)[..., None]
    forward = cosine * along + sine * aside
    total = np.arctan2(-above, forward)
    # A finger that curls past straight back has turned further, not less: a joint flexes by up to 200° or hyperextends
    # by up to 90°, so it turns within (-π/2, 3π/2].
    turn = (np.diff(total, axis=2) + 0.5 * np.pi) % (2.0 * np.pi) - 0.5 * np.pi
    total[..., 1:] = total[..., :1] + np.cumsum(turn, axis=2)
    return np.diff(total, axis=2, prepend=0.0), abduction


@lru_cache
def usual_fingers(side: HandSide = "right") -> dict[str, FloatArray]:
    """Return the default hand's fingers, as `hhsim.hand.model.default_fingers`, mirrored for a left hand."""
    sizes = default_fingers(DEFAULT_HAND_LENGTH, BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH)
    mirror = MIRROR if side == "left" else np.ones(3)
    return sizes | {key: sizes[key] * mirror for key in ("base", "distal", "dorsal")}


class FingerAxes(NamedTuple):
    """Unit axes of a hand's fingers at zero abduction, palm frame, shape (5, 3) each.

    Along the straight finger, out of its back, about which it abducts, and of a positive abduction, to the thumb.
    """

    distal: FloatArray
    dorsal: FloatArray
    across: FloatArray


@lru_cache
def finger_axes(side: HandSide) -> FingerAxes:
    """Return the default hand's finger axes."""
    distal, dorsal = (usual_fingers(side)[key] for key in ("distal", "dorsal"))
    distal = distal / np.linalg.norm(distal, axis=1, keepdims=True)
    dorsal = dorsal - np.einsum("fi,fi->f", dorsal, distal)[:, None] * distal
    dorsal /= np.linalg.norm(dorsal, axis=1, keepdims=True)
    return FingerAxes(distal, dorsal, (-1.0 if side == "left" else 1.0) * np.cross(dorsal, distal))


def finger_joints(
    base: FloatArray, length: FloatArray, flexion: FloatArray, abduction: FloatArray, axes: FingerAxes
) -> FloatArray:
    """Compute joints and tips of fingers of any size in a posture [m], palm frame, shape (T, 5, 4, 3).

    `base` has the fingers' first joints and `length` their bones' lengths [m], shape (5, 3) each; the angles [rad] have
    the shapes (T, 5, 3) and (T, 5).
    """
    distal, dorsal, across = axes
    turn = abduction[..., None]
    forward = np.cos(turn) * distal + np.sin(turn) * across
    total = np.cumsum(flexion, axis=2)[..., None]
    bones = np.cos(total) * forward[:, :, None] - np.sin(total) * dorsal[:, None]
    joints = np.concatenate([np.zeros((*bones.shape[:2], 1, 3)), np.cumsum(length[..., None] * bones, axis=2)], axis=2)
    return np.asarray(base[:, None] + joints)


def palm_rotation(fingers: FloatArray, back: FloatArray) -> FloatArray:
    """Compute the palm frame (w, x, y, z), shape (T, 4), from directions (T, 3) to the fingers and out of the back."""
    with np.errstate(invalid="ignore", divide="ignore"):
        y = fingers / np.linalg.norm(fingers, axis=1, keepdims=True)
        z = back - np.einsum("ti,ti->t", back, y)[:, None] * y
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        frame = np.stack([np.cross(y, z), y, z], axis=2)
    # A direction whose square is lost points nowhere.
    frame[~np.isfinite(frame).all(axis=(1, 2))] = np.nan
    return quaternions_of(frame)


def palm_from_knuckles(knuckles: FloatArray, wrist: FloatArray, side: HandSide) -> FloatArray:
    """Compute the palm frame (w, x, y, z), shape (T, 4), from the knuckles (T, 4, 3) and the wrist (T, 3), any unit."""
    return quaternion_product(_from_knuckles(knuckles, wrist, side), palm_in_knuckles(side))


@lru_cache
def palm_in_knuckles(side: HandSide) -> FloatArray:
    """Return the model's palm frame in the frame of its wrist and knuckles, a quaternion (w, x, y, z), shape (1, 4)."""
    return conjugate(_from_knuckles(usual_fingers(side)["base"][None, 1:], usual_wrist(side)[None], side))


def usual_wrist(side: HandSide) -> FloatArray:
    """Return the default hand's wrist [m], palm frame, shape (3,)."""
    distal, lateral = PALM_CENTER
    middle = np.array([lateral * BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH, -distal * DEFAULT_HAND_LENGTH, 0.0])
    return np.asarray(middle * (MIRROR if side == "left" else 1.0))


def _from_knuckles(knuckles: FloatArray, wrist: FloatArray, side: HandSide) -> FloatArray:
    """Return a frame with y from the wrist to the centre of the knuckles and z out of the back."""
    across = (knuckles[:, 3] - knuckles[:, 0]) * (-1.0 if side == "left" else 1.0)
    along = knuckles.mean(axis=1) - wrist
    return palm_rotation(along, np.cross(across, along))


def palm_origin(knuckles: FloatArray, orientation: FloatArray, side: HandSide) -> FloatArray:
    """Compute the palm origin [m], shape (T, 3), that puts the model's knuckles, in the middle, at recorded ones."""
    return np.asarray(knuckles.mean(axis=1) - turned(orientation, middle_of_knuckles(side)))


@lru_cache
def middle_of_knuckles(side: HandSide) -> FloatArray:
    """Return the centre of the model's knuckles [m], palm frame, shape (3,)."""
    return np.asarray(usual_fingers(side)["base"][1:].mean(axis=0))


@dataclass(frozen=True, eq=False)
class RecordedBones:
    """Sizes of the recorded hand, palm frame, and the error of its fit."""

    hand: HandSide
    hand_length: float  # length from wrist to middle fingertip [m]
    base: FloatArray  # first joint of each finger [m], shape (5, 3), from the palm's origin in the recording
    length: FloatArray  # distances between joints, the last one to the tip [m], shape (5, 3)
    radius: FloatArray | None  # radii at the joints and the tip [m], shape (5, 4); None if not recorded
    tip_on_surface: bool  # True if the tip is a point of the skin, False if it is the centre of the fingertip's sphere
    rms: FloatArray  # root mean square of the fit's error of each finger over joints, tip and samples [m], shape (5,)
    largest: FloatArray  # largest error of each finger [m], shape (5,)

    def to_json(self) -> dict[str, dict[str, object]]:
        """Return the fit finger by finger, SI units."""
        held = {"rms": self.rms, "max": self.largest, "length": self.length, "radius": self.radius}
        return {f: {key: v if v is None else v[k].tolist() for key, v in held.items()} for k, f in enumerate(FINGERS)}


def recorded_bones(
    joints: FloatArray, wrist: FloatArray, posture: HandConfiguration, hand: HandSide, radius: FloatArray | None = None
) -> RecordedBones:
    """Compute the bones of recorded fingers, and the distance of a hand of these bones from them in a posture.

    `joints` are first to last joint and tip of each finger [m], world, shape (T, 5, 4, 3), NaN where missing; `wrist`
    has shape (T, 3), the radii (T, 5, 4). Without radii the tips are points of the skin.
    """
    at = in_palm(joints - posture.position[:, None, None], posture.orientation)
    base, length = median_bones(at)
    ours = finger_joints(base, length, posture.flexion, posture.abduction, finger_axes(hand))
    rms, largest = fit_error(at, ours)
    usual = None if radius is None else _finite(np.median, radius)
    palm = np.linalg.norm(joints[:, 2, 0] - wrist, axis=1)
    tip = 0.0 if usual is None else float(usual[2, 3])
    return RecordedBones(
        hand=hand,
        hand_length=float(_finite(np.median, palm) + length[2].sum() + tip),
        base=base,
        length=length,
        radius=usual if usual is not None and np.isfinite(usual).all() else None,
        tip_on_surface=usual is None,
        rms=rms,
        largest=largest,
    )


def fit_error(joints: FloatArray, ours: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute each finger's root mean square and largest distance between joints (T, 5, 4, 3) [m], shape (5,) each."""
    off = np.linalg.norm(joints - ours, axis=3).swapaxes(1, 2).reshape(-1, len(FINGERS))
    return np.sqrt(_finite(np.mean, off**2)), np.nan_to_num(_finite(np.max, off))


def median_bones(joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return median first joints and bone lengths [m], (5, 3), of joints (T, 5, 4, 3), palm frame, NaN if missing."""
    lengths = np.linalg.norm(np.diff(joints, axis=2), axis=3)
    return _finite(np.median, joints[:, :, 0]), _finite(np.median, lengths)


def _finite(statistic: Callable[[FloatArray], Any], rows: FloatArray) -> FloatArray:
    """Return a statistic of each column's finite values, NaN if it has none."""
    columns = [column[np.isfinite(column)] for column in rows.reshape(len(rows), -1).T]
    values = [statistic(column) if column.size else np.nan for column in columns]
    return np.array(values).reshape(rows.shape[1:])
