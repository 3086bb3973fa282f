"""Builder of a sphere tree that covers a mesh, with proof, and protrudes little."""

import time
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, MeshError
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers
from hhsim.trees.error import measure_levels, prove_cover
from hhsim.trees.hierarchy import cover_hierarchy
from hhsim.trees.level_cover import LevelCover
from hhsim.trees.options import MOST_LEAVES, TreeOptions, needed_level
from hhsim.trees.sphere_count_search import find_fewest
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import cover_of, in_own_frame

GROWTH = 1e-6
"""Growth of spheres, as a share of the mesh's longest extent, where rounding prevents a proof."""


def build_sphere_tree(
    mesh: Mesh, options: TreeOptions | None = None, progress: Progress = silent, threads: int = 1
) -> SphereTree:
    """Build and measure a tree.

    Each level has its own cover, proved to contain the whole surface, with branching ** level spheres; the leaves are
    that of the last level, and every inner node encloses the leaves below it.

    Args:
        mesh: Watertight and wound outward.
        options: None for the defaults.
        progress: Called with (stage, done, total), stages "cover", "tree" and "measure".
        threads: Number of threads; the bytes do not depend on it.

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
            tree = _Builder((vertices, faces, bvh), options, progress, workers).build()
        except (MeshError, InputError) as error:
            raise type(error)(f"{mesh.name}: {error}") from error
        progress("tree", 1, 1)
        errors = measure_levels(vertices, faces, bvh, tree, options.seed, progress, workers)
    return replace(tree, errors=errors, mesh_sha256=mesh.sha256, options=options.recorded())


class _Builder:
    def __init__(
        self, surface: tuple[FloatArray, IntArray, MeshBvh], options: TreeOptions, progress: Progress, workers: Workers
    ) -> None:
        self.surface, self.options, self.progress, self.workers = surface, options, progress, workers
        self.ready = in_own_frame(*surface[:2])
        self.done = self.total = 0

    def build(self) -> SphereTree:
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
            same = covers[-1] if at > 0 and size == sizes[at - 1] else None
            cover = (last if at == level else None) or same or self.cover(size)
            tree, cover = cover_hierarchy(cover, at, options.branching)
            covers.append(cover)
            seconds.append(time.process_time() - start)
        seconds[-1] += last_seconds
        return replace(tree, covers=tuple(covers), cpu_seconds=tuple(seconds))

    def cover(self, size: int) -> LevelCover:
        def report(stage: str, done: int, cycles: int) -> None:
            total = max(self.total, self.done + size)
            self.progress(stage, cycles * self.done + done * size, cycles * total)

        center, radius = cover_of(self.ready, size, report, self.workers)
        self.done += size
        balanced = self.options.cover == "balanced"
        return proved_cover(*self.surface, center, radius, balanced=balanced, workers=self.workers)


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
    """Prove that spheres cover a mesh; where rounding prevents it, with spheres larger by `GROWTH` of its extent.

    Args:
        vertices, faces: [m], shape (V, 3), and wound outward, shape (F, 3).
        center, radius: [m], shapes (n, 3) and (n,).
        balanced: Subtract half of the bound from all radii: the surface then lies at most so far out of the spheres,
            and they at most so far out of it.

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
    """Return the tree of a mesh, such as a mirror image, with new proofs; MeshError if a face cannot be proved."""
    covers = []
    for old in tree.covers:
        unproved, proof = prove_cover(mesh.vertices, mesh.faces, old.center, old.radius + old.gap)
        if unproved.size:
            raise MeshError(f"{mesh.name}: {unproved.size} faces are not covered, first face {unproved[0]}")
        covers.append(replace(old, proof=proof))
    return replace(tree, covers=tuple(covers), mesh_sha256=mesh.sha256)
