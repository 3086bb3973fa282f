"""Sphere trees: error against spheres against CPU time, beside other programs.

Each tree is measured by code that shares nothing with the builder, `hhsim.verify.tree_checks`. Errors are the
same in every run; times are not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Annotated, NamedTuple

from hhsim.bench.suite import Row, Suite, setting
from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.file import read_own_ply
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress
from hhsim.system.settings_file import between, check_fields
from hhsim.table.table import Column
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import MOST_LEVEL, TreeOptions
from hhsim.trees.published_results import BARS, EXTENT, LEAST_GAP, REFERENCES
from hhsim.verify.tree_checks import referee

BRANCHING = 8
MOST_SPHERES = BRANCHING**MOST_LEVEL
POINTS = 200_000
"""Samples of the mesh, and of the spheres, that a tree is measured at."""

_REFERENCE_SHAPES = ("cube", "hexagonal-prism", "cylinder", "cup")
"""Objects whose references have other proportions than the catalogue's; `tools/build_catalogue.py` makes them."""


@dataclass(frozen=True)
class TreesOptions:
    """Objects and sizes of the trees."""

    objects: tuple[str, ...] = setting(
        ("bunny", "teapot", "cube", "hexagonal-prism", "cylinder", "cup"), "Objects.", "--object"
    )
    spheres: tuple[Annotated[int, between(1, MOST_SPHERES)], ...] = setting(
        (64, 512, 4096), "Most leaves of the trees."
    )
    seed: int = setting(0)
    size: Annotated[float, between(1.0, 10_000.0)] = setting(
        1e3 * EXTENT, "Scale every object to this longest extent [mm].", metavar="MM"
    )
    time_limits: bool = setting(False, "A missed limit of the CPU time is a miss too.")

    def __post_init__(self) -> None:
        """Raise InputError for a number of spheres out of range or an unknown object."""
        check_fields(self)
        for name in self.objects:
            load_object(name)


COLUMNS = (
    Column("object", "object, scaled to the longest extent that the options say"),
    Column("method", "certified is hhsim's builder; for a reference the other program, in brackets"),
    Column("is_reference", "not built now: another program, as measured in November 2026"),
    Column("asked", "most spheres that the leaves may be; for a reference 0"),
    Column("spheres", "leaves that there are"),
    Column("level", "level of the leaves; for a reference 0"),
    Column("protrusion_max", "farthest that the union of the leaves was found outside of the mesh", "mm"),
    Column("protrusion_mean", "mean over the part of the union's surface that is outside", "mm"),
    Column("gap_max", "farthest that the mesh was found outside of the leaves", "mm"),
    Column("bound", "proved upper bound of the protrusion", "mm"),
    Column("is_proved", "the leaves hold a proof that they cover the mesh, and it was checked"),
    Column("cpu", "CPU time of the builder for all levels, without measuring and compiling", "s"),
    Column("cpu_leaves", "the same for the leaves' level alone", "s"),
    Column("protrusion_limit", "bar for the protrusion", "mm"),
    Column("cpu_limit", "bar for the CPU time", "s"),
)


def comparison_object(name: str, size: float) -> Mesh:
    """Return a reference's shape, or an object of the catalogue, of a longest extent [m]; else UnknownNameError."""
    if name in _REFERENCE_SHAPES:
        file = f"reference-{name}.ply"
        mesh = Mesh(*read_own_ply((files("hhsim.objects") / file).read_bytes(), file))
    else:
        mesh = load_object(name).mesh
    return replace(mesh.scaled(size / float(mesh.extent.max())), name=name)


class _Tree(NamedTuple):
    """Tree to build: most leaves of it, and whether the object's references follow."""

    mesh: Mesh
    spheres: int
    is_last: bool
    options: TreesOptions


def cells(options: TreesOptions, progress: Progress) -> list[_Tree]:
    """Return the trees, object by object, by growing size."""
    # Compiles or loads every kernel, so that no tree is timed with it.
    build_sphere_tree(comparison_object("cube", EXTENT), TreeOptions(leaves=BRANCHING**2))
    sizes = sorted(options.spheres)
    meshes = [comparison_object(name, 1e-3 * options.size) for name in options.objects]
    return [_Tree(mesh, spheres, spheres == sizes[-1], options) for mesh in meshes for spheres in sizes]


