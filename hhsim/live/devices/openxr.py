"""Hand that any OpenXR headset tracks, through a bridge that sends its joints."""

from hhsim.live.devices.registry import Glove, ReachedOptions

GLOVE = Glove(
    about="a bare hand that an OpenXR headset tracks, by a bridge",
    driver="hhsim.live.drivers.openxr:OpenXrHand",
    options=ReachedOptions,
    holds=False,
    palm=True,
)
