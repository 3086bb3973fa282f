"""OBJECT, a name of the catalogue or a file, and its options: size of a mesh, and its sphere tree."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from .option_group import OptionGroup, option
from .options import UNITS, file, metres, ranged

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh


def complete_object(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete names of the catalogue, and files where what is typed looks like one."""
    from hhsim.mesh.catalogue import body_file_names, object_names

    names = [CompletionItem(name) for name in (*object_names(), *body_file_names()) if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


class MeshSize(OptionGroup, heading="Mesh file"):
    """Size of a mesh file's object: its unit, None for metres, or its longest extent [mm]."""

    unit: str | None = option(type=UNITS, help="Length unit of a mesh file. Default: the one that it states, or m.")
    size: float | None = ranged("size", "MM", "Scale a mesh file to this longest extent [mm], whatever its unit.", 1e-3)

    def read(self, object_: str, *, solid: bool | None = True, link: str = "") -> tuple["Mesh", int]:
        """Load the mesh [m] of OBJECT, and its usual tree level, as `hhsim.linkage.file.resolve_object`."""
        from hhsim.linkage.file import resolve_object

        return resolve_object(object_, self.unit, metres(self.size), solid, link)


class MeshFile(MeshSize):
    """Reading of a mesh file: as it is, or as a solid."""

    solid: bool = option(
        is_flag=True,
        help="Close a mesh file to a solid, meshed anew if need be. Default: what is none is touched as a skin.",
    )

    def words(self, tree: "TreeChoice") -> dict[str, Any]:
        """Return what the options say of the mesh and its tree, for `SceneWords`."""
        of_mesh = {"unit": self.unit, "size_mm": self.size, "solid": self.solid}
        return of_mesh | {"level": tree.stated(), "max_error": tree.max_error}

    def unit_length(self, object_: str) -> float:
        """Return the length [m] of the mesh's unit, for a file of its sphere tree."""
        from hhsim.linkage.file import names_a_linkage
        from hhsim.mesh.catalogue import names_a_file
        from hhsim.mesh.mesh import unit_length_of

        if not names_a_file(object_) or names_a_linkage(object_):
            return 1.0
        return unit_length_of(object_, self.unit, metres(self.size))


LEAST_ERROR = 1e-6
"""Least --max-error [m]."""
METRES = {"": 1e-3, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


def read_length(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Read a length such as 0.3mm or 300um, or a number in mm; return metres."""
    if value is None:
        return None
    found = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?) ?(|mm|um|µm|m)", value)
    try:
        length = float(found[1]) * METRES[found[2]] if found else 0.0
    except ValueError:
        length = 0.0
    if not LEAST_ERROR <= length < 1.0:
        raise click.BadParameter(f"'{value}', expected a length such as 0.3mm, from 1um to 1m", context, parameter)
    return length


AUTO = 0


def read_level(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Read 1 to 5, or auto."""
    if value is None:
        return None
    if value == "auto":
        return AUTO
    if value not in ("1", "2", "3", "4", "5"):
        raise click.BadParameter(f"'{value}', expected 1 to 5, or auto", context, parameter)
    return int(value)


class TreeChoice(OptionGroup, heading="Sphere tree"):
    """Level of the tree, or largest distance [m] of its spheres outside the mesh."""

    level: int | None = option(
        callback=read_level,
        metavar="N|auto",
        help="Level of the tree's leaves; auto: what --max-error needs. Default: the catalogue's, or 4.",
    )
    max_error: float | None = option(
        callback=read_length,
        metavar="LENGTH",
        help="Take the coarsest level whose spheres protrude by at most this: 0.3mm, 300um or 0.3 (mm).",
    )

    def stated(self) -> int | None:
        """Return the level that was named; UsageError for options that contradict each other."""
        if self.level == AUTO and self.max_error is None:
            raise click.UsageError("--level auto needs --max-error, such as --max-error 0.3mm")
        if self.max_error is not None and self.level not in (None, AUTO):
            raise click.UsageError(f"--max-error chooses the level itself: leave --level {self.level} out")
        return self.level or None


class TreeOrFile(TreeChoice):
    """A tree that is built, or that of a file."""

    path: Path | None = file(
        "FILE", "Take this sphere tree of the object, .h5 or .sph (hhsim build-tree), and build none.", "--tree"
    )

    def stated(self) -> int | None:
        """See `TreeChoice.stated`; a file has its own level."""
        if self.path is not None and (self.level is not None or self.max_error is not None):
            raise click.UsageError(f"--tree {self.path} has its own level: leave --level and --max-error out")
        return super().stated()
