"""Palm pose from a glove that gives it, as a hand tracked by a headset does."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.device import GloveDevice
from hhsim.live.pose.fixed import checked_pose
from hhsim.live.pose.registry import PoseConfig, PoseSource


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
