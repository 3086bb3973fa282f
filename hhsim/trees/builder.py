"""Builder of a sphere tree that covers a mesh, with proof, and protrudes little."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, MeshError
from hhsim.kernels.mesh.bvh import MeshBvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh, most_protrusion
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.mesh.topology import Shell
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers
from hhsim.trees.error import measure_levels, protrusion_bound, prove_cover
from hhsim.trees.fewest_spheres import fewest_spheres
from hhsim.trees.hierarchy import cover_hierarchy
from hhsim.trees.options import FEW, MOST_LEAVES, TreeOptions, needed_level
from hhsim.trees.sphere_tree import LevelCover, SphereTree
from hhsim.trees.surface_cover import cover_of, in_own_frame

GROWTH = 1e-6
"""Growth of spheres, as a share of the mesh's longest extent, where rounding prevents a proof."""
NEAR = 0.95
"""The search ends when this share of the spheres, or more, was tried and is not enough."""
PROBES, PROBED = (0.93, 0.9), 1024
"""Further shares to try, up to so many spheres: small covers are cheap, and their errors vary more."""

_FIRST = 64
_MOST_STEP = 8.0
_USUAL_SLOPE = 2.0 / 3.0
_SLOPES = (0.4, 1.2)
_SPARE = 1.01
_HOPELESS = 2.0
_FEWER = 1.25
"""Spheres of the greedy cover for one of the search for few spheres, by far, with the same error."""
_SURE_FROM = 512


def build_sphere_tree(
    mesh: Mesh, options: TreeOptions | None = None, progress: Progress = silent, threads: int = 1
) -> SphereTree:
    """Build and measure a tree.

    Each level has its own cover, proved to contain the whole surface, with branching ** level spheres; the leaves are
    that of the last level, and every inner node encloses the leaves below it. Few leaves that are asked for by number
    are searched for, see `hhsim.trees.fewest_spheres`.

    Args:
        mesh: Watertight and wound outward, or any triangles as of `hhsim.mesh.own_triangles`.
        progress: Called with (stage, done, total), stages "cover", "tree" and "measure".
        threads: Number of threads; the bytes do not depend on it.

    Raises:
        InputError: No tree is within the largest error.
        MeshError: The mesh has no inside, or a face could not be covered.
    """
    options = TreeOptions() if options is None else options
    bvh = signed_bvh(mesh)
    with Workers(threads) as workers:
        try:
            tree = _Builder(mesh, bvh, options, progress, workers).build()
        except (MeshError, InputError) as error:
            raise type(error)(f"{mesh.name}: {error}") from error
        progress("tree", 1, 1)
        if options.seed is not None:
            tree = replace(tree, errors=measure_levels(mesh, bvh, tree, options.seed, progress, workers))
    return replace(tree, mesh_sha256=mesh.sha256, options=options.recorded())


class _Builder:
    def __init__(self, mesh: Mesh, bvh: MeshBvh, options: TreeOptions, progress: Progress, workers: Workers) -> None:
        self.mesh, self.bvh, self.options, self.progress, self.workers = mesh, bvh, options, progress, workers
        self.ready = in_own_frame(mesh)
        self.done = self.total = 0

    def build(self) -> SphereTree:
        options, leaves, last, last_seconds = self.options, self.options.leaf_limit, None, 0.0
        if options.max_error is not None:
            start = time.process_time()
            last = find_fewest(self.cover, options.max_error, min(leaves, MOST_LEAVES))
            if 1 < len(last.radius) <= _FEWER * FEW:
                last = find_fewest(lambda size: self.cover(size, searched=True), options.max_error, FEW, last)
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
            if at == level and options.searched:
                last = self.cover(size, searched=True)
            cover = (last if at == level else None) or same or self.cover(size)
            tree, cover = cover_hierarchy(cover, at, options.branching)
            covers.append(cover)
            seconds.append(time.process_time() - start)
        seconds[-1] += last_seconds
        return replace(tree, covers=tuple(covers), cpu_seconds=tuple(seconds))

    def cover(self, size: int, searched: bool = False) -> LevelCover:
        def report(stage: str, done: int, cycles: int) -> None:
            total = max(self.total, self.done + size)
            self.progress(stage, cycles * self.done + done * size, cycles * total)

        def spheres() -> tuple[FloatArray, FloatArray]:
            if searched:
                return fewest_spheres(self.ready, size, report, self.workers)
            return cover_of(self.ready, size, report, self.workers)

        mesh = self.mesh
        center, radius = spheres()
        if mesh.shell is None and protrusion_bound(self.bvh, center, radius) > most_protrusion(mesh):
            # Triangles as thin as rounding turn the sign of a distance beside them, but not that of a winding number.
            self.ready = in_own_frame(replace(mesh, shell=Shell(mesh.vertices, mesh.faces, np.empty((0, 3), np.int64))))
            center, radius = spheres()
        self.done += size
        return self.proved(center, radius)

    def proved(self, center: FloatArray, radius: FloatArray) -> LevelCover:
        """Prove that spheres cover the mesh; where rounding prevents it, with spheres larger by `GROWTH`.

        Of a balanced cover half of the bound is subtracted from all radii: the surface then lies at most so far out of
        the spheres, and they at most so far out of it. MeshError if a face cannot be proved, or if a sphere may
        stick out by more than the mesh is wide.
        """
        mesh = self.mesh
        unproved, proof = prove_cover(mesh, center, radius, self.workers)
        if unproved.size:
            radius = radius + GROWTH * float(mesh.extent.max())
            unproved, proof = prove_cover(mesh, center, radius, self.workers)
        if unproved.size:
            raise MeshError(f"{unproved.size} faces could not be covered, first face {unproved[0]}")
        cover = LevelCover(center, radius, -mesh_signed_distance(self.bvh, center), 0.0, proof)
        if cover.bound > most_protrusion(mesh):
            out = f"{1e3 * cover.bound:.4g} mm out of a mesh {1e3 * most_protrusion(mesh):.4g} mm across"
            raise MeshError(f"a sphere may stick {out}: no cover; is the mesh folded, or does it cross itself?")
        if self.options.cover != "balanced":
            return cover
        half = 0.5 * max(cover.bound, 0.0)
        return replace(cover, radius=np.maximum(radius - half, 0.0), gap=half)


