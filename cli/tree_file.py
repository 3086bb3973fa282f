"""A sphere tree from a file in place of one that is built: `build-tree --from` and `replay --tree`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh
    from hhsim.trees.foreign_tree import ImportedTree

    from .console import Report

source = click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Build nothing: take the tree of a .sph file of Bradshaw's toolkit or another program, or of a .h5 file, "
    "mend and measure it.",
)
frame = click.option(
    "--frame",
    type=click.Choice(["auto", "mesh", "centred"]),
    help="What the centres of the .sph file count from. mesh: the mesh's origin; centred: the centre of its bounding "
    "box, as the toolkit's do; auto: whichever leaves less of the mesh outside the spheres. Default: auto.",
)
unit = click.option(
    "--from-unit",
    "source_unit",
    type=click.Choice(["m", "cm", "mm", "inch"]),
    help="Length unit of the .sph file. Default: that of the mesh file; m for an object of the catalogue.",
)
tree = click.option(
    "--tree",
    "tree_path",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Take this sphere tree of the object, .h5 or .sph (hhsim build-tree), and build none.",
)


def check_source(source: Path | None, frame: str | None, source_unit: str | None) -> None:
    """Refuse options of `--from` that have nothing to act on, and options of a build beside it."""
    if source is None:
        for option, value in (("--frame", frame), ("--from-unit", source_unit)):
            if value is not None:
                raise click.UsageError(f"{option} is for --from FILE.sph")
        return
    context = click.get_current_context()
    for name in ("level", "leaves", "max_error", "branching", "cover", "threads"):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{name.replace('_', '-')} is for trees that are built; {source} has its own")
    if source.suffix == ".h5" and (frame or source_unit):
        raise click.UsageError(f"--frame and --from-unit are for .sph files; {source} is in metres and has its frame")


def length_unit(object_: str, unit: str | None, size: float | None, source_unit: str | None = None) -> float:
    """Length [m] of the unit of a .sph file.

    Args:
        object_: A name of the catalogue, or a mesh file.
        unit: Of the mesh file; None is metres.
        size: Longest extent that the mesh file gets [mm].
        source_unit: Of the .sph file; None is that of the mesh.
    """
    from hhsim.mesh.catalogue import names_a_file
    from hhsim.mesh.file import read_triangles
    from hhsim.mesh.mesh import METRES_PER_UNIT, Mesh

    if source_unit is not None:
        return METRES_PER_UNIT[source_unit]
    if not names_a_file(object_):
        return 1.0
    if size is None:
        return METRES_PER_UNIT[unit or "m"]
    return 1e-3 * size / float(Mesh(*read_triangles(Path(object_))).extent.max())


def imported_tree(
    path: Path, mesh: "Mesh", frame: str | None, unit_length: float, seed: int, report: "Report | None"
) -> "ImportedTree":
    """Read, mend and measure the tree of `--from`."""
    from hhsim.trees.foreign_tree import FRAMES, import_tree

    (wanted,) = (name for name in FRAMES if name == (frame or "auto"))
    return import_tree(path, mesh, unit_length, wanted, seed, report)
