"""Sphere tree of a replay: one of a level, the coarsest within an error, or that of a file."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from hhsim.system.progress import Progress

from .length import read_length
from .option_group import OptionGroup, option
from .options import file

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh
    from hhsim.scene.declared_bodies import DeclaredBodies
    from hhsim.trees.sphere_tree import SphereTree

AUTO = 0


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

    def stated(self) -> int | None:
        """Return the level that was named; UsageError for options that contradict each other."""
        if self.level == AUTO and self.max_error is None:
            raise click.UsageError("--level auto needs --max-error, such as --max-error 0.3mm")
        if self.max_error is not None and self.level not in (None, AUTO):
            raise click.UsageError(f"--max-error chooses the level itself: leave --level {self.level} out")
        return self.level or None

    def choose(self, mesh: "Mesh", usual_level: int, report: Progress, *, solid: bool = True) -> ChosenTree:
        """Build the tree, or take it from the cache; without `solid` also of triangles that enclose nothing.

        Raises UsageError as `stated`.
        """
        from hhsim.trees.triangle_tree import chosen_tree

        return ChosenTree(*chosen_tree(mesh, self.stated() or usual_level, self.max_error, solid, report))

    def grow(
        self, bodies: "DeclaredBodies", report: Progress, *, solid: bool = True
    ) -> "tuple[DeclaredBodies, tuple[str, ...]]":
        """Return the bodies with their trees, and notes on the choice; arguments and errors are those of `choose`."""
        notes: list[str] = []

        def made(mesh: "Mesh") -> "SphereTree":
            found = self.choose(mesh, bodies.level, report, solid=solid)
            notes.extend(found.notes)
            return found.tree

        return bodies.with_trees(made), tuple(dict.fromkeys(notes))


class TreeOrFile(TreeChoice):
    """A tree that is built, or that of a file."""

    path: Path | None = file(
        "FILE", "Take this sphere tree of the object, .h5 or .sph (hhsim build-tree), and build none.", "--tree"
    )

    def stated(self) -> int | None:
        """See `TreeChoice.stated`; a file has its own level."""
        if self.path is not None and (self.level is not None or self.max_error is not None):
            raise click.UsageError(f"--tree {self.path} has its own level: leave --level and --max-error out")
        return super().stated()
