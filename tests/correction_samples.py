"""Corrections of recordings that test modules share: a known motion of palm and fingers in some of the samples."""

import numpy as np
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_from_matrix, rotation_matrix
from hhsim.recordings.finger_ik import finger_axes
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Correction
from hhsim.repair.written_hand import moved_joints


def bone_turns(posture: HandConfiguration, side: str) -> FloatArray:
    """Rotations from the straight hand in the palm frame to the world, of the palm and 15 bones, (T, 16, 3, 3)."""
    distal, dorsal, _ = finger_axes("left" if side == "left" else "right")
    sign = -1.0 if side == "left" else 1.0
    palm = rotation_matrix(posture.orientation)
    bones = [palm]
    for f in range(5):
        spread = Rotation.from_rotvec(sign * posture.abduction[:, f, None] * dorsal[f]).as_matrix()
        for k in range(3):
            bend = posture.flexion[:, f, : k + 1].sum(axis=1)[:, None] * np.cross(dorsal[f], distal[f])
            bones.append(palm @ spread @ Rotation.from_rotvec(bend).as_matrix())
    return np.stack(bones, axis=1)


def a_correction(
    recording: Recording, *, changed: slice = slice(3, 9), palm: bool = True, fingers: bool = True, turn: bool = True
) -> Correction:
    """A hand that turns and moves by some millimetres and opens its fingers in some samples, if those are whole."""
    count = recording.sample_count
    mask = np.zeros(count, dtype=bool)
    mask[changed] = True
    fitted = HandConfiguration.of(recording)
    mask &= np.isfinite(recording.angles).all(axis=1) & np.isfinite(recording.position).all(axis=1)
    if recording.joints is not None:
        mask &= np.isfinite(recording.joints).all(axis=(1, 2))
    step = mask[:, None] * np.linspace(0.5, 1.0, count)[:, None]
    place = fitted.position + palm * step * [0.004, -0.003, 0.006]
    turned = Rotation.from_rotvec(palm * turn * step * [0.05, 0.02, -0.07]).as_matrix()
    palms = quaternion_from_matrix(turned @ np.nan_to_num(rotation_matrix(fitted.orientation)))
    orientation = np.where(mask[:, None], palms, fitted.orientation)
    flexion = fitted.flexion - fingers * step[:, :, None] * np.linspace(0.02, 0.15, 15).reshape(5, 3)
    posture = HandConfiguration(place, orientation, flexion, fitted.abduction + fingers * step * 0.03)
    with np.errstate(invalid="ignore"):
        whole = HandConfiguration(*(np.nan_to_num(part) for part in fitted))
        moved = HandConfiguration(*(np.nan_to_num(part) for part in posture))
        before, after = bone_turns(whole, recording.hand), bone_turns(moved, recording.hand)
    rotation = np.where(mask[:, None, None, None], after @ np.swapaxes(before, 2, 3), np.eye(3))
    joints = np.full((count, 21, 3), np.nan)
    if recording.joints is not None:
        corrected = moved_joints(recording.joints, fitted.position, posture.position, rotation)
        joints = np.where(mask[:, None, None], corrected, recording.joints)
    return Correction(fitted, posture, rotation, joints, mask)
