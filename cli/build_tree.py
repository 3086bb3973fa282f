"""`hhsim build-tree`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options, tree_file
from .console import announce_compilation, print_json, print_notes, print_table, progress
from .object_argument import complete_object, read_object

if TYPE_CHECKING:
    from hhsim.sphere_tree import SphereTree


@click.command()
@click.argument("object_", metavar="OBJECT|MESH", shell_complete=complete_object)
@click.option(
    "--level",
    type=click.IntRange(1, 5),
    help="Level of the leaves. Default: 3 or 4, as the catalogue says; 4 for a mesh file.",
)
@click.option("--leaves", type=click.IntRange(1), metavar="N", help="Most leaves. Default: branching to the level.")
@click.option(
    "--branching", type=click.IntRange(2, 64), default=8, show_default=True, help="Most children of a sphere."
)
@tree_file.source
@tree_file.frame
@tree_file.unit
@options.unit
@options.size
@options.seed
@options.out
@options.json
@options.quiet
def command(
    object_: str,
    level: int | None,
    leaves: int | None,
    branching: int,
    source: Path | None,
    frame: str | None,
    source_unit: str | None,
    unit: str | None,
    size: float | None,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Build the sphere tree of an object and measure its error.

    The spheres of each level cover the whole mesh; the table says how far they protrude from it. A tree that was built
    before is taken from the cache. The file is .h5, or with --out FILE.sph the text format of Bradshaw's toolkit.

    \b
    Examples:
      hhsim build-tree bunny
      hhsim build-tree mug.stl --unit mm --level 3 --out mug.h5
      hhsim build-tree mug.obj --unit mm --from mug-medial.sph --out mug-medial.h5
    """
    from hhsim.destination import check_destination, dated_destination
    from hhsim.tree_builder import TreeOptions, cache_path, cached_sphere_tree

    announce_compilation(quiet=quiet)
    tree_file.check_source(source, frame, source_unit)
    mesh, usual_level = read_object(object_, unit, size)
    wanted = TreeOptions(level=level or usual_level or 4, branching=branching, leaves=leaves, seed=seed)
    path = out or dated_destination(f"{mesh.name}-tree-{source.stem if source else wanted.level}")
    if path.suffix not in (".h5", ".sph"):
        raise click.UsageError(f"--out {path}: a sphere tree is a .h5 or a .sph file")
    check_destination(path)
    _check_replaceable(path)
    cached = source is None and cache_path(mesh, wanted).exists()
    found = None
    start = time.perf_counter()
    with progress(quiet=quiet) as report:
        if source is None:
            tree = cached_sphere_tree(mesh, wanted, report)
        else:
            unit_length = tree_file.length_unit(object_, unit, size, source_unit)
            found = tree_file.imported_tree(source, mesh, frame, unit_length, seed, report)
            tree = found.tree
    seconds = time.perf_counter() - start
    if path.suffix == ".sph":
        tree.save_sph(path)
    else:
        tree.save(path)
    print_notes(mesh.warnings, prefix="warning")
    if as_json:
        print_json(
            {
                "object": mesh.name,
                "triangles": len(mesh.faces),
                "extent": mesh.extent.tolist(),
                "repairs": mesh.repairs,
                "warnings": mesh.warnings,
                "leaves": tree.leaf_count,
                "levels": [vars(error) for error in tree.errors],
                "seconds": seconds,
                "cached": cached,
                "frame": found.frame if found else "mesh",
                "notes": found.notes if found else (),
                "unproved_faces": found.unproved if found else 0,
                "path": str(path),
            }
        )
    elif not quiet:
        print_table(COLUMNS, _rows(tree), title=f"{mesh.name}: {len(mesh.faces):,} triangles", numbers=COLUMNS)
        for repair in mesh.repairs:
            print(f"repaired: {repair}")
        for note in found.notes if found else ():
            print(f"note: {note}")
        if found is None:
            print("the levels above the leaves hold what is below them; for a coarser model build one with --level")
        how = "read from the cache" if cached else f"built in {seconds:.1f} s"
        if source is not None:
            how = f"read from {source}"
        print(f"{tree.leaf_count:,} leaves, {how}, written to {path}")


COLUMNS = (
    "level",
    "spheres",
    "protrusion max [mm]",
    "p99 [mm]",
    "mean [mm]",
    "proved bound [mm]",
    "gap max [mm]",
)


def _rows(tree: "SphereTree") -> list[tuple[str, ...]]:
    return [
        (
            str(error.level),
            f"{error.spheres:,}",
            *(
                f"{1e3 * length:.3f}"
                for length in (
                    error.protrusion_max,
                    error.protrusion_p99,
                    error.protrusion_mean,
                    error.bound,
                    error.gap_max,
                )
            ),
        )
        for error in tree.errors
    ]


def _check_replaceable(path: Path) -> None:
    """Keep a wrong `--out` from destroying a file that is no tree."""
    from hhsim.errors import InputError, OutputError
    from hhsim.sphere_tree import SphereTree

    if path.exists():
        try:
            SphereTree.load_sph(path) if path.suffix == ".sph" else SphereTree.load(path)
        except InputError as error:
            raise OutputError(
                f"{path} exists and is no sphere tree, so it is not replaced: name another file"
            ) from error
