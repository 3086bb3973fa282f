"""Which glove: its settings as plain values, and the driver that they mean."""

from dataclasses import dataclass
from importlib import import_module

from hhsim.errors import InputError, UnknownNameError
from hhsim.live.device import GloveDevice
from hhsim.live.playback import Playback

DEVICE_KINDS = ("dexmo", "opengloves", "udp", "replay", "sim")
USUAL_PORT = {"dexmo": 55555, "opengloves": 65432, "udp": 24170}
"""TCP ports of the gloves' servers; for `udp` where samples arrive, commands go to the next port."""


@dataclass(frozen=True)
class DeviceConfig:
    """Settings of a glove; a driver takes those that concern it.

    Attributes:
        kind: one of `DEVICE_KINDS`.
        host: of the glove's server (dexmo, opengloves over TCP) or bridge (udp).
        port: 0 for the usual one, `USUAL_PORT`.
        path: serial line of `opengloves`, such as /dev/ttyUSB0; "" for TCP.
        baud: of the serial line.
        full_scale: largest reading of `opengloves`; 0 for 4095, boards with 10 bits have 1023.
        hand: "right" or "left": which hand's glove is used.
        calibration: file of a calibration; "" for none.
        profile: of a calibration file that holds several; "" where there is one.
        device_id: number of the glove at its server; -1 for the first one of the hand.
        playback: motion of `replay`, or that the user of `sim` makes; `sim` without one opens and closes its fingers.
        rate: samples a second of `sim` [Hz].
        seed: of the noise of `sim`, and of its fingers' motion without a playback.
    """

    kind: str = "sim"
    host: str = "127.0.0.1"
    port: int = 0
    path: str = ""
    baud: int = 115_200
    full_scale: float = 0.0
    hand: str = "right"
    calibration: str = ""
    profile: str = ""
    device_id: int = -1
    playback: Playback | None = None
    rate: float = 200.0
    seed: int = 0

    @property
    def port_used(self) -> int:
        """The port, or the kind's usual one."""
        return self.port or USUAL_PORT.get(self.kind, 0)


def open_device(config: DeviceConfig) -> GloveDevice:
    """The driver of a glove, not yet opened.

    Raises:
        UnknownNameError: no such kind of glove.
        InputError: settings that the driver cannot use, or a calibration that cannot be read.
    """
    if config.hand not in ("right", "left"):
        raise InputError(f"hand '{config.hand}'; expected right or left")
    if config.kind not in _DRIVERS:
        raise UnknownNameError("glove", config.kind, DEVICE_KINDS)
    module, name = _DRIVERS[config.kind]
    driver: GloveDevice = getattr(import_module(f"hhsim.live.{module}"), name)(config)
    return driver


# By name, since each is imported where it is used: the loop's process holds as little as possible.
_DRIVERS = {
    "dexmo": ("dexmo_glove", "DexmoGlove"),
    "opengloves": ("opengloves_glove", "OpenGlovesGlove"),
    "udp": ("udp_glove", "UdpGlove"),
    "replay": ("replay_glove", "ReplayGlove"),
    "sim": ("sim_glove", "SimGlove"),
}
