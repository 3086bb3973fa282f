"""Correction of a recorded hand: the rigid motion of each of its bones, and what follows for its joints.

A corrected bone is the recorded one, moved rigidly: its length, and whatever else our hand model does not fit, stay as
recorded. A sample that needs no correction comes back as it was.
"""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration

BONES = 16
"""Bones of a hand: the palm, then three phalanges a finger from its base, thumb to little finger."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected hand of each sample of a recording, in our world.

    Attributes:
        fitted: Our hand fitted to each recorded sample.
        posture: Our hand after the correction; equal to `fitted` in samples without one.
        rotation: Rotation of each bone from the recorded to the corrected hand, shape (T, 16, 3, 3).
        joints: Corrected joint centres in the order of `hhsim.recordings.joint_names.KEYPOINTS` [m], shape
            (T, 21, 3); NaN where the recording has none.
        changed: Samples with a correction, shape (T,).
    """

    fitted: HandConfiguration
    posture: HandConfiguration
    rotation: FloatArray
    joints: FloatArray
    changed: BoolArray


def moved_joints(joints: FloatArray, origin: FloatArray, shift: FloatArray, rotation: FloatArray) -> FloatArray:
    """Move recorded joints with their bones, each of which keeps its length.

    Args:
        joints: Recorded joints in the order of `KEYPOINTS` [m], shape (T, 21, 3).
        origin: Palm origin of the fitted hand [m], shape (T, 3).
        shift: Displacement of the palm origin [m], shape (T, 3).
        rotation: Rotation of each bone, shape (T, 16, 3, 3).

    Returns:
        The moved joints [m], shape (T, 21, 3).
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
