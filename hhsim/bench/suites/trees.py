"""Sphere trees: error against spheres against CPU time, beside other programs.

Each tree is measured by code that shares nothing with the builder, `hhsim.verify.tree_checks`. Errors are the
same in every run; times are not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Annotated, NamedTuple

from hhsim.bench.suite import Row, Suite
from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.file import read_own_ply
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress
from hhsim.system.settings_file import between
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


@dataclass(frozen=True, kw_only=True)
class Trees(Suite):
    """Objects and sizes of the trees."""

    objects: tuple[str, ...]
    spheres: tuple[Annotated[int, between(1, MOST_SPHERES)], ...]
    seed: int
    size: Annotated[float, between(1.0, 10_000.0)]  # [mm]
    time_limits: bool
    is_portable = True

    def check(self) -> None:
        """Raise InputError for an unknown object."""
        for name in self.objects:
            load_object(name)

    def cells(self, progress: Progress) -> list[_Tree]:
        """Return the trees, object by object, by growing size."""
        # Compiles or loads every kernel, so that no tree is timed with it.
        build_sphere_tree(comparison_object("cube", EXTENT), TreeOptions(leaves=BRANCHING**2))
        sizes = sorted(self.spheres)
        meshes = [comparison_object(name, 1e-3 * self.size) for name in self.objects]
        return [_Tree(mesh, spheres, spheres == sizes[-1]) for mesh in meshes for spheres in sizes]

    def run(self, cell: _Tree, before: None) -> list[Row]:
        """Build and measure a tree; HhsimError for an object that the builder cannot do."""
        mesh, spheres, scale = cell.mesh, cell.spheres, 1e-3 * self.size / EXTENT
        try:
            tree = build_sphere_tree(mesh, TreeOptions(leaves=spheres, branching=BRANCHING, seed=self.seed))
        except HhsimError as error:
            raise type(error)(f"{spheres:,} spheres: {error}") from error
        (found,) = referee(mesh, tree, [tree.depth], mesh_points=POINTS, sphere_points=POINTS, seed=self.seed)
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
        return [row, *(self._references(mesh.name, scale) if cell.is_last else ())]

    def _references(self, name: str, scale: float) -> Iterator[Row]:
        for peer in REFERENCES:
            if peer.object == name:
                yield {
                    **dict.fromkeys(self.plan().figures),
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

    def missed(self, rows: Sequence[Row]) -> list[str]:
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
            if self.time_limits and row["cpu_limit"] is not None and not row["cpu"] <= row["cpu_limit"]:
                missed.append(f"{what}: {row['cpu']:.1f} s of CPU time, limit {row['cpu_limit']:.1f} s")
        return missed

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say what stands in brackets."""
        return ["in brackets: other programs, as measured in November 2026 on one core of a 2-core machine"]

    def named(self, cell: _Tree) -> str:
        """Return object and size."""
        return f"{cell.mesh.name}, {cell.spheres:,} spheres"


SUITE = Trees
