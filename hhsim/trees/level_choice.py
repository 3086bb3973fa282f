"""The coarsest sphere tree that is true enough: what no scene needs is not built."""

import math
from dataclasses import dataclass

from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import MOST_LEVEL, TreeOptions
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True)
class TreeChoice:
    """A tree, its level and how far its leaves can protrude from the mesh [m], as proved."""

    tree: SphereTree
    level: int
    bound: float


def coarsest_sphere_tree(mesh: Mesh, max_error: float, progress: Progress = silent) -> TreeChoice:
    """Build levels from the coarsest on until one is proved to protrude by no more than an error budget.

    Args:
        mesh: Watertight and wound outward.
        max_error: Farthest that a leaf may reach out of the mesh [m].
        progress: As for `build_sphere_tree`.

    Raises:
        InputError: The budget is no length, or no level meets it.
        MeshError: As `build_sphere_tree`.
    """
    if not (math.isfinite(max_error) and max_error > 0.0):
        raise InputError(f"the largest error is {max_error:g} m: it must be positive and finite")
    bound = math.inf
    for level in range(1, MOST_LEVEL + 1):
        tree = cached_sphere_tree(mesh, TreeOptions(level=level), progress)
        bound = tree.errors[-1].bound
        if bound <= max_error:
            return TreeChoice(tree, level, bound)
    raise InputError(
        f"{mesh.name}: no level is within {1e3 * max_error:g} mm; level {MOST_LEVEL}, the finest, protrudes by up to "
        f"{1e3 * bound:.3g} mm"
    )
