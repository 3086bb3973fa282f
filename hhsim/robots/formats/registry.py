"""Registry of the formats of a robot's spheres: the `FORMAT` of each module of this package."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.registry import Registry
from hhsim.robots.robot_spheres import RobotSpheres

Spheres = dict[str, FloatArray]
"""Centres and radii [m], shape (n, 4), of each link in its frame, by its name."""


@dataclass(frozen=True)
class RobotFormat:
    """A kind of file that holds the spheres of a robot's links."""

    suffixes: tuple[str, ...]  # the first one is that of a file that is named by hhsim
    mark: bytes  # stands in every such file
    write: Callable[[RobotSpheres], bytes]  # InputError where the format cannot hold the robot
    read: Callable[[Path], Spheres]  # InputError names what is wrong


FORMATS = Registry[RobotFormat]("hhsim.robots.formats", "FORMAT", "format of a robot's spheres", first=("h5", "urdf"))


def format_of(path: Path) -> str:
    """Return the name of the format of a file by its suffix; "" for none of them."""
    return next((name for name, format_ in FORMATS.items() if path.suffix.lower() in format_.suffixes), "")


def read_spheres(path: Path) -> Spheres:
    """Read the spheres of each link from a file of any format; InputError for one that has none."""
    name = format_of(path)
    if not name:
        known = [suffix for each in FORMATS.values() for suffix in each.suffixes]
        raise InputError(f"{path}: expected spheres of links, a file that ends in {', '.join(known)}")
    try:
        found = FORMATS[name].read(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected spheres of links") from None
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    if not found:
        raise InputError(f"{path}: no link has spheres")
    return found
