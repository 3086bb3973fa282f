"""`hhsim build-tree`."""

import time
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click

from hhsim.system.counted import counted
from hhsim.table.table import Table, number

from .arguments.command import OptionGroup, argument, make_command, option, refuse_typed
from .arguments.object_options import MeshFile, complete_object, read_length
from .arguments.options import SEED, AnySeed, OneLevel, OutPath, Output, Unit
from .console import print_notes, progress
from .robot_spheres import USUAL_LEAVES, Leaves, RobotOptions, fit_columns, import_spheres, robot_spheres

if TYPE_CHECKING:
    from hhsim.trees.options import TreeOptions
    from hhsim.trees.sphere_tree import SphereTree


class BuiltTree(OptionGroup, heading="Sphere tree"):
    """Fineness of the tree; `max_error` in [m]."""

    level: OneLevel | None = option(
        "Level of the leaves. Default: what --leaves or --max-error needs, else the catalogue's, or 4.", "N"
    )
    leaves: Leaves | None = option(
        "Number of leaves, or fewer if they suffice, of each link of a robot. Default: --branching to the power "
        "of --level; 16 for a robot.",
        "N",
    )
    max_error: Annotated[float, read_length] | None = option(
        "Take the fewest leaves proved to be within this distance of the mesh: 0.2mm, 200um or 0.2 (mm).", "LENGTH"
    )
    branching: Annotated[int, click.IntRange(2, 64)] = option("Most children of a sphere.", "N", default=8)
    cover: Literal["outer", "balanced"] = option(
        "Spheres contain the whole surface (outer), or are off to both sides by half as much (balanced).",
        default="outer",
    )
    threads: Annotated[int, click.IntRange(1, 64)] | None = option(
        "Threads to build with; the same bytes with any number. Default: one for each processor, 4 at most.", "N"
    )

    def options(self, seed: int, *, level: int | None = None, leaves: int | None = None) -> "TreeOptions":
        """Return the options for the library; the `level` or the `leaves` where nothing says how fine the tree is."""
        from hhsim.trees.options import TreeOptions

        if (self.level, self.leaves, self.max_error) != (None, None, None):
            level, leaves = self.level, self.leaves
        return TreeOptions(level, self.branching, leaves, seed, self.cover, self.max_error)


class TreeSource(OptionGroup, heading="Sphere tree of a file"):
    """File in place of a tree that is built."""

    path: Path | None = option(
        "Build nothing: measure the spheres of a .sph, .h5, .urdf, .srdf, .yml, .xrdf, .xml or .json file.",
        "FILE",
        "--from",
    )
    from_unit: Unit | None = option(
        "Length unit of the .sph file. Default: that of the mesh file; m for an object of the catalogue."
    )

    def check(self) -> None:
        """Raise UsageError for options of `--from` without it, and for options of a build beside it."""
        if self.path is None:
            if self.from_unit is not None:
                raise click.UsageError("--from-unit is for --from FILE.sph")
            return
        built = {field.name for field in fields(BuiltTree)}
        refuse_typed(f"is for trees that are built; {self.path} has its own", names=built)
        if self.path.suffix != ".sph" and self.from_unit:
            raise click.UsageError(f"--from-unit is for .sph files; {self.path} is in metres")


