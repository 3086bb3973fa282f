"""Any glove, through a bridge that speaks the open packet of `hhsim.live.open_packet`."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, PacketOptions, ServedOptions


@dataclass(frozen=True)
class UdpOptions(PacketOptions, ServedOptions):
    """Settings of a glove with a bridge, whose bends and channels can be calibrated."""


GLOVE = Glove(
    about="any other, by a bridge that speaks an open packet",
    driver="hhsim.live.drivers.udp:UdpGlove",
    options=UdpOptions,
    calibration="hhsim.live.drivers.calibration:glove_calibration",
)
