"""Hand that any OpenXR headset tracks, through a bridge that sends its joints in the open packet."""

from hhsim.live.devices.registry import Glove, PacketOptions

GLOVE = Glove(
    about="a hand that an OpenXR headset tracks, bare or in a glove, by a bridge",
    driver="hhsim.live.drivers.udp:UdpGlove",
    options=PacketOptions,
    palm=True,
)
