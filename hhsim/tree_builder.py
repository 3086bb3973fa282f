"""Builds a sphere tree that covers a mesh, with proof, and protrudes little."""

import hashlib
import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim import ball_hierarchy, canonical_frame, level_cover, mesh_cover, sphere_tree, tree_error, tree_file
from hhsim.ball_hierarchy import cover_hierarchy
from hhsim.errors import InputError, MeshError, OutputError, UnknownNameError
from hhsim.kernels import (
    ball_descent,
    cover,
    cover_certificate,
    cover_error,
    cover_refine,
    enclosing_ball,
    inner_ball,
    median_tree,
    mesh_bvh,
    micro_triangle,
    triangle,
)
from hhsim.kernels.jit import cache_root
from hhsim.kernels.mesh_bvh import MeshBvh, build_mesh_bvh, mesh_signed_distance
from hhsim.level_cover import LevelCover
from hhsim.mesh import Mesh
from hhsim.mesh_cover import build_cover
from hhsim.sphere_tree import SphereTree
from hhsim.tree_error import measure_levels, prove_cover
from hhsim.tree_methods import METHODS, Progress

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_LEVEL = 5

COVERS = ("outer", "balanced")
"""What the spheres are to be, see `TreeOptions`."""

GROWTH = 1e-6
"""What balls are grown by, as a share of the mesh's longest extent, where rounding stands in the way of a proof."""

_SOURCES = (
    ball_descent,
    inner_ball,
    cover,
    cover_certificate,
    cover_error,
    cover_refine,
    enclosing_ball,
    median_tree,
    mesh_bvh,
    micro_triangle,
    triangle,
    ball_hierarchy,
    canonical_frame,
    level_cover,
    mesh_cover,
    sphere_tree,
    tree_error,
    tree_file,
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
        method: Way to build it, one of `hhsim.tree_methods.METHODS`.
        cover: "outer" for covers that contain the whole surface, "balanced" for the least error to both sides.
    """

    level: int = 4
    branching: int = 8
    leaves: int | None = None
    seed: int = 0
    method: str = "certified"
    cover: str = "outer"

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            InputError: A value out of its range, or one that the method cannot do.
            UnknownNameError: No such method or cover.
        """
        if self.method not in METHODS:
            raise UnknownNameError("tree method", self.method, METHODS)
        if self.cover not in COVERS:
            raise UnknownNameError("cover", self.cover, COVERS)
        if self.cover != "outer" and METHODS[self.method].grow is not None:
            raise InputError(f"a {self.cover} cover of method {self.method}: only certified covers can be balanced")
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

    By the default method each level has a cover of its own that is proved to contain the whole surface, with
    branching ** level balls; the leaves are that of the last level, and every inner node encloses the leaves below it.

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
    grow = METHODS[options.method].grow
    try:
        if grow is None:
            tree = _certified(vertices, faces, bvh, options, progress)
        else:
            tree = grow(mesh, options.level, options.branching, options.leaves, progress)
    except MeshError as error:
        raise MeshError(f"{mesh.name}: {error}") from error
    if progress is not None:
        progress("tree", 1, 1)
    errors = measure_levels(vertices, faces, bvh, tree, options.seed, progress)
    return replace(tree, errors=errors, mesh_sha256=mesh.sha256, options=asdict(options))


def _certified(
    vertices: FloatArray, faces: IntArray, bvh: MeshBvh, options: TreeOptions, progress: Progress | None
) -> SphereTree:
    sizes = [min(options.branching**level, options.leaf_limit) for level in range(options.level + 1)]
    covers: list[LevelCover] = []
    seconds: list[float] = []
    for level, size in enumerate(sizes):

        def report(stage: str, done: int, total: int, before: int = sum(sizes[:level]), here: int = size) -> None:
            if progress is not None:
                progress(stage, total * before + done * here, total * sum(sizes))

        start = time.process_time()
        if level > 0 and size == sizes[level - 1]:
            cover = covers[-1]
        else:
            center, radius = build_cover(vertices, faces, size, report)
            cover = proved_cover(vertices, faces, bvh, center, radius, balanced=options.cover == "balanced")
        tree, cover = cover_hierarchy(cover, level, options.branching)
        covers.append(cover)
        seconds.append(time.process_time() - start)
    return replace(tree, covers=tuple(covers), cpu_seconds=tuple(seconds))


def proved_cover(
    vertices: FloatArray,
    faces: IntArray,
    bvh: MeshBvh,
    center: FloatArray,
    radius: FloatArray,
    *,
    balanced: bool = False,
) -> LevelCover:
    """Prove that balls cover a mesh; where rounding stands in the way, with balls larger by `GROWTH` of its extent.

    Args:
        vertices: [m], shape (V, 3).
        faces: wound outward, shape (F, 3).
        bvh: over the mesh.
        center: [m], shape (n, 3).
        radius: [m], shape (n,).
        balanced: Take half of the bound off all radii, so that the balls miss the surface by as little outside as
            inside: it then lies at most so far out of them, and they at most so far out of it.

    Raises:
        MeshError: A face cannot be proved.
    """
    unproved, proof = prove_cover(vertices, faces, center, radius)
    if unproved.size:
        radius = radius + GROWTH * float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())
        unproved, proof = prove_cover(vertices, faces, center, radius)
    if unproved.size:
        raise MeshError(f"{unproved.size} faces could not be covered, first face {unproved[0]}")
    cover = LevelCover(center, radius, -mesh_signed_distance(bvh, center), 0.0, proof)
    if not balanced:
        return cover
    half = 0.5 * max(cover.bound, 0.0)
    return replace(cover, radius=np.maximum(radius - half, 0.0), gap=half)


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
    for source in (__file__, *(str(module.__file__) for module in _SOURCES + METHODS[options.method].sources)):
        digest.update(Path(source).read_bytes())
    return cache_root() / "trees" / f"{digest.hexdigest()[:32]}.h5"
