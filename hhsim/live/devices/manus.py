"""MANUS glove at NVIDIA's Isaac Teleop: a hand tracked by OpenXR with five motors that shake its fingers."""

from dataclasses import dataclass

from hhsim.live.devices.registry import Glove, ReachedOptions, setting


@dataclass(frozen=True)
class ManusOptions(ReachedOptions):
    """Settings of a MANUS glove."""

    full_force: float = setting(
        2.0, "Force on a finger that shakes it with full power", "N", unit="N", least=0.01, most=1000.0
    )


GLOVE = Glove(
    about="a MANUS glove at Isaac Teleop, by a bridge",
    driver="hhsim.live.drivers.openxr:ManusGlove",
    options=ManusOptions,
    palm=True,
)
