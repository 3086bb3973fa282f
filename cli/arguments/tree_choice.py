"""Sphere tree of a replay: one of a level, the coarsest within an error, or that of a file."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from hhsim.system.progress import Progress

from .option_group import OptionGroup, option
from .options import file

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh
    from hhsim.scene.declared_bodies import DeclaredBodies
    from hhsim.trees.sphere_tree import SphereTree

AUTO = 0
LEAST_ERROR = 1e-6
"""Least --max-error [m]."""
METRES = {"": 1e-3, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


class ChosenTree(NamedTuple):
    """A sphere tree, and notes on the choice."""

    tree: "SphereTree"
    notes: tuple[str, ...]


def read_level(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Read 1 to 5, or auto."""
    if value is None:
        return None
    if value == "auto":
        return AUTO
    if value not in ("1", "2", "3", "4", "5"):
        raise click.BadParameter(f"'{value}', expected 1 to 5, or auto", context, parameter)
    return int(value)


def read_length(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Read a length such as 0.3mm or 300um, or a number in mm; return metres."""
    if value is None:
        return None
    found = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?) ?(|mm|um|µm|m)", value)
    try:
        length = float(found[1]) * METRES[found[2]] if found else 0.0
    except ValueError:
        length = 0.0
    if not LEAST_ERROR <= length < 1.0:
        raise click.BadParameter(f"'{value}', expected a length such as 0.3mm, from 1um to 1m", context, parameter)
    return length


class TreeChoice(OptionGroup, heading="Sphere tree"):
    """Level of the tree, or largest distance [m] of its spheres outside the mesh."""

    level: int | None = option(
        callback=read_level,
        metavar="N|auto",
        help="Level of the tree's leaves; auto: what --max-error needs. Default: the catalogue's, or 4.",
    )
    max_error: float | None = option(
        callback=read_length,
        metavar="LENGTH",
        help="Take the coarsest level whose spheres protrude by at most this: 0.3mm, 300um or 0.3 (mm).",
    )

    def choose(self, mesh: "Mesh", usual_level: int, report: Progress, *, solid: bool = True) -> ChosenTree:
        """Build the tree, or take it from the cache; without `solid` also of triangles that enclose nothing.

        Raises UsageError for options that contradict each other.
        """
        from hhsim.trees.cache import cached_sphere_tree, coarsest_sphere_tree
        from hhsim.trees.options import TreeOptions
        from hhsim.trees.triangle_tree import tree_of_any

        if self.level == AUTO and self.max_error is None:
            raise click.UsageError("--level auto needs --max-error, such as --max-error 0.3mm")
        if self.max_error is None:
            level = self.level or usual_level
            if solid:
                return ChosenTree(cached_sphere_tree(mesh, TreeOptions(level=level), report), ())
            return ChosenTree(tree_of_any(mesh, level, report), ())
        if self.level not in (None, AUTO):
            raise click.UsageError(f"--max-error chooses the level itself: leave --level {self.level} out")
        tree = coarsest_sphere_tree(mesh, self.max_error, report)
        note = (
            f"level {tree.depth} is the coarsest within {1e3 * self.max_error:g} mm: {tree.leaf_count:,} spheres, "
            f"which reach out of the mesh by {1e3 * tree.errors[-1].bound:.3f} mm at most"
        )
        return ChosenTree(tree, (note,))

    def grow(
        self, bodies: "DeclaredBodies", unit_length: float, report: Progress, *, solid: bool = True
    ) -> "tuple[DeclaredBodies, tuple[str, ...]]":
        """Return the bodies with their trees, and notes on the choice.

        `unit_length` [m] is that of a .sph file; other arguments and errors are those of `choose`.
        """
        notes: list[str] = []

        def made(mesh: "Mesh") -> "SphereTree":
            found = self.of(mesh, bodies.level, unit_length, report, solid=solid)
            notes.extend(found.notes)
            return found.tree

        return bodies.with_trees(made), tuple(dict.fromkeys(notes))

    def of(
        self, mesh: "Mesh", usual_level: int, unit_length: float, report: Progress, *, solid: bool = True
    ) -> ChosenTree:
        """Return the tree of a body, see `choose` and `grow`."""
        return self.choose(mesh, usual_level, report, solid=solid)


class TreeOrFile(TreeChoice):
    """A tree that is built, or that of a file."""

    path: Path | None = file(
        "FILE", "Take this sphere tree of the object, .h5 or .sph (hhsim build-tree), and build none.", "--tree"
    )

    def load(self, mesh: "Mesh", unit_length: float) -> ChosenTree:
        """Take the tree of the file; `unit_length` [m] is that of a .sph file."""
        from hhsim.trees.foreign_tree import load_tree_for

        assert self.path is not None
        if self.level is not None or self.max_error is not None:
            raise click.UsageError(f"--tree {self.path} has its own level: leave --level and --max-error out")
        found = load_tree_for(self.path, mesh, unit_length)
        return ChosenTree(found.tree, (f"the sphere tree is that of {self.path}", *found.notes))

    def of(
        self, mesh: "Mesh", usual_level: int, unit_length: float, report: Progress, *, solid: bool = True
    ) -> ChosenTree:
        """Return the tree of the file, or of `choose`."""
        if self.path is not None:
            return self.load(mesh, unit_length)
        return super().of(mesh, usual_level, unit_length, report, solid=solid)
