"""A hand that any OpenXR headset tracks, through a bridge that sends its joints."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ReachedOptions, setting


@dataclass(frozen=True)
class HandOptions(ReachedOptions):
    """Settings of a hand that is tracked by a headset."""

    port: int = setting(24170, "Port of the glove's server", "PORT", least=1, most=65535)


GLOVE = Glove(
    about="a bare hand that an OpenXR headset tracks, by a bridge",
    driver="hhsim.live.drivers.openxr:OpenXrHand",
    options=HandOptions,
    holds=False,
    palm=True,
)
