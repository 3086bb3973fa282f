"""A hand that any OpenXR headset tracks, through a bridge that sends its joints."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, GloveOptions, setting


@dataclass(frozen=True)
class HandOptions(GloveOptions):
    """Settings of a hand that is tracked by a headset.

    Attributes:
        host: Of the bridge.
        port: Where its samples arrive; commands, if any, go to the next one.
    """

    host: str = setting("127.0.0.1", "Where the glove's server is", "HOST")
    port: int = setting(24170, "Port of the glove's server", "PORT", least=1, most=65535)


GLOVE = Glove(
    about="a bare hand that an OpenXR headset tracks, by a bridge",
    driver="hhsim.live.drivers.openxr:OpenXrHand",
    options=HandOptions,
    holds=False,
    palm=True,
)
