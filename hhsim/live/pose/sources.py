"""Palm that stays at one place until keys move it, goes with a glove that says where it is, or plays a motion."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.device import GloveDevice
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


class GlovePose(PoseSource):
    """Palm that begins at the configured position and moves from there as the hand does.

    The orientation is the hand's own: both worlds have the same up. InputError for an invalid pose, or a glove without
    a `palm`.
    """

    name = "pose of the glove"

    def __init__(self, config: PoseConfig, glove: GloveDevice | None = None) -> None:
        if glove is None or glove.palm is None:
            raise InputError("pose glove: this glove does not say where the palm is; expected openxr or manus")
        self._palm = glove.palm
        self._begin = checked_pose(config.position, config.orientation)[0]
        self._first: FloatArray | None = None

    def read(self, now_ns: int, position_out: FloatArray, orientation_out: FloatArray) -> int:
        """See `PoseSource.read`."""
        palm = self._palm
        if palm.came_ns >= 0:
            if self._first is None:
                self._first = palm.position.copy()
            np.subtract(palm.position, self._first, out=position_out)
            position_out += self._begin
            orientation_out[:] = palm.orientation
        return palm.came_ns


class ReplayPose(PoseSource):
    """Palm of the configuration's `playback`, begun by the first read, linear between samples; else InputError."""

    def __init__(self, config: PoseConfig, status: object = None) -> None:
        if config.playback is None:
            raise InputError("pose replay has no motion; expected a trajectory")
        self.name = f"replay of {config.playback.trajectory.name or 'a motion'}"
        self._playback = config.playback

    def read(self, now_ns: int, position_out: FloatArray, orientation_out: FloatArray) -> int:
        """See `PoseSource.read`."""
        motion = self._playback.trajectory
        before, after, share = self._playback.place(self._playback.elapsed(now_ns))
        position_out[:] = (1.0 - share) * motion.position[before] + share * motion.position[after]
        first, second = motion.orientation[before], motion.orientation[after]
        if first @ second < 0.0:
            second = -second
        orientation_out[:] = (1.0 - share) * first + share * second
        length = np.linalg.norm(orientation_out)
        if length > 1e-6:
            orientation_out /= length
        else:
            orientation_out[:] = first
        return now_ns
