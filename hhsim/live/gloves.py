"""Gloves and sources of the palm's pose, with their settings.

A new glove is a driver with a record in `GLOVES`, or one that an installed package declares as an entry point. Drivers
are imported when their glove is opened: the command's help imports this module alone.
"""

from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Literal

from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.live.device import FingerRelease, GloveDevice

Hand = Literal["right", "left"]
TAKES = ("limits", "forces")


@dataclass(frozen=True)
class Setting:
    """Command-line option of a setting; `text` is its help without a full stop."""

    text: str
    metavar: str
    unit: str = ""
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()


def setting(default: Any, text: str, metavar: str, **more: Any) -> Any:
    """Make a field of `GloveOptions` from its default and the fields of `Setting`."""
    return field(default=default, metadata={"setting": Setting(text, metavar, **more)})


@dataclass(frozen=True)
class GloveOptions:
    """Settings of a glove, each a `setting`; those of one name and text are one option for all gloves that have it."""


@dataclass(frozen=True)
class ReachedOptions(GloveOptions):
    """Settings of a glove at a server or a bridge."""

    host: str = setting("127.0.0.1", "Where the glove's server is", "HOST")
    port: int = setting(24170, "Port of the glove's server", "PORT", least=1, most=65535)


@dataclass(frozen=True)
class PacketOptions(ReachedOptions):
    """Settings of a glove with a bridge that speaks the open packet."""

    takes: str = setting(
        "limits", "Whether it takes where fingers are stopped, or forces on their tips", "limits|forces", choices=TAKES
    )
    most_force: float = setting(
        5.0, "Most force on a fingertip, of a glove that takes forces", "N", unit="N", least=0.1, most=1000.0
    )


@dataclass(frozen=True)
class DexmoOptions(ReachedOptions):
    """Settings of a Dexmo at its vendor's server; "" is the default calibration."""

    port: int = setting(55555, "Port of the glove's server", "PORT", least=1, most=65535)
    calibration: str = setting("", "Calibration of the glove, a TOML file (docs/live.md has an example)", "FILE")
    device_id: int | None = setting(
        None, "The glove's number at its server. Default: the hand's first", "ID", least=0, most=2**31 - 1
    )


@dataclass(frozen=True)
class Glove:
    """Glove that can be chosen."""

    about: str  # description in half a line
    driver: str  # its `GloveDevice`, as "module:Class"; called with a `GloveConfig`
    options: type[GloveOptions] = GloveOptions  # type of its settings
    # Reader of its calibration, as "module:function", called with settings and hand; "" for none. What it returns has
    # `bend_lines` as of `hhsim.recordings.dexmo_regression.DexmoRegression`.
    calibration: str = ""
    plays: bool = False  # True if its fingers make a motion: it is given a playback
    ends: bool = False  # True if a session ends with that motion
    holds: bool = True  # True if fingers stay held without further commands: the watchdog needs a connection of its own
    palm: bool = False  # True if it gives the pose of the palm


@dataclass(frozen=True)
class GloveConfig:
    """Configuration of a glove to open; `calibration` is None for a glove without one, or opened for release alone."""

    kind: str
    options: GloveOptions
    hand: Hand = "right"
    seed: int = 0
    playback: Any = None  # a `hhsim.live.drivers.played.Playback` for a glove that plays a motion
    calibration: Any = None


_UDP, _PLAYED = "hhsim.live.drivers.udp:UdpGlove", "hhsim.live.drivers.played"
GLOVES: Registry[Glove] = Registry(
    {
        "dexmo": Glove(
            "a Dexmo at its vendor's server",
            "hhsim.live.drivers.dexmo:DexmoGlove",
            DexmoOptions,
            "hhsim.live.drivers.dexmo:glove_calibration",
        ),
        "openxr": Glove(
            "a hand that an OpenXR headset tracks, bare or in a glove, by a bridge", _UDP, PacketOptions, palm=True
        ),
        "replay": Glove(
            "a recording in the place of one", f"{_PLAYED}:ReplayGlove", plays=True, ends=True, holds=False
        ),
        "sim": Glove("a simulated one, which needs no hardware", f"{_PLAYED}:SimGlove", plays=True, holds=False),
        "udp": Glove("any other, by a bridge that speaks an open packet", _UDP, PacketOptions),
    },
    kind="glove",
    group="hhsim.gloves",
)
"""Gloves by name."""


def configure(
    kind: str = "sim", *, hand: Hand = "right", seed: int = 0, playback: Any = None, **settings: Any
) -> GloveConfig:
    """Configure a glove by its settings' names, and read its calibration; arguments as in `GloveConfig`.

    UnknownNameError for an unknown glove, InputError for a calibration that cannot be read.
    """
    glove = GLOVES[kind]
    options = glove.options(**settings)
    calibration = resolve_name(glove.calibration)(options, hand) if glove.calibration else None
    return GloveConfig(kind, options, hand, seed, playback, calibration)


def open_device(config: GloveConfig) -> "GloveDevice":
    """Make the driver of a glove, not yet opened; InputError for settings that it cannot use."""
    device: GloveDevice = resolve_name(GLOVES[config.kind].driver)(config)
    return device


def open_release(config: GloveConfig) -> "FingerRelease":
    """Make the connection that frees a glove's fingers beside its driver, not yet opened."""
    if GLOVES[config.kind].holds:
        return open_device(config)
    from hhsim.live.device import FingerRelease

    return FingerRelease()


@dataclass(frozen=True)
class Pose:
    """Source of the palm's pose that can be chosen."""

    about: str  # description in half a line
    placed: bool = False  # True if it is, or begins, at a configured pose
    plays: bool = False  # True if it plays a motion
    back: float = 0.0  # distance of the default beginning from the grasp [m]
    by_glove: bool = False  # True if the glove gives it


POSES = {
    # Its user comes to the object.
    "keyboard": Pose("moved with keys", placed=True, back=0.06),
    "fixed": Pose("at one place", placed=True),
    "replay": Pose("as in --trajectory", plays=True),
    "udp": Pose("by packets of a tracker"),
    "glove": Pose("as a glove says that knows it", placed=True, back=0.06, by_glove=True),
}
"""Sources of the palm's pose by name, which few gloves give; `hhsim.live.drivers.poses` has their classes."""
USUAL_POSE_PORT = 24172


@dataclass(frozen=True)
class PoseConfig:
    """Settings of a pose source."""

    kind: str = "fixed"  # one of `POSES`
    # Pose of `fixed`, and first one of `keyboard` and `glove` [m], (w, x, y, z), world.
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    playback: Any = None  # motion of `replay`; the same as the glove's keeps palm and fingers together
    host: str = "127.0.0.1"  # sender of the packets of `udp`
    port: int = USUAL_POSE_PORT  # port at which they arrive
