"""Where the palm is: gloves do not say, so the pose comes from elsewhere."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PoseSource(ABC):
    """Gives the palm's pose in the world frame; `read` never blocks."""

    name: str
    may_stop: bool = False
    """Whether the source can go silent, so that its age counts as the input's."""

    def open(self) -> None:
        """Connect, where there is something to connect to.

        Raises:
            DeviceError: it cannot be reached.
        """
        return

    @abstractmethod
    def read(self, now_ns: int, position_out: Array, orientation_out: Array) -> int:
        """Write the newest pose.

        Args:
            now_ns: CLOCK_MONOTONIC of the tick [ns].
            position_out: palm origin [m], shape (3,).
            orientation_out: unit (w, x, y, z), shape (4,).

        Returns:
            CLOCK_MONOTONIC [ns] at which this pose came; `now_ns` where it cannot grow old, -1 where there is none yet
            (nothing is written then). Never anything that is not finite.
        """

    def close(self) -> None:
        """Let go; never raises."""
        return
