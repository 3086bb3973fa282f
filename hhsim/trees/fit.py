"""Figures of how spheres fit a mesh, by the definitions that robot planners use.

Coverage, protrusion, surface gap and volume ratio are those of cuRobo: coverage is of the inside,
protrusion of the surface of each sphere by itself, and the volume of spheres that overlap counts twice.
"""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.kernels.mesh.bvh import MeshBvh, fast_winding_numbers, mesh_signed_distance
from hhsim.mesh.mesh import LEAST_FILLED, Mesh, most_protrusion
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.trees.error import MESH_SAMPLES, distance_outside, protrusion_bound, sample_mesh

INSIDE_SAMPLES = 10_000
MOST_TRIED = 400_000
"""Most points of the box around a mesh that are tried for being inside."""
SPHERE_SAMPLES_EACH, LEAST_EACH, MOST_SAMPLES = 200, 24, 200_000
"""Points on each sphere: so many, or as few as the least where there are very many spheres."""


@dataclass(frozen=True)
class Fit:
    """Figures of spheres and a mesh; lengths [m], shares [-]."""

    spheres: int  # number of spheres
    coverage: float | None  # share of the inside that lies in a sphere; None for a mesh without an inside
    surface_coverage: float  # share of the surface that lies in a sphere
    surface_gap_mean: float  # distance of the surface outside of the spheres
    surface_gap_p95: float
    surface_gap_max: float
    protrusion: float  # share of the spheres' surfaces, each by itself, that lies outside the mesh
    protrusion_mean: float  # distance of that part from the mesh
    protrusion_p95: float
    protrusion_max: float
    volume_ratio: float | None  # volume of all spheres to that of the mesh, or of its box where it has none
    bound: float  # proved upper bound of the protrusion: the largest of (radius − depth of the centre)


WIDE = 0.6
"""Protrusion, as a share of the most that there is, from which on spheres are in doubt: one around a box has half."""


OFF_PLACE = 0.1
"""Mean distance of a mesh from spheres, as a share of its longest extent, from which on they are in doubt."""


def doubt(mesh: Mesh, protrusion: float, gap: float) -> str:
    """Return why spheres may be of another unit or mesh that stick out so far [m], and are so far off in the mean [m].

    That is "" if they are not in doubt. Raises InputError where they stick out by more than the mesh is wide.
    """
    if gap > OFF_PLACE * float(mesh.extent.max()):
        off = f"its spheres are {1e3 * gap:.4g} mm off {mesh.name} in the mean"
        return f"{off}: are they in another unit or frame, or of another mesh?"
    if protrusion <= WIDE * most_protrusion(mesh):
        return ""
    out, across = (f"{1e3 * length:.4g} mm" for length in (protrusion, most_protrusion(mesh)))
    sizes = f"its spheres stick out by {out}, and {mesh.name} is {across} across"
    sentence = f"{sizes}: are they in another unit, or of another mesh?"
    if protrusion > most_protrusion(mesh):
        raise InputError(sentence)
    return sentence


def measure_fit(mesh: Mesh, center: FloatArray, radius: FloatArray, seed: int = 0) -> Fit:
    """Measure spheres, centres (n, 3) and radii (n,) [m], against a mesh with 20,000 points on it and 10,000 in it."""
    bvh = signed_bvh(mesh)
    surface = sample_mesh(mesh, MESH_SAMPLES, np.random.default_rng([seed, 0]))
    gap = distance_outside(surface, center, radius)
    inside = _inside_points(mesh, bvh, np.random.default_rng([seed, 1]))
    # As many points on each sphere.
    each = min(SPHERE_SAMPLES_EACH, max(LEAST_EACH, MOST_SAMPLES // len(radius)))
    direction = np.random.default_rng([seed, 2]).normal(size=(len(radius), each, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    points = center[:, None] + radius[:, None, None] * direction
    height = mesh_signed_distance(bvh, points.reshape(-1, 3))
    out = height[height > 0.0]
    box = float(np.prod(mesh.extent))
    filled = mesh.volume
    if mesh.shell is not None:
        filled = Mesh(mesh.shell.vertices, mesh.shell.faces).volume if len(mesh.shell.faces) else 0.0
    longest = float(mesh.extent.max())
    volume = filled if filled > LEAST_FILLED * longest * longest * longest else box
    return Fit(
        spheres=len(radius),
        coverage=float((distance_outside(inside, center, radius) == 0.0).mean()) if len(inside) else None,
        surface_coverage=float((gap <= 1e-9 * longest).mean()),
        surface_gap_mean=float(gap.mean()),
        surface_gap_p95=float(np.quantile(gap, 0.95)),
        surface_gap_max=float(gap.max()),
        protrusion=len(out) / len(height),
        protrusion_mean=float(out.mean()) if len(out) else 0.0,
        protrusion_p95=float(np.quantile(out, 0.95)) if len(out) else 0.0,
        protrusion_max=float(out.max(initial=0.0)),
        volume_ratio=float(4.0 / 3.0 * np.pi * (radius * radius * radius).sum() / volume) if volume > 0.0 else None,
        bound=protrusion_bound(bvh, center, radius),
    )


def _inside_points(mesh: Mesh, bvh: MeshBvh, rng: np.random.Generator) -> FloatArray:
    found: list[FloatArray] = []
    for _ in range(MOST_TRIED // (2 * INSIDE_SAMPLES)):
        points = mesh.bounds[0] + rng.random((2 * INSIDE_SAMPLES, 3)) * mesh.extent
        by_winding = len(bvh.moments.radius) > 0
        inside = fast_winding_numbers(bvh, points) > 0.5 if by_winding else mesh_signed_distance(bvh, points) < 0.0
        found.append(points[inside])
        if sum(map(len, found)) >= INSIDE_SAMPLES or not sum(map(len, found)):
            break
    return np.ascontiguousarray(np.concatenate(found)[:INSIDE_SAMPLES])
