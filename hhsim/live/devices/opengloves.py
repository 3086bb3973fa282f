"""Glove that speaks the letter format of OpenGloves, on a serial line or over TCP."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ServedOptions, setting


@dataclass(frozen=True)
class OpenGlovesOptions(ServedOptions):
    """Settings of an OpenGloves or LucidGloves."""

    port: int = setting(65432, "Port of the glove's server", "PORT", least=1, most=65535)
    path: str = setting(
        "", "Serial line, such as /dev/ttyUSB0, instead of the network", "LINE", flags=("--serial", "--path")
    )
    baud: int = setting(115_200, "Speed of the serial line", "BAUD", unit="bit/s", least=1, most=12_000_000)
    full_scale: float = setting(
        4095.0, "Largest reading; 1023 for boards with 10 bits", "COUNTS", unit="count", least=1.0, most=1e9
    )


GLOVE = Glove(
    about="an OpenGloves or LucidGloves, by serial line or TCP",
    driver="hhsim.live.drivers.opengloves:OpenGlovesGlove",
    options=OpenGlovesOptions,
    calibration="hhsim.live.drivers.calibration:glove_calibration",
)
