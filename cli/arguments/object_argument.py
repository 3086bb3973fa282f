"""The OBJECT argument, a name of the catalogue or a mesh file, and the options that say how a mesh file is read."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from .option_group import OptionGroup, option
from .options import UNITS, metres, within

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh


def complete_object(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the names of the catalogue, and files where what is typed looks like one."""
    from hhsim.mesh.catalogue import object_names

    names = [CompletionItem(name) for name in object_names() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


class MeshSize(OptionGroup, heading="Mesh file"):
    """How large the object of a mesh file is: its unit, None for metres, or its longest extent [mm]."""

    unit: str | None = option(type=UNITS, help="Length unit of a mesh file, which does not state it. Default: m.")
    size: float | None = option(
        type=within("size", 1e-3),
        metavar="MM",
        help="Scale a mesh file to this longest extent [mm], whatever its unit.",
    )

    def read(self, object_: str) -> tuple["Mesh", int]:
        """Load what OBJECT names: the mesh [m], and the level of tree that suits it.

        Raises:
            HhsimError: As `hhsim.mesh.catalogue.resolve_object`.
        """
        from hhsim.mesh.catalogue import resolve_object

        return resolve_object(object_, self.unit, metres(self.size))


class MeshFile(MeshSize):
    """How a mesh file is read; its open parts become sheets of a thickness [mm], or are closed."""

    thickness: float | None = option(
        type=within("thickness", 1e-3),
        metavar="MM",
        help="Make each open part of a mesh file a sheet this thick [mm], instead of closing it.",
    )

    def read(self, object_: str, *, solid: bool = True) -> tuple["Mesh", int]:
        """As `MeshSize.read`; without `solid` the triangles of a file as they are."""
        from hhsim.mesh.catalogue import resolve_object

        return resolve_object(object_, self.unit, metres(self.size), metres(self.thickness), solid)

    def unit_length(self, object_: str) -> float:
        """Length [m] of the unit that the mesh is in, as far as a file of its sphere tree is concerned."""
        from hhsim.mesh.catalogue import names_a_file
        from hhsim.mesh.file import read_triangles
        from hhsim.mesh.mesh import METRES_PER_UNIT, Mesh

        if not names_a_file(object_):
            return 1.0
        if self.size is None:
            return METRES_PER_UNIT[self.unit or "m"]
        return 1e-3 * self.size / float(Mesh(*read_triangles(Path(object_))).extent.max())
