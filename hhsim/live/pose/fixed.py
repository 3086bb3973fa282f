"""Palm that stays at one place."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.pose.registry import PoseConfig, PoseSource


def checked_pose(position: ArrayLike, orientation: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return position [m] and unit quaternion (w, x, y, z); InputError for wrong shapes, NaN or no rotation."""
    place, turn = np.asarray(position, np.float64), np.asarray(orientation, np.float64)
    if place.shape != (3,) or turn.shape != (4,):
        raise InputError(f"a pose of shapes {place.shape} and {turn.shape}; expected (3,) and (4,)")
    length = float(np.linalg.norm(turn))
    if not (np.isfinite(place).all() and np.isfinite(length) and length > 1e-6):
        raise InputError(f"pose {place.tolist()}, {turn.tolist()}; expected finite numbers and a rotation")
    return place, turn / length


class FixedPose(PoseSource):
    """Palm at the `position` and `orientation` of its configuration; raises InputError for an invalid pose."""

    name = "fixed pose"

    def __init__(self, config: PoseConfig, status: object = None) -> None:
        self._position, self._orientation = checked_pose(config.position, config.orientation)

    def read(self, now_ns: int, position_out: FloatArray, orientation_out: FloatArray) -> int:
        """See `PoseSource.read`."""
        position_out[:] = self._position
        orientation_out[:] = self._orientation
        return now_ns
