"""Our sphere trees beside those of other programs: error against spheres against CPU time.

Each tree is measured by code that shares nothing with the builder, `hhsim.verify.tree_checks`. Errors are the
same in every run; times are not.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Annotated, Any

import numpy as np

from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.file import read_own_ply
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import between, check_fields
from hhsim.table.table import Column
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import MOST_LEVEL, TreeOptions
from hhsim.trees.published_results import BARS, EXTENT, LEAST_GAP, REFERENCES
from hhsim.verify.tree_checks import referee

Row = dict[str, Any]

BRANCHING = 8
MOST_SPHERES = BRANCHING**MOST_LEVEL

_REFERENCE_SHAPES = ("cube", "hexagonal-prism", "cylinder", "cup")
"""Objects whose references have other proportions than the catalogue's; `tools/build_catalogue.py` makes them."""


@dataclass(frozen=True)
class TreesOptions:
    """Options of the suite."""

    # Names of the catalogue.
    objects: tuple[str, ...] = ("bunny", "teapot", "cube", "hexagonal-prism", "cylinder", "cup")
    spheres: tuple[Annotated[int, between(1, MOST_SPHERES)], ...] = (64, 512, 4096)  # limits of the leaves of the trees
    size: float = EXTENT  # longest extent of the objects [m]
    seed: int = 0  # of the samples
    points: int = 200_000  # number of samples of the mesh, and of the spheres

    def __post_init__(self) -> None:
        """Raise InputError for a number of spheres out of range or an unknown object."""
        check_fields(self)
        for name in self.objects:
            load_object(name)


COLUMNS = (
    Column("object", "object, scaled to the longest extent that the options say"),
    Column("method", "certified is hhsim's builder; for a reference the other program"),
    Column("is_reference", "not built now: another program, as measured in November 2026"),
    Column("asked", "most spheres that the leaves may be; for a reference 0"),
    Column("spheres", "leaves that there are"),
    Column("level", "level of the leaves; for a reference 0"),
    Column("protrusion_max", "farthest that the union of the leaves was found outside of the mesh", "m"),
    Column("protrusion_mean", "mean over the part of the union's surface that is outside", "m"),
    Column("gap_max", "farthest that the mesh was found outside of the leaves", "m"),
    Column("bound", "proved upper bound of the protrusion", "m"),
    Column("is_proved", "the leaves hold a proof that they cover the mesh, and it was checked"),
    Column("cpu", "CPU time of the builder for all levels, without measuring and compiling", "s"),
    Column("cpu_leaves", "the same for the leaves' level alone", "s"),
    Column("protrusion_limit", "bar for the protrusion", "m"),
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


def measure(options: TreesOptions, progress: Progress = silent) -> list[Row]:
    """Build and measure every tree; return rows in the order of objects and sizes, references last of each object.

    HhsimError for an object that the builder cannot do.
    """
    # Compiles or loads every kernel, so that no tree is timed with it.
    build_sphere_tree(comparison_object("cube", EXTENT), TreeOptions(leaves=BRANCHING**2))
    rows: list[Row] = []
    each = len(options.spheres)
    total = len(options.objects) * each
    for number, name in enumerate(options.objects):
        mesh = comparison_object(name, options.size)
        for i, spheres in enumerate(sorted(options.spheres)):
            progress(f"{name}, {spheres:,} spheres", number * each + i, total)
            rows.append(_row(mesh, spheres, options))
        rows += _references(name, options.size)
    progress("done", total, total)
    return rows


def _row(mesh: Mesh, spheres: int, options: TreesOptions) -> Row:
    try:
        tree = build_sphere_tree(mesh, TreeOptions(leaves=spheres, branching=BRANCHING, seed=options.seed))
    except HhsimError as error:
        raise type(error)(f"{spheres:,} spheres: {error}") from error
    points = options.points
    (found,) = referee(mesh, tree, [tree.depth], mesh_points=points, sphere_points=points, seed=options.seed)
    bar = BARS.get((mesh.name, spheres))
    return {
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
        "protrusion_limit": None if bar is None else bar.protrusion * options.size / EXTENT,
        "cpu_limit": None if bar is None else bar.cpu,
    }


def _references(name: str, size: float) -> Iterator[Row]:
    scale = size / EXTENT
    for peer in REFERENCES:
        if peer.object == name:
            yield {
                **dict.fromkeys(column.name for column in COLUMNS),
                "object": name,
                "method": peer.label,
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


def missed_bars(rows: Sequence[Mapping[str, Any]], *, with_times: bool = False) -> list[str]:
    """Return the bars that our trees miss, a sentence each: error, gap, proof, and CPU time `with_times`."""
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
        if with_times and row["cpu_limit"] is not None and not row["cpu"] <= row["cpu_limit"]:
            missed.append(f"{what}: {row['cpu']:.1f} s of CPU time, limit {row['cpu_limit']:.1f} s")
    return missed


def largest_error(row: Mapping[str, Any]) -> float:
    """Return the larger of protrusion and gap [m], as far as they are known."""
    known = [value for value in (row["protrusion_max"], row["gap_max"]) if value is not None and not np.isnan(value)]
    return float(max(known))
