"""Simulated glove, which needs no hardware."""

from hhsim.live.devices.registry import Glove

GLOVE = Glove(
    about="a simulated one, which needs no hardware",
    driver="hhsim.live.drivers.played:SimGlove",
    plays=True,
    holds=False,
)
