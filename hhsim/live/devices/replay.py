"""Recorded motion in the place of a glove."""

from hhsim.live.devices.registry import Glove

GLOVE = Glove(
    about="a recording in the place of one",
    driver="hhsim.live.drivers.played:ReplayGlove",
    plays=True,
    ends=True,
    holds=False,
)
