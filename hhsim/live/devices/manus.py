"""A MANUS glove at NVIDIA's Isaac Teleop: a hand that OpenXR tracks, and five motors that shake its fingers."""

from dataclasses import dataclass

from hhsim.live.devices.openxr import HandOptions
from hhsim.live.devices.registry import Glove, setting


@dataclass(frozen=True)
class ManusOptions(HandOptions):
    """Settings of a MANUS glove.

    Attributes:
        full_force: On a finger at which its motor has full power [N].
    """

    full_force: float = setting(2.0, "Force on a finger that shakes it with full power", "N", unit="N", least=0.01)


GLOVE = Glove(
    about="a MANUS glove at Isaac Teleop, by a bridge",
    driver="hhsim.live.drivers.manus:ManusGlove",
    options=ManusOptions,
    palm=True,
)
