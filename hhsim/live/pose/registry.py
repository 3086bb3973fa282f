"""Sources of the palm's pose, which few gloves give; a new one is a class in this package and a line of `POSES`."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from hhsim.errors import UnknownNameError

if TYPE_CHECKING:
    from hhsim.arrays import FloatArray
    from hhsim.live.device import GloveDevice
    from hhsim.live.playback import Playback
    from hhsim.live.shared_memory import SharedBlock


@dataclass(frozen=True)
class Pose:
    """Source of the palm's pose that can be chosen."""

    about: str  # description in half a line
    # Its `PoseSource`, as "module:Class"; called with a `PoseConfig` and the session's status block, or the glove if
    # `by_glove`.
    source: str
    placed: bool = False  # True if it is, or begins, at a configured pose
    plays: bool = False  # True if it plays a motion
    back: float = 0.0  # distance of the default beginning from the grasp [m]
    by_glove: bool = False  # True if the glove gives it


POSES = {
    # Its user comes to the object.
    "keyboard": Pose("moved with keys", "hhsim.live.pose.sources:FixedPose", placed=True, back=0.06),
    "fixed": Pose("at one place", "hhsim.live.pose.sources:FixedPose", placed=True),
    "replay": Pose("as in --trajectory", "hhsim.live.pose.sources:ReplayPose", plays=True),
    "udp": Pose("by packets of a tracker", "hhsim.live.pose.udp_tracker:UdpPose"),
    "glove": Pose(
        "as a glove says that knows it", "hhsim.live.pose.sources:GlovePose", placed=True, back=0.06, by_glove=True
    ),
}
"""Sources by name, each imported when it is made: a loop without a tracker needs no sockets."""
USUAL_POSE_PORT = 24172


@dataclass(frozen=True)
class PoseConfig:
    """Settings of a pose source."""

    kind: str = "fixed"  # one of `POSES`
    # Pose of `fixed`, and first one of `keyboard` and `glove` [m], (w, x, y, z), world.
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    playback: "Playback | None" = None  # motion of `replay`; the same as the glove's keeps palm and fingers together
    host: str = "127.0.0.1"  # sender of the packets of `udp`
    port: int = USUAL_POSE_PORT  # port at which they arrive


class PoseSource(ABC):
    """Source of the palm's pose in the world frame; `read` never blocks."""

    name: str

    def open(self) -> None:
        """Connect; raises DeviceError if the source cannot be reached."""
        return

    def descriptors(self) -> tuple[int, ...]:
        """File descriptors to poll for a new pose."""
        return ()

    @abstractmethod
    def read(self, now_ns: int, position_out: "FloatArray", orientation_out: "FloatArray") -> int:
        """Write the newest pose: palm origin [m], shape (3,), and unit (w, x, y, z), shape (4,), all finite.

        Returns CLOCK_MONOTONIC [ns] at which it came; `now_ns`, that of the tick, if it cannot age, -1 if there is none
        yet and nothing was written.
        """

    def close(self) -> None:
        """Disconnect; never raises."""
        return


def make_pose_source(
    config: PoseConfig, status: "SharedBlock | None" = None, glove: "GloveDevice | None" = None
) -> PoseSource:
    """Make a source, not yet opened, of a session with a status block (`LIVE_STATUS`) and a glove.

    UnknownNameError for no such kind, InputError for an invalid pose, or a missing motion or glove.
    """
    if config.kind not in POSES:
        raise UnknownNameError("pose source", config.kind, POSES)
    pose = POSES[config.kind]
    source: PoseSource = resolve_name(pose.source)(config, glove if pose.by_glove else status)
    return source
