"""Palm that stays at one place until keys move it."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.pose.registry import PoseConfig, PoseSource
from hhsim.live.shared_memory import SharedBlock


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
    """Palm at the pose of its configuration, or where the supervisor's keys have moved it through the status block.

    Without a status block (`LIVE_STATUS`) nothing moves it. InputError for an invalid first pose.
    """

    def __init__(self, config: PoseConfig, status: SharedBlock | None = None) -> None:
        self.name = "fixed pose" if config.kind == "fixed" else config.kind
        self._position, self._orientation = checked_pose(config.position, config.orientation)
        self._record = None if status is None else status.array[0]
        self._seen = 0

    def read(self, now_ns: int, position_out: FloatArray, orientation_out: FloatArray) -> int:
        """See `PoseSource.read`."""
        record = self._record
        version = self._seen if record is None else int(record["pose_version"])
        # Take a pose that is new, whole and finite.
        if record is not None and version != self._seen and version % 2 == 0:
            position, orientation = record["pose_position"].copy(), record["pose_orientation"].copy()
            if int(record["pose_version"]) == version:
                self._seen = version
                if np.isfinite(position).all() and np.isfinite(orientation).all():
                    self._position, self._orientation = position, orientation
        position_out[:] = self._position
        orientation_out[:] = self._orientation
        return now_ns
