"""`hhsim build-tree ROBOT`: spheres for every link of a URDF or MJCF, and `--from` with spheres of links."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from hhsim.errors import InputError, named
from hhsim.system.counted import counted
from hhsim.table.table import Table, number, words

from .arguments.command import OptionGroup, option
from .arguments.options import Output
from .console import print_notes, progress

if TYPE_CHECKING:
    from hhsim.linkage.linkage import Robot
    from hhsim.mesh.mesh import Mesh
    from hhsim.robots.link_spheres import LinkSpheres
    from hhsim.robots.touching_pairs import Touching
    from hhsim.trees.foreign_tree import ImportedTree
    from hhsim.trees.options import TreeOptions

USUAL_LEAVES = 16
"""Spheres of a link where nothing says how many."""
Leaves = Annotated[int, click.IntRange(1, 262_144)]
IGNORED = {
    "always": "adjacent or touching in every one of 10,000 poses",
    "default": "adjacent or touching in the start pose or in every one of 10,000 poses",
    "adjacent": "adjacent",
}
"""Pairs of links that a planner is to ignore, by --ignore."""
MOST_TOLD = 6
"""Most pairs of links that a note names."""


class RobotOptions(OptionGroup, heading="Robot"):
    """One link of a robot, format of its spheres, and where they are shown."""

    link: str | None = option("One link of a URDF or MJCF file, or of a --from file.", "NAME")
    kind: Literal["h5", "urdf", "curobo", "json", "mjcf", "srdf", "xrdf"] | None = option(
        "Format of the spheres. Default: that of --out's ending, or h5.", None, "--as"
    )
    visual: bool = option("A link in which nothing collides gets spheres for what is seen of it.")
    ignore: Literal["always", "default", "adjacent"] | None = option(
        "Pairs of links for the planner to ignore: adjacent ones and those that touch in every pose (always), "
        "those that touch in the start pose too (default), or adjacent ones alone. Default: always."
    )

    def means(self, object_: str, out: Path | None) -> bool:
        """Return True if OBJECT is a robot: a URDF or MJCF whose links move, unless one link's tree is asked for."""
        from hhsim.linkage.file import names_a_linkage, read_robot
        from hhsim.robots.formats import format_of

        named = self.visual or (self.kind, self.ignore) != (None, None)
        if not names_a_linkage(object_):
            if named:
                raise click.UsageError(
                    f"--as, --visual and --ignore are for a robot, a URDF or MJCF file, and {object_} is none"
                )
            return False
        named = named or (out is not None and format_of(out) not in ("", "h5"))
        return named or (not self.link and read_robot(Path(object_)).moves)


def robot_spheres(
    path: Path,
    robot_options: RobotOptions,
    options: "TreeOptions",
    source: Path | None,
    output: Output,
    plot: Path | None,
    threads: int,
    seed: int,
) -> None:
    """Build the spheres of a robot's links, or judge those of a file, and write, draw, show and print them."""
    from hhsim.linkage.file import read_robot
    from hhsim.robots.formats import FORMATS, RobotSpheres, format_of
    from hhsim.robots.link_spheres import build_links, link_meshes
    from hhsim.robots.touching_pairs import touching_pairs
    from hhsim.system.atomic_write import write_atomically
    from hhsim.system.output_path import check_output_path, check_picture, holds

    name = robot_options.kind or ("" if output.out is None else format_of(output.out)) or "h5"
    format_ = FORMATS[name]
    out = output.path(f"{path.stem}-spheres", format_.suffixes[0])
    if format_of(out) != name:
        raise InputError(f"--out {out}: expected a file that ends in {' or '.join(format_.suffixes)} (--as {name})")
    check_output_path(out, "file of spheres", holds(format_.mark))
    if plot is not None:
        check_picture(plot)
    start = time.process_time()
    with progress(quiet=output.quiet) as report:
        report("read", 0, 1)
        robot = read_robot(path, robot_options.visual)
        meshes = link_meshes(robot, path, robot_options.link or "")
        notes = list(robot.notes)
        notes += [f"{mesh.name}: {note}" for mesh in meshes.values() for note in (*mesh.repairs, *mesh.warnings)]
        if source is not None:
            built = _judged(robot, meshes, source, seed, notes)
        else:
            built = build_links(robot, meshes, dict.fromkeys(meshes, options), threads, report)
        ignore = robot_options.ignore or "always"
        of_links = {name: each.spheres for name, each in built.items()}
        ignored, touching = touching_pairs(robot, of_links, seed, ignore)
        notes += _told(touching)
    found = RobotSpheres(robot, path, tuple(built.values()), ignored)
    write_atomically(out, format_.write(found))
    if plot is not None:
        from hhsim.render.spheres_figure import draw_robot

        draw_robot(plot, found)
    seconds = time.process_time() - start
    print_notes(notes)
    columns = (words("link", "name"), *fit_columns("fit."), number("CPU", "cpu_seconds", "s", 2))
    bare = ", ".join(link.name for link in found.links if not link.proved)
    proof = "proved: every triangle of every link lies in its spheres"
    pairs, cached = sum(map(len, found.ignored.values())), sum(link.cached for link in found.links)
    spheres = sum(link.fit.spheres for link in found.links)
    of_link = ("proved", "cpu_seconds", "cached")
    output.show(
        {
            "robot": robot.name,
            "links": [
                {"link": link.name, "triangles": len(link.mesh.faces), **asdict(link.fit)}
                | {name: getattr(link, name) for name in of_link}
                for link in found.links
            ],
            "spheres": spheres,
            "collision_spheres": {name: each.tolist() for name, each in found.spheres.items()},
            "self_collision_ignore": {one: list(others) for one, others in ignored.items()},
            "cpu_seconds": seconds,
            "as": name,
            "path": str(out),
            "plot": plot and str(plot),
            "notes": notes,
            "touching": [pair._asdict() for pair in touching],
        },
        Table(columns, found.links, f"{robot.name}: {counted(len(found.links), 'link')}"),
        f"not proved to be covered: {bare}" if bare else proof,
        f"{counted(pairs, 'pair')} of links {IGNORED[ignore]}",
        f"{seconds:.1f} s of CPU{f', {cached} of {len(found.links)} links read from the cache' if cached else ''}",
        f"{counted(spheres, 'sphere')}, written to {out}",
        *([f"the picture is in {plot}"] if plot else []),
    )


