"""Builds a sphere tree that covers a mesh, with proof, and protrudes little."""

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError, MeshError, OutputError, UnknownNameError
from hhsim.kernels import enclosing_ball, triangle
from hhsim.kernels import kd_tree as median_tree
from hhsim.kernels import round_cone_distance as distance
from hhsim.kernels.cover import certify as cover_certificate
from hhsim.kernels.cover import greedy_cover as cover
from hhsim.kernels.cover import inscribed_sphere as inner_ball
from hhsim.kernels.cover import micro_triangle
from hhsim.kernels.cover import refine as cover_refine
from hhsim.kernels.cover import sampled_error as cover_error
from hhsim.kernels.cover import sphere_descent as ball_descent
from hhsim.kernels.jit import cache_root
from hhsim.kernels.mesh import bvh as mesh_bvh
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, mesh_signed_distance
from hhsim.mesh import canonical_frame
from hhsim.mesh.mesh import Mesh
from hhsim.system.thread_pool import Workers
from hhsim.trees import error as tree_error
from hhsim.trees import file as tree_file
from hhsim.trees import hierarchy as ball_hierarchy
from hhsim.trees import level_cover, sphere_tree
from hhsim.trees import sphere_count_search as fewest_balls
from hhsim.trees import surface_cover as mesh_cover
from hhsim.trees.error import measure_levels, prove_cover
from hhsim.trees.file import load_tree, save_tree
from hhsim.trees.hierarchy import cover_hierarchy
from hhsim.trees.level_cover import LevelCover
from hhsim.trees.sphere_count_search import find_fewest
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import cover_of, in_own_frame

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

MOST_LEVEL = 5
MOST_LEAVES = 262_144
"""Beyond this a build takes many minutes, and no tick would be in time."""

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
    distance,
    enclosing_ball,
    median_tree,
    mesh_bvh,
    micro_triangle,
    triangle,
    ball_hierarchy,
    canonical_frame,
    fewest_balls,
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
        level: Level of the leaves, 1 to 5; the root is level 0. None for as many as `leaves` or `max_error` need, 4 if
            neither is given.
        branching: Most children of a node.
        leaves: Most leaves; None for branching ** level.
        seed: Of the samples that measure the errors; the spheres do not depend on it.
        cover: "outer" for covers that contain the whole surface, "balanced" for the least error to both sides.
        max_error: Farthest that the leaves may be off the mesh, as proved [m]: as few leaves are taken as that needs,
            see `hhsim.trees.sphere_count_search.find_fewest`. None to take all.
    """

    level: int | None = None
    branching: int = 8
    leaves: int | None = None
    seed: int = 0
    cover: str = "outer"
    max_error: float | None = None

    def __post_init__(self) -> None:
        """Check the ranges, and put the level in that is meant by None.

        Raises:
            InputError: A value out of its range.
            UnknownNameError: No such cover.
        """
        if self.cover not in COVERS:
            raise UnknownNameError("cover", self.cover, COVERS)
        if self.max_error is not None and not (math.isfinite(self.max_error) and self.max_error > 0.0):
            raise InputError(f"the largest error is {self.max_error:g} m, expected a positive length")
        if not 2 <= self.branching <= 64:
            raise InputError(f"tree branching {self.branching}, expected 2 to 64")
        if self.level is None:
            usual = 4 if self.max_error is None else MOST_LEVEL
            level = usual if self.leaves is None else needed_level(self.leaves, self.branching)
            object.__setattr__(self, "level", min(level, MOST_LEVEL))
        if not 1 <= self.leaf_level <= MOST_LEVEL:
            raise InputError(f"tree level {self.level}, expected 1 to {MOST_LEVEL}")
        if self.leaves is not None and not 1 <= self.leaves <= self.branching**self.leaf_level:
            raise InputError(
                f"{self.leaves} leaves, expected 1 to {self.branching**self.leaf_level} "
                f"(branching {self.branching} at level {self.level})"
            )
        if self.leaf_limit > MOST_LEAVES and self.max_error is None:
            raise InputError(f"{self.leaf_limit:,} leaves, expected at most {MOST_LEAVES:,}")

    @property
    def leaf_level(self) -> int:
        """Level of the leaves, or the finest that they may have where `max_error` decides."""
        return 4 if self.level is None else self.level

    @property
    def leaf_limit(self) -> int:
        """Most leaves that the tree may have."""
        return self.branching**self.leaf_level if self.leaves is None else self.leaves


def needed_level(leaves: int, branching: int) -> int:
    """Coarsest level from 1 on that has room for so many leaves."""
    level = 1
    while branching**level < leaves:
        level += 1
    return level


def build_sphere_tree(
    mesh: Mesh, options: TreeOptions | None = None, progress: Progress | None = None, threads: int = 1
) -> SphereTree:
    """Build and measure a tree.

    Each level has a cover of its own that is proved to contain the whole surface, with
    branching ** level balls; the leaves are that of the last level, and every inner node encloses the leaves below it.

    Args:
        mesh: Watertight and wound outward.
        options: None for the defaults.
        progress: called with (stage, done, total), stages "cover", "tree" and "measure".
        threads: How many to build with, as far as they can be used: the same bytes with any number.

    Raises:
        InputError: No tree is within the largest error.
        MeshError: The mesh has no inside, or a face could not be covered.
    """
    options = TreeOptions() if options is None else options
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    bvh = build_mesh_bvh(vertices, faces)
    with Workers(threads) as workers:
        try:
            tree = _Builder(vertices, faces, bvh, options, progress, workers).build()
        except (MeshError, InputError) as error:
            raise type(error)(f"{mesh.name}: {error}") from error
        if progress is not None:
            progress("tree", 1, 1)
        errors = measure_levels(vertices, faces, bvh, tree, options.seed, progress, workers)
    return replace(tree, errors=errors, mesh_sha256=mesh.sha256, options=asdict(options))


class _Builder:
    """Builds a tree level by level."""

    def __init__(
        self,
        vertices: FloatArray,
        faces: IntArray,
        bvh: MeshBvh,
        options: TreeOptions,
        progress: Progress | None,
        workers: Workers,
    ) -> None:
        self.vertices, self.faces, self.bvh, self.options = vertices, faces, bvh, options
        self.progress, self.workers = progress, workers
        self.ready = in_own_frame(vertices, faces)
        self.done = self.total = 0

    def build(self) -> SphereTree:
        """Build the tree; its covers are timed."""
        options, leaves, last, last_seconds = self.options, self.options.leaf_limit, None, 0.0
        if options.max_error is not None:
            start = time.process_time()
            last = find_fewest(self.cover, options.max_error, min(leaves, MOST_LEAVES))
            last_seconds = time.process_time() - start
            leaves = len(last.radius)
        level = options.leaf_level if options.max_error is None else needed_level(leaves, options.branching)
        sizes = [min(options.branching**above, leaves) for above in range(level + 1)]
        self.done, self.total = 0, sum(sizes if last is None else sizes[:-1])
        covers: list[LevelCover] = []
        seconds: list[float] = []
        for at, size in enumerate(sizes):
            start = time.process_time()
            if at == level and last is not None:
                cover = last
            elif at > 0 and size == sizes[at - 1]:
                cover = covers[-1]
            else:
                cover = self.cover(size)
            tree, cover = cover_hierarchy(cover, at, options.branching)
            covers.append(cover)
            seconds.append(time.process_time() - start)
        seconds[-1] += last_seconds
        return replace(tree, covers=tuple(covers), cpu_seconds=tuple(seconds))

    def cover(self, size: int) -> LevelCover:
        """Build and prove a cover of at most `size` balls."""

        def report(stage: str, done: int, cycles: int) -> None:
            if self.progress is not None:
                total = max(self.total, self.done + size)
                self.progress(stage, cycles * self.done + done * size, cycles * total)

        center, radius = cover_of(self.ready, size, report, self.workers)
        self.done += size
        balanced = self.options.cover == "balanced"
        return proved_cover(
            self.vertices, self.faces, self.bvh, center, radius, balanced=balanced, workers=self.workers
        )


def proved_cover(
    vertices: FloatArray,
    faces: IntArray,
    bvh: MeshBvh,
    center: FloatArray,
    radius: FloatArray,
    *,
    balanced: bool = False,
    workers: Workers | None = None,
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
        workers: threads to prove with; None for the calling one.

    Raises:
        MeshError: A face cannot be proved.
    """
    unproved, proof = prove_cover(vertices, faces, center, radius, workers)
    if unproved.size:
        radius = radius + GROWTH * float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())
        unproved, proof = prove_cover(vertices, faces, center, radius, workers)
    if unproved.size:
        raise MeshError(f"{unproved.size} faces could not be covered, first face {unproved[0]}")
    cover = LevelCover(center, radius, -mesh_signed_distance(bvh, center), 0.0, proof)
    if not balanced:
        return cover
    half = 0.5 * max(cover.bound, 0.0)
    return replace(cover, radius=np.maximum(radius - half, 0.0), gap=half)


