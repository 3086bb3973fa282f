"""Where the palm is: few gloves say, so the pose comes from elsewhere. What a source is, and which are there.

To add one, write its class in a module of this package and add a line to `POSES`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from hhsim.errors import UnknownNameError

if TYPE_CHECKING:
    from hhsim.arrays import FloatArray
    from hhsim.live.device import GloveDevice
    from hhsim.live.playback import Playback
    from hhsim.live.shared_memory import SharedBlock


@dataclass(frozen=True)
class Pose:
    """A source of the palm's pose that can be chosen.

    Attributes:
        about: What it is, in half a line.
        source: Its `PoseSource`, as "module:Class"; called with a `PoseConfig` and the session's status block, or with
            the glove in the block's place.
        placed: It is, or begins, where it is told to.
        plays: It makes a motion: it is given a playback.
        back: Where nobody says where it begins, so far back from where the fingers grasp [m].
        by_glove: The glove says it.
    """

    about: str
    source: str
    placed: bool = False
    plays: bool = False
    back: float = 0.0
    by_glove: bool = False


POSES = {
    # Its user comes to the object.
    "keyboard": Pose("moved with keys", "hhsim.live.pose.keyboard:KeyboardPose", placed=True, back=0.06),
    "fixed": Pose("at one place", "hhsim.live.pose.fixed:FixedPose", placed=True),
    "replay": Pose("as in --trajectory", "hhsim.live.pose.replay:ReplayPose", plays=True),
    "udp": Pose("by packets of a tracker", "hhsim.live.pose.udp_tracker:UdpPose"),
    "glove": Pose(
        "as a glove says that knows it", "hhsim.live.pose.glove:GlovePose", placed=True, back=0.06, by_glove=True
    ),
}
"""The sources that there are, by name; each is imported when it is made: a loop without a tracker needs no sockets."""
USUAL_POSE_PORT = 24172


@dataclass(frozen=True)
class PoseConfig:
    """Settings of a pose source.

    Attributes:
        kind: One of `POSES`.
        position: Of `fixed`, and where `keyboard` and `glove` begin [m], world.
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

    def open(self) -> None:
        """Connect, where there is something to connect to.

        Raises:
            DeviceError: It cannot be reached.
        """
        return

    def descriptors(self) -> tuple[int, ...]:
        """What can be waited on for a new pose; () where there is nothing to wait for."""
        return ()

    @abstractmethod
    def read(self, now_ns: int, position_out: "FloatArray", orientation_out: "FloatArray") -> int:
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


def make_pose_source(
    config: PoseConfig, status: "SharedBlock | None" = None, glove: "GloveDevice | None" = None
) -> PoseSource:
    """The source, not yet opened.

    Args:
        status: Block of `LIVE_STATUS`, which `keyboard` reads.
        glove: The session's, which `glove` asks.

    Raises:
        UnknownNameError: No such kind.
        InputError: A pose that is none, or what the source needs is missing.
    """
    if config.kind not in POSES:
        raise UnknownNameError("pose source", config.kind, POSES)
    pose = POSES[config.kind]
    module, _, name = pose.source.partition(":")
    source: PoseSource = getattr(import_module(module), name)(config, glove if pose.by_glove else status)
    return source
