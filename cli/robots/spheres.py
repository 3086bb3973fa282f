"""`hhsim build-tree ROBOT`: spheres for every link of a URDF or MJCF, and `--from` with spheres of links."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import click

from hhsim.errors import InputError, named
from hhsim.system.counted import counted
from hhsim.table.table import Table, number, words

from ..arguments.option_group import OptionGroup, option
from ..arguments.options import Output
from ..console import print_json, print_line, print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.linkage.linkage import Robot
    from hhsim.mesh.mesh import Mesh
    from hhsim.robots.formats import RobotSpheres
    from hhsim.robots.link_spheres import LinkSpheres
    from hhsim.robots.touching_pairs import Touching
    from hhsim.trees.foreign_tree import ImportedTree
    from hhsim.trees.options import TreeOptions

USUAL_LEAVES = 16
"""Spheres of a link where nothing says how many."""
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

    link: str | None = option(metavar="NAME", help="One link of a URDF or MJCF file, or of a --from file.")
    kind: str | None = option(
        "--as",
        type=click.Choice(["h5", "urdf", "curobo", "json", "mjcf", "srdf", "xrdf"]),
        help="Format of the spheres. Default: that of --out's ending, or h5.",
    )
    visual: bool = option(is_flag=True, help="A link in which nothing collides gets spheres for what is seen of it.")
    ignore: str | None = option(
        type=click.Choice(list(IGNORED)),
        help="Pairs of links for the planner to ignore: adjacent ones and those that touch in every pose (always), "
        "those that touch in the start pose too (default), or adjacent ones alone. Default: always.",
    )
    compare: bool = option(
        is_flag=True, help="Beside --from: build as many spheres of each link, and print both. The file's are written."
    )

    def means(self, object_: str, out: Path | None) -> bool:
        """Return True if OBJECT is a robot: a URDF or MJCF whose links move, unless one link's tree is asked for."""
        from hhsim.linkage.file import names_a_linkage, read_robot
        from hhsim.robots.formats import format_of

        named = self.compare or self.visual or (self.kind, self.ignore) != (None, None)
        if not names_a_linkage(object_):
            if named:
                raise click.UsageError(
                    "--as, --visual, --ignore and --compare are for a robot, a URDF or MJCF file, and "
                    f"{object_} is none"
                )
            return False
        named = named or (out is not None and format_of(out) not in ("", "h5"))
        return named or (not self.link and read_robot(Path(object_)).moves)


