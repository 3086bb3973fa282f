"""Dexmo glove at the TCP server of its vendor."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ServedOptions, setting


@dataclass(frozen=True)
class DexmoOptions(ServedOptions):
    """Settings of a Dexmo."""

    port: int = setting(55555, "Port of the glove's server", "PORT", least=1, most=65535)
    device_id: int | None = setting(
        None, "The glove's number at its server. Default: the hand's first", "ID", least=0, most=2**31 - 1
    )


GLOVE = Glove(
    about="a Dexmo at its vendor's server",
    driver="hhsim.live.drivers.dexmo:DexmoGlove",
    options=DexmoOptions,
    calibration="hhsim.live.drivers.calibration:glove_calibration",
)
