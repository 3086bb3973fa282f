"""Builds a sphere tree that covers a mesh, with proof, and protrudes little."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim import canonical_frame, mesh_cover, sphere_tree, tree_error
from hhsim.errors import InputError, MeshError, OutputError
from hhsim.kernels import (
    ball_descent,
    cover,
    cover_refine,
    enclosing_ball,
    inner_ball,
    median_tree,
    mesh_bvh,
    micro_triangle,
    triangle,
)
from hhsim.kernels.jit import cache_root
from hhsim.kernels.mesh_bvh import build_mesh_bvh
from hhsim.mesh import Mesh
from hhsim.mesh_cover import build_cover
from hhsim.sphere_tree import SphereTree
from hhsim.tree_error import measure_levels, uncovered_faces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

MOST_LEVEL = 5

_SOURCES = (
    ball_descent,
    inner_ball,
    cover,
    cover_refine,
    enclosing_ball,
    median_tree,
    mesh_bvh,
    micro_triangle,
    triangle,
    canonical_frame,
    mesh_cover,
    sphere_tree,
    tree_error,
)
"""What a tree depends on besides mesh and options: a change in any of them makes cached trees stale."""


@dataclass(frozen=True)
class TreeOptions:
    """What to build.

    Attributes:
        level: Level of the leaves, 1 to 5; the root is level 0.
        branching: Most children of a node.
        leaves: Most leaves; None for branching ** level.
        seed: Of the samples that measure the errors; the spheres do not depend on it.
    """

    level: int = 4
    branching: int = 8
    leaves: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            InputError: A value out of its range.
        """
        if not 1 <= self.level <= MOST_LEVEL:
            raise InputError(f"tree level {self.level}, expected 1 to {MOST_LEVEL}")
        if not 2 <= self.branching <= 64:
            raise InputError(f"tree branching {self.branching}, expected 2 to 64")
        if self.leaves is not None and not 1 <= self.leaves <= self.branching**self.level:
            raise InputError(
                f"{self.leaves} leaves, expected 1 to {self.branching**self.level} "
                f"(branching {self.branching} at level {self.level})"
            )

    @property
    def leaf_limit(self) -> int:
        """Most leaves that the tree may have."""
        return self.branching**self.level if self.leaves is None else self.leaves


def build_sphere_tree(mesh: Mesh, options: TreeOptions | None = None, progress: Progress | None = None) -> SphereTree:
    """Build and measure a tree.

    Its leaves cover the mesh completely; every inner node encloses the leaves below it, so that each level covers it.

    Args:
        mesh: Watertight and wound outward.
        options: None for the defaults.
        progress: called with (stage, done, total), stages "cover", "tree" and "measure".

    Raises:
        MeshError: The mesh has no inside, or a face could not be covered.
    """
    options = TreeOptions() if options is None else options
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    bvh = build_mesh_bvh(vertices, faces)
    try:
        center, radius = build_cover(vertices, faces, options.leaf_limit, progress)
    except MeshError as error:
        raise MeshError(f"{mesh.name}: {error}") from error
    unproved = uncovered_faces(vertices, faces, center, radius)
    if unproved.size:
        raise MeshError(f"{mesh.name}: {unproved.size} faces could not be covered, first face {unproved[0]}")
    tree = build_hierarchy(center, radius, options.level, options.branching)
    if progress is not None:
        progress("tree", 1, 1)
    errors = measure_levels(vertices, faces, bvh, tree, options.seed, progress)
    return replace(tree, errors=errors, mesh_sha256=mesh.sha256, options=asdict(options))


def build_hierarchy(center: FloatArray, radius: FloatArray, level: int, branching: int) -> SphereTree:
    """Put balls as leaves under a tree: halved along principal axes, each inner node the least ball around its leaves.

    Args:
        center: [m], shape (n, 3), 1 ≤ n ≤ branching ** level.
        radius: [m], shape (n,).
        level: Level of the leaves.
        branching: Most children of a node.
    """
    center, radius = np.ascontiguousarray(center, np.float64), np.ascontiguousarray(radius, np.float64)
    nodes, balls, levels, parents = [np.arange(len(radius))], [], [0], [-1]
    ball = np.empty(4)
    first = 0
    for depth in range(level):
        capacity = branching ** (level - depth - 1)
        last = len(nodes)
        for node in range(first, last):
            enclosing_ball.enclosing_ball(center, radius, nodes[node], ball)
            balls.append(ball.copy())
            for group in _split(center, nodes[node], min(branching, len(nodes[node])), capacity):
                nodes.append(group)
                levels.append(depth + 1)
                parents.append(node)
        first = last
    leaves = np.concatenate(nodes[first:])
    return SphereTree(
        center=np.concatenate([np.array(balls)[:, :3], center[leaves]]),
        radius=np.concatenate([np.array(balls)[:, 3], radius[leaves]]),
        level=np.array(levels),
        parent=np.array(parents),
    )


def _split(center: FloatArray, members: IntArray, groups: int, capacity: int) -> list[IntArray]:
    """Halve along the principal axis until there are `groups` groups of nearly equal size, none above `capacity`."""
    if groups == 1:
        return [members]
    left = groups // 2
    count = int(
        np.clip(round(len(members) * left / groups), len(members) - (groups - left) * capacity, left * capacity)
    )
    points = center[members] - center[members].mean(axis=0)
    _, axes = np.linalg.eigh(points.T @ points)
    order = np.argsort(points @ axes[:, 2], kind="stable")
    return _split(center, members[order[:count]], left, capacity) + _split(
        center, members[order[count:]], groups - left, capacity
    )


def cached_sphere_tree(mesh: Mesh, options: TreeOptions | None = None, progress: Progress | None = None) -> SphereTree:
    """Return the tree of `build_sphere_tree`, built once for each content of mesh, options and builder.

    A damaged file in the cache is built again; a cache that cannot be written is done without.
    """
    options = TreeOptions() if options is None else options
    path = cache_path(mesh, options)
    if path.is_file():
        try:
            return SphereTree.load(path)
        except InputError:
            pass
    tree = build_sphere_tree(mesh, options, progress)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        tree.save(path)
    except (OSError, OutputError):
        pass
    return tree


def cache_path(mesh: Mesh, options: TreeOptions) -> Path:
    """Where the cache keeps the tree of a mesh."""
    digest = hashlib.sha256(mesh.sha256.encode())
    digest.update(json.dumps(asdict(options), sort_keys=True).encode())
    for module in _SOURCES:
        digest.update(Path(str(module.__file__)).read_bytes())
    digest.update(Path(__file__).read_bytes())
    return cache_root() / "trees" / f"{digest.hexdigest()[:32]}.h5"
