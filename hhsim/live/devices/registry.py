"""Finds the gloves: each is a module of this package, with the glove's name, that holds a record `GLOVE`.

To add a glove, add one such file: the settings that it has, and its driver or where that is. `hhsim live glove` then
lists the glove and asks for its settings. A driver is imported when its glove is opened; what this package imports, the
command's help waits for, which is why the drivers of hhsim are in a package of their own, `hhsim.live.drivers`.
"""

from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from hhsim.errors import InputError, UnknownNameError
from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.live.device import Calibration, FingerRelease, GloveDevice
    from hhsim.live.playback import Playback

Hand = Literal["right", "left"]


@dataclass(frozen=True)
class Setting:
    """How the command line asks for a setting.

    Attributes:
        text: What it is, without a full stop.
        metavar: What stands for its value.
        unit: Of its value; "" for none.
        flags: Names of the option; by default the setting's own.
        least: Least value.
        most: Largest value.
        choices: The words that there are, where it is one of some.
    """

    text: str
    metavar: str
    unit: str = ""
    flags: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()


def setting(default: Any, text: str, metavar: str, **more: Any) -> Any:
    """A field of `GloveOptions`: its default, and what `Setting` holds."""
    return field(default=default, metadata={"setting": Setting(text, metavar, **more)})


@dataclass(frozen=True)
class GloveOptions:
    """Settings of a glove, each a `setting`; those of one name and text are one option for all gloves that have it."""


@dataclass(frozen=True)
class ReachedOptions(GloveOptions):
    """Settings of a glove that is reached by a server, or by a bridge.

    Attributes:
        host: Of the server.
        port: Of the server.
    """

    host: str = setting("127.0.0.1", "Where the glove's server is", "HOST")
    port: int = setting(0, "Port of the glove's server", "PORT", least=1, most=65535)


@dataclass(frozen=True)
class ServedOptions(ReachedOptions):
    """Settings of a glove that is reached by a server, and whose readings can be calibrated.

    Attributes:
        calibration: File of a calibration; "" for the default one.
        profile: Of a calibration file that holds several; "" where there is one.
    """

    calibration: str = setting("", "Calibration of the glove: our TOML, or the vendor's JSON of profiles", "FILE")
    profile: str = setting("", "Profile of a calibration file that holds several", "NAME")


@dataclass(frozen=True)
class Glove:
    """A glove that can be chosen.

    Attributes:
        about: What it is, in half a line.
        driver: Its `GloveDevice`, as "module:Class"; called with a `GloveConfig`.
        options: The type of its settings.
        calibration: What reads its calibration, as "module:function", called with its settings and the hand and
            returning a `Calibration`; "" where it has none.
        plays: Its fingers make a motion: it is given a playback.
        ends: A session ends with that motion.
        holds: Fingers stay held in it when nobody tells it otherwise: the watchdog needs a connection of its own.
        palm: It says where the palm is.
    """

    about: str
    driver: str
    options: type[GloveOptions] = GloveOptions
    calibration: str = ""
    plays: bool = False
    ends: bool = False
    holds: bool = True
    palm: bool = False


@dataclass(frozen=True)
class GloveConfig:
    """A glove as it is to be opened: which, its settings, and what the session adds.

    Attributes:
        hand: "right" or "left": which hand's glove is used.
        seed: Of what is random in a simulated glove.
        playback: Motion of a glove that plays one.
        calibration: What its readings mean; None where it has none, and where it is opened for release alone.
    """

    kind: str
    options: GloveOptions
    hand: Hand = "right"
    seed: int = 0
    playback: "Playback | None" = None
    calibration: "Calibration | None" = None


GLOVES: Registry[Glove] = Registry("hhsim.live.devices", "GLOVE", "glove")
"""Every glove by its name."""


def configure(
    kind: str = "sim", *, hand: Hand = "right", seed: int = 0, playback: "Playback | None" = None, **settings: Any
) -> GloveConfig:
    """A glove with its settings, and with its calibration read.

    Args:
        hand: "right" or "left".
        seed: As in `GloveConfig`.
        playback: As in `GloveConfig`.
        settings: By their names; those left out have their defaults.

    Raises:
        UnknownNameError: No such glove, or no such setting of it.
        InputError: No such hand, or a calibration that cannot be read.
    """
    glove = GLOVES[kind]
    if hand not in ("right", "left"):
        raise InputError(f"hand '{hand}'; expected right or left")
    known = [item.name for item in fields(glove.options)]
    for name in settings:
        if name not in known:
            raise UnknownNameError(f"setting of {kind}", name, known)
    options = glove.options(**settings)
    calibration = _named(glove.calibration)(options, hand) if glove.calibration else None
    return GloveConfig(kind, options, hand, seed, playback, calibration)


def open_device(config: GloveConfig) -> "GloveDevice":
    """The driver of a glove, not yet opened.

    Raises:
        InputError: Settings that the driver cannot use.
    """
    device: GloveDevice = _named(GLOVES[config.kind].driver)(config)
    return device


def open_release(config: GloveConfig) -> "FingerRelease":
    """What frees the fingers of a glove beside its driver, not yet opened; needs neither calibration nor motion."""
    if GLOVES[config.kind].holds:
        return open_device(config)
    from hhsim.live.device import NothingHeld

    return NothingHeld()


def for_release(config: GloveConfig) -> GloveConfig:
    """What `open_release` needs of a configuration."""
    return replace(config, playback=None, calibration=None)


def _named(name: str) -> Any:
    module, _, inside = name.partition(":")
    return getattr(import_module(module), inside)
