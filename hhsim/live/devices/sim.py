"""Simulated glove, which needs no hardware."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, GloveOptions


@dataclass(frozen=True)
class SimOptions(GloveOptions):
    """Settings of a simulated glove."""

    rate: float = 200.0


GLOVE = Glove(
    about="a simulated one, which needs no hardware",
    driver="hhsim.live.drivers.sim:SimGlove",
    options=SimOptions,
    plays=True,
    holds=False,
)