@make_command
def command(
    *,
    object_: str = argument("OBJECT", shell_complete=complete_object),
    build: BuiltTree,
    source: TreeSource,
    robot: RobotOptions,
    mesh_file: MeshFile,
    output: Output,
    plot: OutPath | None = option("Draw the mesh, and its spheres coloured by protrusion.", "FILE"),
    seed: AnySeed = SEED,
) -> None:
    """Cover an object, or a robot, with spheres, with a proof.

    OBJECT is a name (hhsim objects), a mesh file, or a URDF or MJCF file, of which --link names a link. The spheres
    of each level cover every triangle, with a proof in the file; the table says how far they protrude, as sampled and
    as proved. A mesh need not be closed: what is open is covered as a skin, unless --solid is given.
    A tree that was built before is taken from the cache. The file is .h5, or with --out FILE.sph the text format of
    Bradshaw's toolkit.

    A URDF or MJCF whose links move is a robot: each link gets spheres that cover its collision geometry, written for
    the program that --as names, with the pairs of links that touch in every pose.

    \b
    Examples:
      hhsim build-tree bunny
      hhsim build-tree bunny --leaves 2924
      hhsim build-tree link3.stl --unit m --leaves 2
      hhsim build-tree bunny --max-error 0.2mm
      hhsim build-tree bunny --level 3 --cover balanced
      hhsim build-tree cup --level 3 --branching 6
      hhsim build-tree bunny --level 3 --plot bunny-tree.png
      hhsim build-tree mug.stl --unit mm --level 3 --out mug.h5
      hhsim build-tree drawer.urdf --link handle
      hhsim build-tree mug.obj --unit mm --from mug-medial.sph --out mug-medial.h5
      hhsim build-tree arm.urdf --as curobo --out arm.yml
      hhsim build-tree arm.urdf --max-error 5mm --as urdf --plot arm.png
      hhsim build-tree arm.urdf --from arm.yml
    """
    from hhsim.linkage.file import names_a_linkage
    from hhsim.mesh.mesh import METRES_PER_UNIT
    from hhsim.render.spheres_figure import draw_tree
    from hhsim.robots.formats import format_of
    from hhsim.system.output_path import check_output_path, check_picture
    from hhsim.system.thread_pool import usual_threads
    from hhsim.trees.cache import cache_path, kept_sphere_tree
    from hhsim.trees.file import load_tree, save_tree
    from hhsim.trees.fit import measure_fit
    from hhsim.trees.foreign_tree import import_tree, load_sph, save_sph

    source.check()
    link = robot.link or ""
    if robot.means(object_, output.out):
        of_meshes = {field.name for field in fields(MeshFile)}
        refuse_typed(f"is for mesh files; {object_} is a robot, whose triangles are as it states", names=of_meshes)
        options = build.options(seed, leaves=USUAL_LEAVES)
        threads = build.threads or usual_threads()
        robot_spheres(Path(object_), robot, options, source.path, output, plot, threads, seed)
        return
    # A link of a file of spheres is none of a mesh.
    of_object = link if source.path is None or names_a_linkage(object_) else ""
    with progress(quiet=output.quiet) as report:
        report("read", 0, 1)
        mesh, usual_level = mesh_file.read(object_, of_object)
        options = build.options(seed, level=usual_level)
        fineness = f"{1e6 * build.max_error:.0f}um" if build.max_error else options.leaves or options.level
        path = output.path(f"{mesh.name}-tree-{source.path.stem if source.path else fineness}")
        if path.suffix not in (".h5", ".sph"):
            raise click.UsageError(f"--out {path}: a sphere tree is a .h5 or a .sph file")
        check_output_path(path, "sphere tree", load_sph if path.suffix == ".sph" else load_tree)
        if plot is not None:
            check_picture(plot)
        cached = source.path is None and cache_path(mesh, options).exists()
        found = None
        start = time.perf_counter()
        if source.path is None:
            tree = kept_sphere_tree(mesh, options, report, build.threads or usual_threads())
        else:
            unit = METRES_PER_UNIT[source.from_unit] if source.from_unit else mesh_file.unit_length(object_)
            if format_of(source.path) not in ("", "h5") or (link and not of_object):
                found = import_spheres(source.path, mesh, link, seed)
            else:
                found = import_tree(source.path, mesh, unit, seed, report)
            tree = found.tree
        seconds = time.perf_counter() - start
        if path.suffix == ".sph":
            save_sph(tree, path)
        else:
            save_tree(tree, path)
        if plot is not None:
            draw_tree(plot, mesh, tree)
        faults = tree.check(mesh)
        fit = measure_fit(mesh, tree.leaf_center, tree.leaf_radius, seed) if found else None
    print_notes(mesh.warnings, prefix="warning")
    columns = (
        *map(number, ("level", "spheres")),
        number("protrusion max", "protrusion_max", "mm", 3),
        number("p99", "protrusion_p99", "mm", 3),
        number("mean", "protrusion_mean", "mm", 3),
        number("proved bound", "bound", "mm", 3),
        number("gap max", "gap_max", "mm", 3),
        number("CPU", lambda error: _of_level(tree, error.level)["cpu_seconds"], "s", 2, missing=""),
    )
    parts: list[Table | str] = [Table(columns, tree.errors, f"{mesh.name}: {len(mesh.faces):,} triangles")]
    if fit is not None:
        parts.append(Table(fit_columns(), [fit], "fit of the leaves"))
    parts += [f"repaired: {repair}" for repair in mesh.repairs]
    parts += [f"note: {note}" for note in found.notes] if found else []
    parts += [f"not proved: {fault}" for fault in faults] if found is None or tree.covers else []
    if not faults:
        gap = tree.covers[-1].gap
        part = f"no part of the mesh is farther than {1e3 * gap:.3f} mm outside of the leaves"
        parts.append(f"proved and checked: {part if gap else 'each level covers the whole mesh'}")
    if build.max_error is not None:
        parts.append(f"the fewest spheres that were found within {1e3 * build.max_error:g} mm")
    how = "read from the cache" if cached else f"built in {seconds:.1f} s"
    how = how if source.path is None else f"read from {source.path}"
    output.show(
        {
            "object": mesh.name,
            "triangles": len(mesh.faces),
            "extent": mesh.extent.tolist(),
            "repairs": mesh.repairs,
            "warnings": mesh.warnings,
            "leaves": tree.leaf_count,
            "levels": [vars(error) | _of_level(tree, error.level) for error in tree.errors],
            "options": dict(tree.options),
            "fit": asdict(fit) if fit else None,
            "proved": not faults,
            "faults": faults,
            "seconds": seconds,
            "cached": cached,
            "frame": found.frame if found else "mesh",
            "notes": found.notes if found else (),
            "unproved_faces": found.unproved if found else 0,
            "path": str(path),
            "plot": None if plot is None else str(plot),
        },
        *parts,
        f"{counted(tree.leaf_count, 'leaf')}, {how}, written to {path}",
        *([f"the picture is in {plot}"] if plot else []),
    )


def _of_level(tree: "SphereTree", level: int) -> dict[str, float | None]:
    return {
        "gap_bound": tree.covers[level].gap if tree.covers and tree.covers[level].proved else None,
        "cpu_seconds": tree.cpu_seconds[level] if tree.cpu_seconds else None,
    }
