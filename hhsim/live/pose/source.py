"""Where the palm is: gloves do not say, so the pose comes from elsewhere. What a source is, and which are there."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from hhsim.live.playback import Playback

POSES = {
    "keyboard": "moved with keys",
    "fixed": "at one place",
    "replay": "as in --trajectory",
    "udp": "by packets of a tracker",
}
"""Sources by their names: what each is, in half a line. `hhsim.live.pose.registry` makes them."""
USUAL_POSE_PORT = 24172


@dataclass(frozen=True)
class PoseConfig:
    """Settings of a pose source.

    Attributes:
        kind: One of `POSES`.
        position: Of `fixed`, and where `keyboard` begins [m], world.
        orientation: Of `fixed`, and where `keyboard` begins, (w, x, y, z).
        playback: Motion of `replay`; the glove's own keeps palm and fingers together.
        host: From which the packets of `udp` come.
        port: Where they arrive.
    """

    kind: str = "fixed"
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    playback: "Playback | None" = None
    host: str = "127.0.0.1"
    port: int = USUAL_POSE_PORT


class PoseSource(ABC):
    """Gives the palm's pose in the world frame; `read` never blocks."""

    name: str
    may_stop: bool = False
    """Whether the source can go silent, so that its age counts as the input's."""

    def open(self) -> None:
        """Connect, where there is something to connect to.

        Raises:
            DeviceError: It cannot be reached.
        """
        return

    @abstractmethod
    def read(self, now_ns: int, position_out: "NDArray[np.float64]", orientation_out: "NDArray[np.float64]") -> int:
        """Write the newest pose.

        Args:
            now_ns: CLOCK_MONOTONIC of the tick [ns].
            position_out: Palm origin [m], shape (3,).
            orientation_out: Unit (w, x, y, z), shape (4,).

        Returns:
            CLOCK_MONOTONIC [ns] at which this pose came; `now_ns` where it cannot grow old, -1 where there is none yet
            (nothing is written then). Never anything that is not finite.
        """

    def close(self) -> None:
        """Let go; never raises."""
        return
