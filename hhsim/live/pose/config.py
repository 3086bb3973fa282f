"""Which pose of the palm: its settings as plain values."""

from dataclasses import dataclass

from hhsim.live.playback import Playback

POSE_KINDS = ("keyboard", "fixed", "replay", "udp")
USUAL_POSE_PORT = 24172


@dataclass(frozen=True)
class PoseConfig:
    """Settings of a pose source.

    Attributes:
        kind: one of `POSE_KINDS`.
        position: of `fixed`, and where `keyboard` begins [m], world.
        orientation: of `fixed`, and where `keyboard` begins, (w, x, y, z).
        playback: motion of `replay`; the glove's own keeps palm and fingers together.
        host: from which the packets of `udp` come.
        port: where they arrive; 0 for the usual one, `USUAL_POSE_PORT`.
    """

    kind: str = "fixed"
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    playback: Playback | None = None
    host: str = "127.0.0.1"
    port: int = 0

    @property
    def port_used(self) -> int:
        """The port, or the usual one."""
        return self.port or USUAL_POSE_PORT
