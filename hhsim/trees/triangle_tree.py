"""A sphere tree around any triangles: it finds them, but does not stand for them.

Its spheres protrude by their radius. A hand that touches the triangles themselves does not feel that; the tree serves
to close a script's fingers on the object and as the broad phase.
"""

import math
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, MeshError
from hhsim.kernels.enclosing_sphere import enclosing_sphere
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import encloses
from hhsim.trees.hierarchy import build_hierarchy, halved_groups
from hhsim.trees.options import MOST_LEVEL, TreeOptions
from hhsim.trees.sphere_tree import SphereTree

BRANCHING = 8
MANY = 20_000
"""Number of triangles of a closed mesh above which the tree of its inside takes minutes to build."""
OPTIONS = {"around": "triangles"}
"""Options recorded in such a tree."""


def triangle_tree(mesh: Mesh, level: int) -> SphereTree:
    """Build a tree whose leaves, at most 8 ** level, cover every triangle of a mesh [m]."""
    pieces = _pieces(mesh.triangles, BRANCHING**level)
    count = min(len(pieces), BRANCHING**level)
    corners, sizes = np.ascontiguousarray(pieces.reshape(-1, 3)), np.zeros(3 * len(pieces))
    leaves = np.empty((count, 4))
    groups = halved_groups(pieces.mean(axis=1), np.arange(len(pieces)), count, -(-len(pieces) // count))
    for leaf, members in zip(leaves, groups, strict=True):
        enclosing_sphere(corners, sizes, (3 * members[:, None] + np.arange(3)).ravel(), leaf)
    tree = build_hierarchy(leaves[:, :3], leaves[:, 3], level, BRANCHING)
    return replace(tree, mesh_sha256=mesh.sha256, options={**OPTIONS, "level": level})


def tree_of_any(mesh: Mesh, level: int, progress: Progress = silent) -> SphereTree:
    """Return the usual tree of a mesh that encloses something; else, or for very many faces, a `triangle_tree`."""
    if len(mesh.faces) <= MANY and encloses(mesh):
        try:
            return cached_sphere_tree(mesh, TreeOptions(level=level), progress)
        except MeshError:
            # Closed, but with parts that no sphere tree has an inside of: overlaps wound against each other, slivers.
            pass
    return triangle_tree(mesh, level)


def chosen_tree(
    mesh: Mesh, level: int, max_error: float | None = None, solid: bool | None = None, progress: Progress = silent
) -> tuple[SphereTree, tuple[str, ...]]:
    """Return the tree of a level, or the coarsest within an error [m], and notes on the choice.

    If `solid` is False, a tree of a level only finds the triangles. Raises MeshError as `cached_sphere_tree`.
    """
    if max_error is None:
        if solid is False:
            return tree_of_any(mesh, level, progress), ()
        return cached_sphere_tree(mesh, TreeOptions(level=level), progress), ()
    tree = coarsest_sphere_tree(mesh, max_error, progress)
    note = (
        f"level {tree.depth} is the coarsest within {1e3 * max_error:g} mm: {tree.leaf_count:,} spheres, "
        f"which reach out of the mesh by {1e3 * tree.errors[-1].bound:.3f} mm at most"
    )
    return tree, (note,)


def coarsest_sphere_tree(mesh: Mesh, max_error: float, progress: Progress = silent) -> SphereTree:
    """Build levels from the coarsest on; return the first that is proved to protrude by no more than `max_error` [m].

    Raises InputError if `max_error` is no length, or no level meets it; MeshError as
    `hhsim.trees.builder.build_sphere_tree`.
    """
    if not (math.isfinite(max_error) and max_error > 0.0):
        raise InputError(f"the largest error is {max_error:g} m: it must be positive and finite")
    bound = math.inf
    for level in range(1, MOST_LEVEL + 1):
        tree = cached_sphere_tree(mesh, TreeOptions(level=level), progress)
        bound = tree.errors[-1].bound
        if bound <= max_error:
            return tree
    finest = f"level {MOST_LEVEL}, the finest, protrudes by up to {1e3 * bound:.3g} mm"
    raise InputError(f"{mesh.name}: no level is within {1e3 * max_error:g} mm; {finest}")


def _pieces(triangles: FloatArray, most: int) -> FloatArray:
    """Halve the longest sides of the largest triangles until there are about as many as leaves, shape (N, 3, 3)."""
    pieces = triangles
    while len(pieces) < most:
        side = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
        longest = side.max(axis=1)
        # All that are at least half as long as the longest one, as long as there is room.
        order = np.argsort(-longest, kind="stable")[: most - len(pieces)]
        split = order[longest[order] > 0.5 * longest[order[0]]]
        first = side[split].argmax(axis=1)
        rows = np.arange(len(split))
        a, b, c = (pieces[split][rows, (first + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        kept = np.delete(pieces, split, axis=0)
        pieces = np.concatenate([kept, np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return pieces
