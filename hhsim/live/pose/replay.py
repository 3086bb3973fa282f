"""Palm of a recorded or scripted motion."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.pose.registry import PoseConfig, PoseSource


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