def _judged(
    robot: "Robot", meshes: Mapping[str, "Mesh"], source: Path, seed: int, notes: list[str]
) -> "dict[str, LinkSpheres]":
    """Measure the spheres of a file on the links of the same names, and note what has no counterpart."""
    from hhsim.robots.formats import read_spheres
    from hhsim.robots.link_spheres import judge_link
    from hhsim.trees.fit import doubt

    given = read_spheres(source)
    both = [name for name in meshes if name in given]
    if not both:
        raise InputError(f"{source}: spheres of {', '.join(given)}; expected some of {', '.join(meshes)}")
    for names, what in (
        ([name for name in meshes if name not in given], "no spheres in the file"),
        ([name for name in given if name not in meshes], "spheres, but no collision geometry here"),
    ):
        if names:
            notes.append(f"{', '.join(names)}: {what}")
    found = {name: judge_link(robot.link(name), meshes[name], given[name], seed) for name in both}
    for name, link in found.items():
        with named(source):
            in_doubt = doubt(link.mesh, link.fit.protrusion_max, link.fit.surface_gap_mean)
        notes += [f"{name}: {in_doubt}"] if in_doubt else []
    return found


def _told(touching: "Sequence[Touching]") -> Iterator[str]:
    """Return what a planner that compares these pairs would find."""
    start = [f"{pair.one} and {pair.other} by {1e3 * pair.depth:.1f} mm" for pair in touching if pair.depth > 0.0]
    often = [f"{pair.one} and {pair.other} in {100.0 * pair.share:.0f} %" for pair in touching if pair.depth <= 0.0]
    if start:
        yield f"spheres of links touch in the start pose: {_first(start)}; --ignore default lists them for the planner"
    if often:
        yield f"spheres of links touch in most poses: {_first(often)}; fewer do with more spheres"


def _first(texts: list[str]) -> str:
    more = len(texts) - MOST_TOLD
    return ", ".join(texts[:MOST_TOLD]) + (f" and {counted(more, 'more pair')}" if more > 0 else "")


def import_spheres(source: Path, mesh: "Mesh", link: str, seed: int) -> "ImportedTree":
    """Read the spheres of one link from a file, and measure them on a mesh; InputError names the links of several."""
    from hhsim.robots.formats import read_spheres
    from hhsim.robots.link_spheres import tree_of_spheres
    from hhsim.trees.foreign_tree import judge_tree

    given = read_spheres(source)
    if link and link not in given:
        raise InputError(f"{source}: no link '{link}'; it has {', '.join(given)}")
    if not link and len(given) > 1:
        raise InputError(f"{source}: spheres of {', '.join(given)}; expected the name of one (--link)")
    return judge_tree(source, tree_of_spheres(given[link or next(iter(given))]), mesh, seed=seed)


def fit_columns(of: str = "") -> tuple[Any, ...]:
    """Return the columns of figures of a fit, which a row has as its field `of`, such as "fit."."""

    def percent(name: str) -> Any:
        share = attrgetter(f"{of}{name}")
        return lambda row: None if share(row) is None else 100.0 * share(row)

    return (
        number("spheres", f"{of}spheres"),
        number("inside covered", percent("coverage"), "%", 2, missing=""),
        number("surface covered", percent("surface_coverage"), "%", 2),
        number("largest gap", f"{of}surface_gap_max", "mm", 2),
        number("out max", f"{of}protrusion_max", "mm", 2),
        number("p95", f"{of}protrusion_p95", "mm", 2),
        number("mean", f"{of}protrusion_mean", "mm", 2),
        number("volume ratio", f"{of}volume_ratio", "", 2, missing=""),
        number("proved bound", f"{of}bound", "mm", 2),
    )