def robot_spheres(
    path: Path,
    robot_options: RobotOptions,
    options: "TreeOptions | None",
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
    from hhsim.trees.options import TreeOptions

    out_kind = "" if output.out is None else format_of(output.out)
    name = robot_options.kind or out_kind or "h5"
    format_ = FORMATS[name]
    out = output.path(f"{path.stem}-spheres", format_.suffixes[0])
    if format_of(out) != name:
        raise InputError(f"--out {out}: expected a file that ends in {' or '.join(format_.suffixes)} (--as {name})")
    check_output_path(out, "file of spheres", holds(format_.mark))
    if plot is not None:
        check_picture(plot)
    if robot_options.compare and source is None:
        raise click.UsageError("--compare is for --from FILE")
    start, compared = time.process_time(), []
    with progress(quiet=output.quiet) as report:
        report("read", 0, 1)
        robot = read_robot(path, robot_options.visual)
        meshes = link_meshes(robot, path, robot_options.link or "")
        notes = list(robot.notes)
        notes += [f"{mesh.name}: {note}" for mesh in meshes.values() for note in (*mesh.repairs, *mesh.warnings)]
        if source is not None:
            built = _judged(robot, meshes, source, seed, notes)
            if robot_options.compare:
                many = {link: TreeOptions(leaves=each.fit.spheres, seed=seed) for link, each in built.items()}
                ours = build_links(robot, meshes, many, threads, report)
                compared = [_in_all(source.name, built), _in_all("hhsim", ours)]
        else:
            each = options or TreeOptions(leaves=USUAL_LEAVES, seed=seed)
            built = build_links(robot, meshes, dict.fromkeys(meshes, each), threads, report)
        spheres = {name: each.spheres for name, each in built.items()}
        ignore = robot_options.ignore or "always"
        ignored, touching = touching_pairs(robot, spheres, seed, ignore)
        notes += _told(touching)
    found = RobotSpheres(robot, path, tuple(built.values()), ignored)
    write_atomically(out, format_.write(found))
    if plot is not None:
        from hhsim.render.spheres_figure import draw_robot

        draw_robot(plot, found)
    seconds = time.process_time() - start
    print_notes(notes)
    if output.as_json:
        print_json(
            _document(found, seconds)
            | {"as": name, "path": str(out), "plot": plot and str(plot), "notes": notes, "compared": compared}
            | {"touching": [pair._asdict() for pair in touching]}
        )
    elif not output.quiet:
        _print(found, seconds, ignore)
        if compared:
            print_table(Table(COMPARED, compared, f"{counted(len(built), 'link')}, as many spheres of each"))
        print_line(f"{counted(sum(each.fit.spheres for each in found.links), 'sphere')}, written to {out}")
        if plot is not None:
            print_line(f"the picture is in {plot}")


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


def _in_all(name: str, links: "Mapping[str, LinkSpheres]") -> dict[str, Any]:
    """Return the figures of all links together; shares [-], lengths [m]."""
    fits = [link.fit for link in links.values()]
    covered, out = [fit.surface_coverage for fit in fits], [fit.protrusion_max for fit in fits]
    return {
        "set": name,
        "spheres": sum(fit.spheres for fit in fits),
        "surface_coverage_mean": sum(covered) / len(covered),
        "surface_coverage_least": min(covered),
        "surface_gap_max": max(fit.surface_gap_max for fit in fits),
        "protrusion_median": median(out),
        "protrusion_max": max(out),
    }


COMPARED = (
    words("spheres of", "set"),
    number("spheres"),
    number("surface covered, mean", lambda row: 100.0 * row["surface_coverage_mean"], "%", 1),
    number("worst link", lambda row: 100.0 * row["surface_coverage_least"], "%", 1),
    number("largest gap", "surface_gap_max", "mm", 1),
    number("out max, median link", "protrusion_median", "mm", 1),
    number("worst link", "protrusion_max", "mm", 1),
)


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
    """Return the columns of figures of a fit, which a row has as its field `of`."""

    def value(name: str, factor: float = 1.0) -> Any:
        def read(row: Any) -> float | None:
            found = getattr(getattr(row, of) if of else row, name)
            return None if found is None else factor * found

        return read

    return (
        number("spheres", value("spheres")),
        number("inside covered", value("coverage", 100.0), "%", 2, missing=""),
        number("surface covered", value("surface_coverage", 100.0), "%", 2),
        number("largest gap", value("surface_gap_max"), "mm", 2),
        number("out max", value("protrusion_max"), "mm", 2),
        number("p95", value("protrusion_p95"), "mm", 2),
        number("mean", value("protrusion_mean"), "mm", 2),
        number("volume ratio", value("volume_ratio"), "", 2, missing=""),
        number("proved bound", value("bound"), "mm", 2),
    )


def _print(found: "RobotSpheres", seconds: float, kind: str) -> None:
    columns = (words("link", "name"), *fit_columns("fit"), number("CPU", "cpu_seconds", "s", 2))
    print_table(Table(columns, found.links, f"{found.robot.name}: {counted(len(found.links), 'link')}"))
    bare = [link.name for link in found.links if not link.proved]
    if bare:
        print_line(f"not proved to be covered: {', '.join(bare)}")
    else:
        print_line("proved: every triangle of every link lies in its spheres")
    pairs = sum(map(len, found.ignored.values()))
    print_line(f"{counted(pairs, 'pair')} of links {IGNORED[kind]}")
    cached = sum(link.cached for link in found.links)
    print_line(
        f"{seconds:.1f} s of CPU{f', {cached} of {len(found.links)} links read from the cache' if cached else ''}"
    )


def _document(found: "RobotSpheres", seconds: float) -> dict[str, Any]:
    return {
        "robot": found.robot.name,
        "links": [
            {
                "link": link.name,
                "triangles": len(link.mesh.faces),
                **asdict(link.fit),
                "proved": link.proved,
                "cpu_seconds": link.cpu_seconds,
                "cached": link.cached,
            }
            for link in found.links
        ],
        "spheres": sum(link.fit.spheres for link in found.links),
        "collision_spheres": {name: each.tolist() for name, each in found.spheres.items()},
        "self_collision_ignore": {one: list(others) for one, others in found.ignored.items()},
        "cpu_seconds": seconds,
    }
