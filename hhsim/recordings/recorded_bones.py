"""Bones and radii of the hand in a recording of joint centres, and the error of our hand's fit to them.

Bones are medians over the recording. The fit's error is the distance from each recorded joint to that of a hand of
these bones in the fitted posture.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_axes, finger_joints
from hhsim.recordings.frames import in_palm

BONE_CHANGE = 0.01
"""Deviation of a bone from its median length that is told [m]: no bone grows so, one of its joints is misplaced."""


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
        return {
            finger: {
                "rms": float(self.rms[f]),
                "max": float(self.largest[f]),
                "length": self.length[f].tolist(),
                "radius": None if self.radius is None else self.radius[f].tolist(),
            }
            for f, finger in enumerate(FINGERS)
        }


def recorded_bones(
    joints: FloatArray, wrist: FloatArray, posture: HandConfiguration, hand: HandSide, radius: FloatArray | None = None
) -> RecordedBones:
    """Compute the bones of recorded fingers, and the distance of a hand of these bones from them in a posture.

    `joints` are first to last joint and tip of each finger [m], world, shape (T, 5, 4, 3), NaN where missing; `wrist`
    its centre [m], shape (T, 3); `radius` the radii at joints and tip [m], shape (T, 5, 4), None if not recorded: then
    the tips are points of the skin.
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


def misplaced_joints(joints: FloatArray, wrist: FloatArray) -> list[str]:
    """Return a line about samples in which a bone is longer or shorter than its median by `BONE_CHANGE`; else none.

    The joints have the shape (T, 5, 4, 3), the wrist (T, 3) [m].
    """
    chain = np.concatenate([np.broadcast_to(wrist[:, None, None], (len(joints), 5, 1, 3)), joints], axis=2)
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(np.diff(chain, axis=2), axis=3)
        off = np.nan_to_num(np.abs(lengths - _finite(np.median, lengths)), posinf=np.inf).max(axis=(1, 2))
    found = np.flatnonzero(off > BONE_CHANGE)
    if not found.size:
        return []
    return [
        f"{found.size} of {len(off)} samples with a bone of another length than its median, by up to "
        f"{1e3 * off.max():.3g} mm, first sample {found[0]}: joints are misplaced there"
    ]


def _finite(statistic: Callable[[FloatArray], Any], rows: FloatArray) -> FloatArray:
    """Return a statistic of each column's finite values, NaN if it has none."""
    columns = [column[np.isfinite(column)] for column in rows.reshape(len(rows), -1).T]
    values = [statistic(column) if column.size else np.nan for column in columns]
    return np.array(values).reshape(rows.shape[1:])
