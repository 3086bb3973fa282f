"""Correction of a recorded hand: the rigid motion of each of its bones, and what follows for its joints.

A corrected bone is the recorded one, moved rigidly: what our hand model does not fit stays as recorded.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_from_matrix, quaternion_product
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.recording import Recording

BONES = 16
"""Bones of a hand: the palm, then three phalanges a finger from its base, thumb to little finger."""
ANGLE_DIGITS = 7
"""Decimals of an angle [rad] or of a quaternion's component in a text: 0.01 µm at a fingertip."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected hand of each sample of a recording, in our world."""

    fitted: HandConfiguration  # our hand fitted to each recorded sample
    posture: HandConfiguration  # our hand after the correction; equal to `fitted` in samples without one
    rotation: FloatArray  # rotation of each bone from the recorded to the corrected hand, shape (T, 16, 3, 3)
    # Corrected joint centres in the order of `hhsim.recordings.joint_names.KEYPOINTS` [m], shape (T, 21, 3); NaN where
    # the recording has none.
    joints: FloatArray
    changed: BoolArray  # samples with a correction, shape (T,)


def moved_joints(joints: FloatArray, origin: FloatArray, shift: FloatArray, rotation: FloatArray) -> FloatArray:
    """Move recorded joints with their bones, each of which keeps its length.

    The joints [m], shape (T, 21, 3), are in the order of `KEYPOINTS`; the palm origin of the fitted hand and its
    displacement [m] have shape (T, 3), the rotations of the bones (T, 16, 3, 3).
    """
    moved = np.empty_like(joints)
    palm = rotation[:, 0]
    moved[:, 0] = _turned(palm, joints[:, 0] - origin) + origin + shift
    for finger in range(5):
        first = 1 + 4 * finger
        moved[:, first] = _turned(palm, joints[:, first] - origin) + origin + shift
        for bone in range(3):
            along = joints[:, first + bone + 1] - joints[:, first + bone]
            turned = _turned(rotation[:, 1 + 3 * finger + bone], along)
            moved[:, first + bone + 1] = moved[:, first + bone] + turned
    return moved


def _turned(rotation: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray((rotation @ vectors[..., None])[..., 0])


class Changes(NamedTuple):
    """Samples of a recording with a correction, in the coordinates of its file."""

    samples: IntArray  # indices of the samples, shape (N,)
    rows: IntArray  # rows of the file, shape (N,)
    shift: FloatArray  # displacement of the 21 joints, shape (N, 21, 3); NaN for a recording of angles
    turn: FloatArray  # rotation of each bone, shape (N, 16, 3, 3)
    centre: FloatArray  # palm origin of the fitted hand, shape (N, 3)
    move: FloatArray  # displacement of the palm origin, shape (N, 3)
    angles: FloatArray  # change of flexion finger by finger, then abduction [unit of the file], shape (N, 20)
    digits: int  # decimals of a length in a text that hold 1 µm

    def moved(self, joint: str, points: FloatArray) -> FloatArray:
        """Move points of one of OpenXR's joints, shape (N, 3); those beyond the 21 move with the palm."""
        if joint in KEYPOINTS:
            return np.asarray(points + self.shift[:, KEYPOINTS.index(joint)])
        return _turned(self.turn[:, 0], points - self.centre) + self.centre + self.move

    def motion(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return all samples of palm poses and of angles with the changes; NaN stays what it was.

        The shapes are (T, 3), (T, 4), (T, 5, 3) and (T, 5).
        """
        given, rows = (position.copy(), orientation.copy(), flexion.copy(), abduction.copy()), self.rows
        new = (
            self.moved("palm", position[rows]),
            quaternion_product(quaternion_from_matrix(self.turn[:, 0]), orientation[rows]),
            flexion[rows] + self.angles[:, :15].reshape(-1, 5, 3),
            abduction[rows] + self.angles[:, 15:],
        )
        for values, corrected in zip(given, new):
            values[rows] = np.where(np.isfinite(corrected), corrected, values[rows])
        return given


def changes(recording: Recording, correction: Correction) -> Changes:
    """Express a correction in the coordinates of the recording's file; InputError for joints without a world frame."""
    if recording.joints is None and recording.bones is not None:
        raise InputError("the joints have no world frame, so they cannot be corrected in the file: say --world-up")
    samples = np.flatnonzero(correction.changed)
    frame, fitted, posture = recording.file_frame, correction.fitted.at(samples), correction.posture.at(samples)
    shift = np.full((len(samples), len(KEYPOINTS), 3), np.nan)
    if recording.joints is not None:
        shift = frame.to_file(correction.joints[samples] - recording.joints[samples])
    flexion = (posture.flexion - fitted.flexion).reshape(-1, 15)
    return Changes(
        samples=samples,
        rows=recording.rows[samples],
        shift=shift,
        turn=frame.rotation_to_file(correction.rotation[samples]),
        centre=frame.to_file(fitted.position),
        move=frame.to_file(posture.position - fitted.position),
        angles=np.concatenate([flexion, posture.abduction - fitted.abduction], axis=1) / recording.angle_unit,
        digits=max(0, int(np.ceil(6.0 + np.log10(frame.metre) - 1e-9))),
    )
