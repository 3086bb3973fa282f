"""Where the palm is: the source that settings mean."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.errors import InputError, UnknownNameError
from hhsim.live.playback import Playback
from hhsim.live.pose.source import POSES, PoseConfig, PoseSource
from hhsim.live.shared_memory import SharedBlock

Array = NDArray[np.float64]


def make_pose_source(config: PoseConfig, status: SharedBlock | None = None) -> PoseSource:
    """The source, not yet opened.

    Args:
        config: Which.
        status: Block of `LIVE_STATUS`, which `keyboard` reads.

    Raises:
        UnknownNameError: No such kind.
        InputError: A pose that is none, or what the source needs is missing.
    """
    if config.kind == "fixed":
        return FixedPose(config.position, config.orientation)
    if config.kind == "keyboard":
        if status is None:
            raise InputError("a pose from the keyboard needs the session's status block")
        return KeyboardPose(config.position, config.orientation, status)
    if config.kind == "replay":
        if config.playback is None:
            raise InputError("pose replay has no motion; expected a trajectory")
        return ReplayPose(config.playback)
    if config.kind == "udp":
        # A loop without a tracker does without sockets.
        from hhsim.live.pose.udp_tracker import UdpPose

        return UdpPose(config)
    raise UnknownNameError("pose source", config.kind, POSES)


def write_keyboard_pose(status: SharedBlock, position: ArrayLike, orientation: ArrayLike) -> None:
    """Move the palm that `keyboard` reads, whole or not at all; there is one writer.

    Args:
        status: Block of `LIVE_STATUS`.
        position: [m], shape (3,), world.
        orientation: (w, x, y, z), shape (4,).

    Raises:
        InputError: A pose that is none.
    """
    place, turn = checked_pose(position, orientation)
    record = status.array[0]
    # Odd while the pose is in the making; a reader that meets an odd version, or two, tries again in the next tick.
    record["pose_version"] += 1
    record["pose_position"] = place
    record["pose_orientation"] = turn
    record["pose_version"] += 1


def checked_pose(position: ArrayLike, orientation: ArrayLike) -> tuple[Array, Array]:
    """Position [m] and unit quaternion (w, x, y, z).

    Raises:
        InputError: Wrong shape, not finite, or a quaternion of length zero.
    """
    place, turn = np.asarray(position, np.float64), np.asarray(orientation, np.float64)
    if place.shape != (3,) or turn.shape != (4,):
        raise InputError(f"a pose of shapes {place.shape} and {turn.shape}; expected (3,) and (4,)")
    length = float(np.linalg.norm(turn))
    if not (np.isfinite(place).all() and np.isfinite(length) and length > 1e-6):
        raise InputError(f"pose {place.tolist()}, {turn.tolist()}; expected finite numbers and a rotation")
    return place, turn / length


class FixedPose(PoseSource):
    """The palm stays where it is.

    Args:
        position: [m], world.
        orientation: (w, x, y, z).

    Raises:
        InputError: A pose that is none.
    """

    def __init__(self, position: ArrayLike, orientation: ArrayLike) -> None:
        """Check the pose."""
        self.name = "fixed pose"
        self._position, self._orientation = checked_pose(position, orientation)

    def read(self, now_ns: int, position_out: Array, orientation_out: Array) -> int:
        """See `PoseSource.read`."""
        position_out[:] = self._position
        orientation_out[:] = self._orientation
        return now_ns


class KeyboardPose(PoseSource):
    """The palm that the supervisor moves with keys, through the status block.

    Args:
        position: Before the first key [m], world.
        orientation: Before the first key, (w, x, y, z).
        status: Block of `LIVE_STATUS`.

    Raises:
        InputError: A pose that is none.
    """

    def __init__(self, position: ArrayLike, orientation: ArrayLike, status: SharedBlock) -> None:
        """Check the pose."""
        self.name = "keyboard"
        self._position, self._orientation = checked_pose(position, orientation)
        self._record = status.array[0]
        self._seen = 0

    def read(self, now_ns: int, position_out: Array, orientation_out: Array) -> int:
        """See `PoseSource.read`."""
        version = int(self._record["pose_version"])
        if version != self._seen and version % 2 == 0:
            position, orientation = self._record["pose_position"].copy(), self._record["pose_orientation"].copy()
            if int(self._record["pose_version"]) == version:
                self._seen = version
                if np.isfinite(position).all() and np.isfinite(orientation).all():
                    self._position, self._orientation = position, orientation
        position_out[:] = self._position
        orientation_out[:] = self._orientation
        return now_ns


class ReplayPose(PoseSource):
    """The palm of a motion, between samples on the straight way from one to the next.

    Args:
        playback: The motion, begun with the first read.
    """

    def __init__(self, playback: Playback) -> None:
        """Nothing is read yet."""
        self.name = f"replay of {playback.trajectory.name or 'a motion'}"
        self._playback = playback

    def read(self, now_ns: int, position_out: Array, orientation_out: Array) -> int:
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
