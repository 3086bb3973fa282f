"""Any glove, through a bridge that speaks the open packet of `hhsim.live.link.udp_codec`."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ServedOptions, setting

TAKES = ("limits", "forces")


@dataclass(frozen=True)
class UdpOptions(ServedOptions):
    """Settings of a glove with a bridge."""

    takes: str = setting(
        "limits", "Whether it takes where fingers are stopped, or forces on their tips", "limits|forces", choices=TAKES
    )
    most_force: float = setting(
        5.0, "Most force on a fingertip, of a glove that takes forces", "N", unit="N", least=0.1, most=1000.0
    )


GLOVE = Glove(
    about="any other, by a bridge that speaks an open packet",
    driver="hhsim.live.drivers.udp:UdpGlove",
    options=UdpOptions,
    calibration="hhsim.live.drivers.calibration:glove_calibration",
)
