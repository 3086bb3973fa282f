"""Argument OBJECT, a name of the catalogue, a mesh file, a URDF or an MJCF, and the options of a mesh file."""

from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from .option_group import OptionGroup, option
from .options import UNITS, metres, ranged

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

        thickness = metres(getattr(self, "thickness", None))
        return resolve_object(object_, self.unit, metres(self.size), thickness, solid, link)


class MeshFile(MeshSize):
    """Reading of a mesh file: as it is, as a solid, or with sheets of a thickness [mm] in place of its open parts."""

    solid: bool = option(
        is_flag=True,
        help="Close a mesh file to a solid, meshed anew if need be. Default: what is none is touched as a skin.",
    )
    thickness: float | None = ranged(
        "thickness", "MM", "Make each open part of a mesh file a sheet this thick [mm], and the whole a solid.", 1e-3
    )

    def unit_length(self, object_: str) -> float:
        """Return the length [m] of the mesh's unit, for a file of its sphere tree."""
        from hhsim.linkage.file import names_a_linkage
        from hhsim.mesh.catalogue import names_a_file
        from hhsim.mesh.mesh import unit_length_of

        if not names_a_file(object_) or names_a_linkage(object_):
            return 1.0
        return unit_length_of(object_, self.unit, metres(self.size))