def run(cell: _Tree, before: None = None) -> list[Row]:
    """Build and measure a tree; HhsimError for an object that the builder cannot do."""
    mesh, spheres, options, scale = cell.mesh, cell.spheres, cell.options, 1e-3 * cell.options.size / EXTENT
    try:
        tree = build_sphere_tree(mesh, TreeOptions(leaves=spheres, branching=BRANCHING, seed=options.seed))
    except HhsimError as error:
        raise type(error)(f"{spheres:,} spheres: {error}") from error
    (found,) = referee(mesh, tree, [tree.depth], mesh_points=POINTS, sphere_points=POINTS, seed=options.seed)
    bar = BARS.get((mesh.name, spheres))
    row = {
        "object": mesh.name,
        "method": "certified",
        "is_reference": False,
        "asked": spheres,
        "spheres": tree.leaf_count,
        "level": tree.depth,
        "protrusion_max": found.protrusion,
        "protrusion_mean": found.protrusion_mean,
        "gap_max": found.gap,
        "bound": tree.errors[-1].bound,
        "is_proved": not tree.check(mesh),
        "cpu": float(sum(tree.cpu_seconds)),
        "cpu_leaves": float(tree.cpu_seconds[-1]),
        "protrusion_limit": None if bar is None else bar.protrusion * scale,
        "cpu_limit": None if bar is None else bar.cpu,
    }
    return [row, *(_references(mesh.name, scale) if cell.is_last else ())]


def _references(name: str, scale: float) -> Iterator[Row]:
    for peer in REFERENCES:
        if peer.object == name:
            yield {
                **dict.fromkeys(column.name for column in COLUMNS),
                "object": name,
                "method": f"({peer.label})",
                "is_reference": True,
                "asked": 0,
                "spheres": None if peer.spheres is None else float(peer.spheres),
                "level": 0,
                "protrusion_max": peer.protrusion * scale,
                "protrusion_mean": None if peer.protrusion_mean is None else peer.protrusion_mean * scale,
                "gap_max": None if peer.gap is None else peer.gap * scale,
                "is_proved": False,
                "cpu": peer.cpu,
            }


def missed_bars(options: TreesOptions, rows: Sequence[Row]) -> list[str]:
    """Return the bars that our trees miss, a few words each: error, gap, proof, and CPU time if that is a limit."""
    missed = []
    for row in rows:
        if row["is_reference"]:
            continue
        what = f"{row['object']}, {row['asked']:,} spheres"
        limit = row["protrusion_limit"]
        if limit is not None and not row["protrusion_max"] <= limit:
            missed.append(f"{what}: protrudes {1e3 * row['protrusion_max']:.3f} mm, limit {1e3 * limit:.3f} mm")
        if not row["gap_max"] <= LEAST_GAP:
            missed.append(f"{what}: a gap of {1e9 * row['gap_max']:.1f} nm, limit {1e9 * LEAST_GAP:.0f} nm")
        if not row["is_proved"]:
            missed.append(f"{what}: no proof of the cover")
        if options.time_limits and row["cpu_limit"] is not None and not row["cpu"] <= row["cpu_limit"]:
            missed.append(f"{what}: {row['cpu']:.1f} s of CPU time, limit {row['cpu_limit']:.1f} s")
    return missed


SHOWN = "method spheres protrusion_max protrusion_limit protrusion_mean bound gap_max cpu cpu_limit cpu_leaves"
SUITE = Suite(
    help="""Build sphere trees and hold them against those of other programs: error, spheres, CPU time.

    All objects get one longest extent; cube, prism, cylinder and cup are the shapes that other programs were measured
    on, which stand in the same table. Errors are measured by code apart from the builders, and come out the same in
    every run. The exit code is 1 where a tree protrudes farther than its limit, has a gap or no proof.

    \b
    Examples:
      hhsim bench trees
      hhsim bench trees --object bunny --spheres 64,128,256,512
      hhsim bench trees --out trees.json --time-limits
    """,
    settings=TreesOptions,
    columns=COLUMNS,
    cells=cells,
    run=run,
    shown=SHOWN,
    by="object",
    missed=missed_bars,
    lines=lambda options, rows: [
        "in brackets: other programs, as measured in November 2026 on one core of a 2-core machine"
    ],
    is_portable=True,
    named=lambda cell: f"{cell.mesh.name}, {cell.spheres:,} spheres",
)
