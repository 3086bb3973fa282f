"""How fine the sphere tree of a replay is: a level, or the coarsest one within an error budget."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from .console import Report

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh
    from hhsim.trees.sphere_tree import SphereTree

AUTO = 0
"""Stands for `--level auto`."""
METRES = {"": 1e-3, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


class ChosenTree(NamedTuple):
    """A sphere tree, its level, and what to tell of the choice."""

    tree: "SphereTree"
    level: int
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
    """Read a length such as 0.3mm or 300um; a bare number is in mm. Returns metres."""
    if value is None:
        return None
    found = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?) ?(|mm|um|µm|m)", value)
    try:
        length = float(found[1]) * METRES[found[2]] if found else 0.0
    except ValueError:
        length = 0.0
    if not 0.0 < length < 1.0:
        raise click.BadParameter(f"'{value}', expected a length such as 0.3mm", context, parameter)
    return length


level = click.option(
    "--level",
    callback=read_level,
    metavar="N|auto",
    help="Level of the sphere tree's leaves, 1 to 5; auto: what --max-error needs. Default: 3 or 4, as the catalogue "
    "says; 4 for a mesh file.",
)
max_error = click.option(
    "--max-error",
    callback=read_length,
    metavar="LENGTH",
    help="How far the spheres may reach out of the mesh: 0.3mm, 300um; a bare number is in mm. Takes the coarsest "
    "level that is proved to be within it.",
)


def choose_tree(
    mesh: "Mesh",
    wanted: int | None,
    usual: int,
    budget: float | None,
    report: Report | None,
    file: Path | None = None,
    unit_length: float = 1.0,
) -> ChosenTree:
    """Build or load the tree that the options ask for; `unit_length` [m] is that of a .sph `file`."""
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.level_choice import coarsest_sphere_tree
    from hhsim.trees.options import TreeOptions

    if file is not None:
        from hhsim.trees.foreign_tree import load_tree_for

        if wanted is not None or budget is not None:
            raise click.UsageError(f"--tree {file} has its own level: leave --level and --max-error out")
        found = load_tree_for(file, mesh, unit_length)
        return ChosenTree(found.tree, found.tree.depth, (f"the sphere tree is that of {file}", *found.notes))
    if wanted == AUTO and budget is None:
        raise click.UsageError("--level auto needs --max-error, such as --max-error 0.3mm")
    if budget is not None and wanted not in (None, AUTO):
        raise click.UsageError(f"--max-error chooses the level itself: leave --level {wanted} out")
    if budget is None:
        at = wanted or usual
        return ChosenTree(cached_sphere_tree(mesh, TreeOptions(level=at), report), at, ())
    choice = coarsest_sphere_tree(mesh, budget, report)
    told = (
        f"level {choice.level} is the coarsest within {1e3 * budget:g} mm: {choice.tree.leaf_count:,} spheres, which "
        f"reach out of the mesh by {1e3 * choice.bound:.3f} mm at most"
    )
    return ChosenTree(choice.tree, choice.level, (told,))
