"""Any glove, through a bridge that speaks the open packet of `hhsim.live.link.udp_codec`."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ServedOptions, setting


@dataclass(frozen=True)
class UdpOptions(ServedOptions):
    """Settings of a glove with a bridge.

    Attributes:
        port: Where its samples arrive; commands go to the next one.
    """

    port: int = setting(24170, "Port of the glove's server", "PORT", least=1, most=65535)


GLOVE = Glove(
    about="any other, by a bridge that speaks an open packet",
    driver="hhsim.live.drivers.udp:UdpGlove",
    options=UdpOptions,
    calibration="hhsim.live.drivers.calibration:glove_calibration",
)
