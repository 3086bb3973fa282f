"""Hierarchy over spheres as leaves, so that a walk can reject many at once."""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.enclosing_sphere import enclosing_sphere
from hhsim.kernels.jit import as_argument
from hhsim.reproducible import dot, matmul, principal_axes
from hhsim.trees.sphere_tree import LevelCover, SphereTree


def build_hierarchy(center: FloatArray, radius: FloatArray, level: int, branching: int) -> SphereTree:
    """Build a tree over leaves: halved along principal axes, each inner node the least sphere around its leaves.

    There are 1 ≤ n ≤ branching ** level leaves, centres (n, 3) and radii (n,) [m].
    """
    center, radius = np.ascontiguousarray(center, np.float64), np.ascontiguousarray(radius, np.float64)
    return _grow(center, radius, level, branching)[0]


def cover_hierarchy(cover: LevelCover, level: int, branching: int) -> tuple[SphereTree, LevelCover]:
    """Build a tree over the spheres of a cover, as `build_hierarchy`; also return the cover in the order of the leaves.

    The order of the given spheres makes no difference.
    """
    by_place = cover.reordered(np.lexsort((cover.radius, *cover.center.T)))
    tree, leaves = _grow(by_place.center, by_place.radius, level, branching)
    return tree, by_place.reordered(leaves)


def at_level(tree: SphereTree, level: int) -> SphereTree:
    """Return the tree whose leaves are the cover of a level: the same that is built for this level.

    The tree has to have covers, as each that is built has.
    """
    tree.require_level(level)
    if level == tree.depth:
        return tree
    branching, leaves = int(tree.options.get("branching", 8)), tree.options.get("leaves")
    own, cover = cover_hierarchy(tree.covers[level], level, branching)
    return replace(
        own,
        errors=tree.errors[: level + 1],
        mesh_sha256=tree.mesh_sha256,
        options=dict(tree.options)
        | {"level": level, "leaves": leaves if leaves and leaves < branching**level else None, "max_error": None},
        covers=(*tree.covers[:level], cover),
        cpu_seconds=tree.cpu_seconds[: level + 1],
    )


def _grow(center: FloatArray, radius: FloatArray, level: int, branching: int) -> tuple[SphereTree, IntArray]:
    """Tree, and the sphere of each leaf."""
    center, radius = as_argument(center), as_argument(radius)
    nodes, spheres, levels, parents = [np.arange(len(radius))], [np.empty((0, 4))], [0], [-1]
    sphere = np.empty(4)
    first = 0
    for depth in range(level):
        capacity = branching ** (level - depth - 1)
        last = len(nodes)
        for node in range(first, last):
            enclosing_sphere(center, radius, nodes[node], sphere)
            spheres.append(sphere.copy()[None])
            for group in halved_groups(center, nodes[node], min(branching, len(nodes[node])), capacity):
                nodes.append(group)
                levels.append(depth + 1)
                parents.append(node)
        first = last
    leaves = np.concatenate(nodes[first:])
    inner = np.concatenate(spheres)
    tree = SphereTree(
        center=np.concatenate([inner[:, :3], center[leaves]]),
        radius=np.concatenate([inner[:, 3], radius[leaves]]),
        level=np.array(levels),
        parent=np.array(parents),
    )
    return tree, leaves


def halved_groups(center: FloatArray, members: IntArray, groups: int, capacity: int) -> list[IntArray]:
    """Halve members along principal axes until there are `groups` of nearly equal size, none above `capacity`.

    Members are rows of `center`, places of shape (n, 3).
    """
    if groups == 1:
        return [members]
    left = groups // 2
    least, most = len(members) - (groups - left) * capacity, left * capacity
    count = min(max(round(len(members) * left / groups), least), most)
    points = center[members]
    points -= np.add.reduce(points) / len(points)
    rows = np.ascontiguousarray(points.T)
    spread = dot(rows[:, None], rows)
    order = matmul(points, principal_axes(spread)[1][:, 2]).argsort(kind="stable")
    return halved_groups(center, members[order[:count]], left, capacity) + halved_groups(
        center, members[order[count:]], groups - left, capacity
    )
