"""The hand that a recording of joint centres was made with: its bones, its radii, and how well our hand fits them.

Bones are medians over the recording, so a tracker whose bones breathe gives one hand. The fit's error is the distance
from each recorded joint to that of a hand of these bones in the fitted posture: what a plane finger with one abduction
cannot follow, and what the bones breathe.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_joints
from hhsim.recordings.frames import in_palm


class FingerChains(NamedTuple):
    """Recorded fingers, world.

    Attributes:
        joints: First to last joint and tip of each finger [m], shape (T, 5, 4, 3), NaN where missing.
        wrist: Its middle [m], shape (T, 3).
        radius: At the same points [m], shape (T, 5, 4); None where the recording has none.
        tip_on_surface: Whether the tip is a point of the skin; else it is the centre of the fingertip's sphere.
    """

    joints: FloatArray
    wrist: FloatArray
    radius: FloatArray | None = None
    tip_on_surface: bool = True


class Posture(NamedTuple):
    """The palm and the angles that were fitted.

    Attributes:
        position: Palm origin [m], world, shape (T, 3).
        orientation: Palm to world (w, x, y, z), shape (T, 4).
        flexion: [rad], shape (T, 5, 3).
        abduction: [rad], shape (T, 5).
    """

    position: FloatArray
    orientation: FloatArray
    flexion: FloatArray
    abduction: FloatArray


@dataclass(frozen=True, eq=False)
class RecordedBones:
    """Sizes of the recorded hand, palm frame, and the error of its fit.

    Attributes:
        hand_length: Wrist to middle fingertip [m].
        base: First joint of each finger [m], shape (5, 3); the origin is that of the palm in the recording.
        length: Between joints, the last one to the tip [m], shape (5, 3).
        radius: At the joints and the tip [m], shape (5, 4); None where the recording has none.
        tip_on_surface: As in `FingerChains`.
        rms: Error of the fit of each finger over its joints, its tip and all samples, root of the mean square [m],
            shape (5,).
        largest: Its largest [m], shape (5,).
    """

    hand: HandSide
    hand_length: float
    base: FloatArray
    length: FloatArray
    radius: FloatArray | None
    tip_on_surface: bool
    rms: FloatArray
    largest: FloatArray

    def to_json(self) -> dict[str, dict[str, object]]:
        """The fit finger by finger, SI units."""
        return {
            finger: {
                "rms": float(self.rms[f]),
                "max": float(self.largest[f]),
                "length": self.length[f].tolist(),
                "radius": None if self.radius is None else self.radius[f].tolist(),
            }
            for f, finger in enumerate(FINGERS)
        }


def recorded_bones(fingers: FingerChains, posture: Posture, hand: HandSide) -> RecordedBones:
    """The bones of recorded fingers, and how far a hand of these bones is from them in a posture.

    Args:
        fingers: As recorded.
        posture: As fitted.
    """
    at = in_palm(fingers.joints - posture.position[:, None, None], posture.orientation)
    lengths = np.linalg.norm(np.diff(at, axis=2), axis=3)
    base, length = _median(at[:, :, 0]), _median(lengths)
    off = np.linalg.norm(at - finger_joints(base, length, posture.flexion, posture.abduction, hand), axis=3)
    radius = None if fingers.radius is None else _median(fingers.radius)
    palm = np.linalg.norm(fingers.joints[:, 2, 0] - fingers.wrist, axis=1)
    tip = 0.0 if fingers.tip_on_surface or radius is None else float(radius[2, 3])
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(_mean(off**2))
    return RecordedBones(
        hand=hand,
        hand_length=float(_median(palm[:, None])[0] + length[2].sum() + tip),
        base=base,
        length=length,
        radius=radius if radius is not None and np.isfinite(radius).all() else None,
        tip_on_surface=fingers.tip_on_surface,
        rms=rms,
        largest=np.array([np.max(finger[np.isfinite(finger)], initial=0.0) for finger in off.swapaxes(0, 1)]),
    )


def _median(values: FloatArray) -> FloatArray:
    """Medians over the samples of finite values, shape of a sample; NaN where there is none."""
    flat = values.reshape(len(values), -1)
    columns = [column[np.isfinite(column)] for column in flat.T]
    return np.array([np.median(column) if column.size else np.nan for column in columns]).reshape(values.shape[1:])


def _mean(values: FloatArray) -> FloatArray:
    """Means of the finite values of each finger, shape (5,); NaN where there is none."""
    fingers = [finger[np.isfinite(finger)] for finger in values.swapaxes(0, 1)]
    return np.array([finger.mean() if finger.size else np.nan for finger in fingers])
