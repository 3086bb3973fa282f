"""Error of the spheres of each level, sampled and proved; it shares nothing with the builder but the mesh."""

import numpy as np

from hhsim.arrays import Codes, FloatArray, IntArray
from hhsim.kernels.cover.certify import certify_cover
from hhsim.kernels.cover.cover_error import exposed, union_distance
from hhsim.kernels.mesh.bvh import MeshBvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import face_areas, random_points
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers, ranges
from hhsim.trees.sphere_tree import LevelError, SphereTree
from hhsim.trees.surface_cover import ROUNDING

MESH_SAMPLES = 20_000
SPHERE_SAMPLES = 60_000
LEAST_SAMPLES_EACH = 24
"""Least number of samples on each sphere of a level."""
_PARTS = 8
"""Number of ranges that threads share out."""


def sample_mesh(mesh: Mesh, count: int, rng: np.random.Generator) -> FloatArray:
    """Sample points on a mesh [m], shape (count, 3), uniform by area."""
    area = face_areas(mesh.vertices, mesh.faces)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    return random_points(mesh.triangles[face], rng)


def sample_spheres(
    center: FloatArray, radius: FloatArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sample about `count` points on spheres, at least `LEAST_SAMPLES_EACH` on each.

    Returns points [m], shape (n, 3); the sphere of each, (n,); and the area that each stands for [m²], (n,).
    """
    area = 4.0 * np.pi * radius**2
    share = area / area.sum() if area.sum() > 0.0 else np.full(len(radius), 1.0 / len(radius))
    each = np.maximum(LEAST_SAMPLES_EACH, np.floor(count * share)).astype(np.int64)
    owner = np.repeat(np.arange(len(radius)), each)
    direction = rng.normal(size=(len(owner), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    points = center[owner] + radius[owner, None] * direction
    return np.ascontiguousarray(points), owner, (area / each)[owner]


def distance_outside(points: FloatArray, center: FloatArray, radius: FloatArray) -> FloatArray:
    """Return the distance [m] of points (n, 3) from the union of spheres, 0 in it, shape (n,)."""
    x, y, z = (np.ascontiguousarray(center[:, k]) for k in range(3))
    gap = np.empty(len(points))
    union_distance(points, x, y, z, np.ascontiguousarray(radius), gap)
    return gap


def protrusion_bound(bvh: MeshBvh, center: FloatArray, radius: FloatArray) -> float:
    """Return the proved bound of the protrusion [m]: the largest of (radius − depth of the centre inside the mesh)."""
    return float((radius + mesh_signed_distance(bvh, center)).max())


def prove_cover(
    mesh: Mesh, center: FloatArray, radius: FloatArray, workers: Workers | None = None
) -> tuple[IntArray, Codes]:
    """Prove that spheres, centres (n, 3) and radii (n,) [m], cover a mesh.

    Returns the faces without a proof, and the proof's codes as of `hhsim.kernels.cover.certify`; no codes if a face has
    none.
    """
    corner, extent = mesh.triangles.reshape(-1, 9), float(mesh.extent.max())
    size = max(float(np.abs(corner).max()), float(np.abs(center).max()))
    center, radius = np.ascontiguousarray(center, np.float64), np.ascontiguousarray(radius, np.float64)

    def prove(begin: int, end: int) -> tuple[IntArray, Codes]:
        unproved, capacity = np.empty(end - begin, np.int64), 2 * (end - begin) + 4 * len(radius)
        while True:
            proof = np.empty(capacity, np.int32)
            count, capacity = certify_cover(
                corner[begin:end], center, radius, 0.5 * ROUNDING * size, 1e-5 * extent, unproved, proof
            )
            if count or capacity <= len(proof):
                return unproved[:count] + begin, proof[:capacity].copy()

    parts = (workers or Workers()).each(prove, ranges(len(corner), _PARTS))
    unproved = np.concatenate([part for part, _ in parts])
    return unproved, np.concatenate([part for _, part in parts]) if not unproved.size else np.empty(0, np.int32)


def measure_levels(
    mesh: Mesh,
    bvh: MeshBvh,
    tree: SphereTree,
    seed: int = 0,
    progress: Progress = silent,
    workers: Workers | None = None,
) -> tuple[LevelError, ...]:
    """Measure every level of a tree, in the frame of the mesh: its cover, or else its nodes.

    The samples of a level do not depend on the other levels. `progress` is called with ("measure", levels done,
    levels); `workers` are threads to measure with, None the calling one.
    """
    workers = workers or Workers()
    surface = sample_mesh(mesh, MESH_SAMPLES, np.random.default_rng([seed, 0]))
    errors = []
    for level in range(tree.depth + 1):
        rng = np.random.default_rng([seed, 1 + level])
        errors.append(_measure(surface, bvh, tree, level, rng, workers))
        progress("measure", level + 1, tree.depth + 1)
    return tuple(errors)


def _measure(
    surface: FloatArray, bvh: MeshBvh, tree: SphereTree, level: int, rng: np.random.Generator, workers: Workers
) -> LevelError:
    center, radius = tree.spheres(level)
    x, y, z = (np.ascontiguousarray(center[:, k]) for k in range(3))
    gaps = workers.each(
        lambda begin, end: distance_outside(surface[begin:end], center, radius), ranges(len(surface), _PARTS)
    )
    gap = np.concatenate(gaps)
    points, owner, area = sample_spheres(center, radius, SPHERE_SAMPLES, rng)
    free = np.empty(len(points), np.bool_)
    workers.each(
        lambda begin, end: exposed(points[begin:end], owner[begin:end], x, y, z, radius, free[begin:end]),
        ranges(len(points), _PARTS),
    )
    points, area = points[free], area[free]
    parts = workers.each(lambda begin, end: mesh_signed_distance(bvh, points[begin:end]), ranges(len(points), _PARTS))
    height = np.concatenate(parts)
    height, area = height[height > 0.0], area[height > 0.0]
    mean, p99, total = 0.0, 0.0, float(area.sum())
    if total > 0.0:
        order = np.argsort(height, kind="stable")
        reached = np.cumsum(area[order])
        row = min(int(np.searchsorted(reached, 0.99 * reached[-1])), len(order) - 1)
        mean, p99 = float((height * area).sum() / total), float(height[order[row]])
    return LevelError(
        level=level,
        spheres=len(radius),
        gap_max=float(gap.max()),
        gap_mean=float(gap.mean()),
        gap_p99=float(np.quantile(gap, 0.99)),
        protrusion_max=float(height.max(initial=0.0)),
        protrusion_mean=mean,
        protrusion_p99=p99,
        bound=protrusion_bound(bvh, center, radius),
    )