def proved_anew(tree: SphereTree, mesh: Mesh) -> SphereTree:
    """Return the tree of a mesh, such as a mirror image, with new proofs; MeshError if a face cannot be proved."""
    covers = []
    for old in tree.covers:
        unproved, proof = prove_cover(mesh, old.center, old.radius + old.gap)
        if unproved.size:
            raise MeshError(f"{mesh.name}: {unproved.size} faces are not covered, first face {unproved[0]}")
        covers.append(replace(old, proof=proof))
    return replace(tree, covers=tuple(covers), mesh_sha256=mesh.sha256)


def find_fewest(
    build: Callable[[int], LevelCover], max_error: float, most: int, found: LevelCover | None = None
) -> LevelCover:
    """Find the cover with the fewest spheres, up to `most`, whose bound and gap are within an error [m].

    Where a cover of two spheres or more was `found` otherwise, it is that or one of fewer. The number is guessed by an
    error that falls with a power of it, until it is enclosed: one cover is within the error, and one with at least
    `NEAR` of its spheres, or one less, is not; up to `PROBED` spheres those of `PROBES` are not either, unless one was
    `found`. An error does not fall with every single sphere, so a number in between or below may do by luck.
    Raises InputError where `most` spheres are too few, or would be by far.
    """
    error: dict[int, float] = {}
    high, wanted, most_probed = most + 1, min(_FIRST, most), PROBED
    if found is not None:
        high, most_probed = len(found.radius), 0
        wanted = min(math.ceil(high / _FEWER), high - 1, most)
    while True:
        cover = build(wanted)
        error[wanted] = max(cover.bound, cover.gap)
        if error[wanted] <= max_error:
            high, found = wanted, cover
        low = max([count for count in error if count < high and error[count] > max_error], default=0)
        if found is not None and (high - low <= 1 or low >= min(NEAR * high, most)):
            probes = [count for share in PROBES if (count := math.floor(share * high)) > 0 and count not in error]
            if high > most_probed or not probes:
                return found
            wanted = probes[0]
            continue
        guess = _guess(error, max_error)
        if found is None and (low >= most or (low >= min(_SURE_FROM, most) and guess > _HOPELESS * most)):
            tried = f"{low:,} are off by up to {1e3 * error[low]:.3g} mm, and about {guess:.2g} would be needed"
            raise InputError(f"no cover of up to {most:,} spheres is within {1e3 * max_error:g} mm: {tried}")
        if found is None:
            wanted = max(low + 1, min(math.ceil(min(_SPARE * guess, _MOST_STEP * low)), most))
        else:
            # Just below what is sure to be enough, once the guess is there: if that is not, the search ends.
            guess = min(_SPARE * guess, NEAR * high)
            if len(error) % 6 == 0:
                guess = math.sqrt(max(low, 1) * high)
            wanted = min(max(math.ceil(guess), low + 1), high - 1)


def _guess(error: dict[int, float], max_error: float) -> float:
    """Number of spheres that has an error, by the power law through the two tries nearest to it."""
    near = sorted(error, key=lambda count: (abs(math.log(max(error[count], 1e-300) / max_error)), count))[:2]
    slope = _USUAL_SLOPE
    if len(near) == 2 and error[near[0]] != error[near[1]]:
        change = math.log(max(error[near[0]], 1e-300) / max(error[near[1]], 1e-300))
        slope = min(max(change / math.log(near[1] / near[0]), _SLOPES[0]), _SLOPES[1])
    return float(near[0] * min((error[near[0]] / max_error) ** (1.0 / slope), 1e12))
