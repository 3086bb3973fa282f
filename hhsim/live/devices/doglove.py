"""DOGlove, whose joints are read from the datagrams of its published scripts or its board's serial line."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ReachedOptions, setting


@dataclass(frozen=True)
class DogloveOptions(ReachedOptions):
    """Settings of a DOGlove."""

    port: int = setting(5009, "Port of the glove's server", "PORT", least=1, most=65534)
    path: str = setting(
        "", "Serial line, such as /dev/ttyUSB0, instead of the network", "LINE", flags=("--serial", "--path")
    )
    baud: int = setting(921_600, "Speed of the serial line", "BAUD", unit="bit/s", least=1, most=12_000_000)
    servo_zero: str = setting(
        "182.2,165.2,150.29,151.44,145.9",
        "What the five servos read with a flat hand, with commas",
        "DEGREES",
        unit="deg",
    )


GLOVE = Glove(
    about="a DOGlove, which is read and not commanded",
    driver="hhsim.live.drivers.doglove:Doglove",
    options=DogloveOptions,
    holds=False,
)
