"""Distance between samples of a recording, as one length.

A rotation of the palm counts as the displacement of a point at `PALM_ARM`, a joint angle as that of a fingertip.
"""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_vector
from hhsim.recordings.recording import Recording

PALM_ARM = 0.1
"""Distance from the palm's origin to a straight fingertip [m]."""
FINGER_ARM = 0.04
"""Usual distance from a joint to the fingertip [m]."""


def turn(first: FloatArray, second: FloatArray) -> FloatArray:
    """Compute rotation vectors [rad] from quaternions `first` to `second`, in the frame of `first`, shape (…, 3).

    The quaternions have any length and sign; NaN or a length of zero gives NaN.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        a = first / np.linalg.norm(first, axis=-1, keepdims=True)
        b = second / np.linalg.norm(second, axis=-1, keepdims=True)
        return rotation_vector(quaternion_product(conjugate(a), b))


def change(recording: Recording, first: IntArray, second: IntArray) -> FloatArray:
    """Compute the distance of samples `second` from samples `first` [m]; missing numbers count as unchanged."""
    parts = [
        recording.position[second] - recording.position[first],
        PALM_ARM * turn(recording.orientation[first], recording.orientation[second]),
        FINGER_ARM * (recording.flexion[second] - recording.flexion[first]).reshape(len(first), -1),
        FINGER_ARM * (recording.abduction[second] - recording.abduction[first]),
    ]
    square = sum(np.nansum(part * part, axis=1) for part in parts)
    return np.asarray(np.sqrt(square))


def deviation(recording: Recording, sample: int, neighbours: tuple[int, ...]) -> float:
    """Compute the distance of a sample from the nearest of the given neighbours [m]; 0 without any."""
    if not neighbours:
        return 0.0
    others = np.array(neighbours, dtype=np.int64)
    return float(change(recording, others, np.full(others.shape, sample)).min())
