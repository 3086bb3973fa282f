"""A sphere tree around any triangles: it finds them, but does not stand for them.

Its spheres protrude by their radius. A hand that touches the triangles themselves does not feel that; the tree serves
to close a script's fingers on the object and as the broad phase.
"""

import math
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, MeshError
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import encloses
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import MOST_LEVEL, TreeOptions
from hhsim.trees.sphere_tree import SphereTree

BRANCHING = 8
MANY = 20_000
"""Number of triangles of a closed mesh above which the tree of its inside takes minutes to build."""
OPTIONS = {"around": "triangles"}
"""Options recorded in such a tree."""


def triangle_tree(mesh: Mesh, level: int) -> SphereTree:
    """Build a tree whose leaves, at most 8 ** level, cover every triangle of a mesh [m]."""
    center, radius = _around(_pieces(mesh.triangles, BRANCHING**level))
    groups = _grouped(center, BRANCHING**level)
    leaf, size = np.empty((len(groups), 3)), np.empty(len(groups))
    for i, members in enumerate(groups):
        low, high = center[members].min(axis=0), center[members].max(axis=0)
        leaf[i] = 0.5 * (low + high)
        size[i] = (np.linalg.norm(center[members] - leaf[i], axis=1) + radius[members]).max()
    tree = build_hierarchy(leaf, size, level, BRANCHING)
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


def _around(triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ball around each triangle: on its longest side where that is wide enough, else around its middle."""
    side = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    rows, first = np.arange(len(triangles)), side.argmax(axis=1)
    on_side = 0.5 * (triangles[rows, first] + triangles[rows, (first + 1) % 3])
    best, size = on_side, np.linalg.norm(triangles - on_side[:, None], axis=2).max(axis=1)
    middle = triangles.mean(axis=1)
    other = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    smaller = other < size
    return np.where(smaller[:, None], middle, best), np.where(smaller, other, size)


def _grouped(center: FloatArray, most: int) -> list[IntArray]:
    """Halve the places along their widest side until there are no more than `most` groups."""
    groups = [np.arange(len(center))]
    if len(center) <= most:
        return [np.array([i]) for i in range(len(center))]
    while len(groups) < most:
        halves = []
        for members in groups:
            if len(members) == 1:
                halves.append(members)
                continue
            place = center[members]
            axis = int(np.ptp(place, axis=0).argmax())
            order = members[np.argsort(place[:, axis], kind="stable")]
            halves += [order[: len(order) // 2], order[len(order) // 2 :]]
        groups = halves
    return groups
