"""OBJECT, a name of the catalogue or a file, and its options: size of a mesh, and its sphere tree."""

import re
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any

import click
from click.shell_completion import CompletionItem

from .command import OptionGroup, argument, option
from .options import OneLevel, Unit, metres, ranged, refuse

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh

LEAST_ERROR = 1e-6
"""Least --max-error [m]."""
METRES = {"": 1e-3, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}
Completion = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def completed_by(*places: str) -> Completion:
    """Return the completion by names that functions of hhsim return, and by files where what is typed looks like one.

    A place is a function as "module:name": it is imported when a shell asks.
    """

    def complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
        names = [name for place in places for name in resolve_name(place)() if name.startswith(incomplete)]
        return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]

    return complete


complete_object = completed_by("hhsim.mesh.catalogue:object_names", "hhsim.mesh.catalogue:body_file_names")
OBJECT = argument("[OBJECT]", default="bunny", shell_complete=complete_object)


class MeshSize(OptionGroup, heading="Mesh file"):
    """Size of a mesh file's object: its unit, None for metres, or its longest extent [mm]."""

    unit: Unit | None = option("Length unit of a mesh file. Default: the one that it states, or m.")
    size: Annotated[float, ranged("size", 1e-3)] | None = option(
        "Scale a mesh file to this longest extent [mm], whatever its unit.", "MM"
    )


class MeshFile(MeshSize):
    """Reading of a mesh file: as it is, or as a solid."""

    solid: bool = option(
        "Close a mesh file to a solid, meshed anew if need be. Default: what is none is touched as a skin."
    )

    def words(self, tree: "TreeChoice") -> dict[str, Any]:
        """Return what the options say of the mesh and its tree, for `SceneWords`."""
        tree.check()
        return {"unit": self.unit, "size_mm": self.size, "solid": self.solid, **tree.given()}

    def read(self, object_: str, link: str) -> tuple["Mesh", int]:
        """Load the mesh [m] of OBJECT, and its usual tree level, as `hhsim.linkage.file.resolve_object`."""
        from hhsim.linkage.file import resolve_object

        return resolve_object(object_, self.unit, metres(self.size), self.solid or None, link)

    def unit_length(self, object_: str) -> float:
        """Return the length [m] of the mesh's unit, for a file of its sphere tree."""
        from hhsim.linkage.file import names_a_linkage
        from hhsim.mesh.catalogue import names_a_file
        from hhsim.mesh.mesh import unit_length_of

        if not names_a_file(object_) or names_a_linkage(object_):
            return 1.0
        return unit_length_of(object_, self.unit, metres(self.size))


def read_length(value: str) -> float:
    """Read a length such as 0.3mm or 300um, or a number in mm; return metres."""
    found = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?) ?(|mm|um|µm|m)", value)
    try:
        length = float(found[1]) * METRES[found[2]] if found else 0.0
    except ValueError:
        length = 0.0
    if not LEAST_ERROR <= length < 1.0:
        raise refuse(value, "a length such as 0.3mm, from 1um to 1m")
    return length


class TreeChoice(OptionGroup, heading="Sphere tree"):
    """Level of the tree, or largest distance [m] of its spheres outside the mesh."""

    level: OneLevel | None = option("Level of the tree's leaves. Default: the catalogue's, or 4.", "N")
    max_error: Annotated[float, read_length] | None = option(
        "Take the coarsest level whose spheres protrude by at most this: 0.3mm, 300um or 0.3 (mm).", "LENGTH"
    )

    def check(self) -> None:
        """Raise UsageError for options that contradict each other."""
        if self.max_error is not None and self.level is not None:
            raise click.UsageError(f"--max-error chooses the level itself: leave --level {self.level} out")


class TreeOrFile(TreeChoice):
    """A tree that is built, or that of a file."""

    tree: Path | None = option(
        "Take this sphere tree of the object, .h5 or .sph (hhsim build-tree), and build none.", "FILE"
    )

    def check(self) -> None:
        """See `TreeChoice.check`; a file has its own level."""
        if self.tree is not None and (self.level is not None or self.max_error is not None):
            raise click.UsageError(f"--tree {self.tree} has its own level: leave --level and --max-error out")
        super().check()