def proved_anew(tree: SphereTree, mesh: Mesh) -> SphereTree:
    """Return the tree of a mesh, such as a mirror image, with proofs that are made for this mesh.

    Raises:
        MeshError: A face cannot be proved.
    """
    covers = []
    for old in tree.covers:
        unproved, proof = prove_cover(mesh.vertices, mesh.faces, old.center, old.radius + old.gap)
        if unproved.size:
            raise MeshError(f"{mesh.name}: {unproved.size} faces are not covered, first face {unproved[0]}")
        covers.append(replace(old, proof=proof))
    return replace(tree, covers=tuple(covers), mesh_sha256=mesh.sha256)


def cached_sphere_tree(
    mesh: Mesh, options: TreeOptions | None = None, progress: Progress | None = None, threads: int = 1
) -> SphereTree:
    """Return the tree of `build_sphere_tree`, built once for each content of mesh, options and builder.

    A damaged file in the cache is built again; a cache that cannot be written is done without.
    """
    options = TreeOptions() if options is None else options
    path = cache_path(mesh, options)
    if path.is_file():
        try:
            return load_tree(path)
        except InputError:
            pass
    tree = build_sphere_tree(mesh, options, progress, threads)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_tree(tree, path)
    except (OSError, OutputError):
        pass
    return tree


def cache_path(mesh: Mesh, options: TreeOptions) -> Path:
    """Where the cache keeps the tree of a mesh."""
    digest = hashlib.sha256(mesh.sha256.encode())
    digest.update(json.dumps(asdict(options), sort_keys=True).encode())
    for source in (__file__, *(str(module.__file__) for module in _SOURCES)):
        digest.update(Path(source).read_bytes())
    return cache_root() / "trees" / f"{digest.hexdigest()[:32]}.h5"
