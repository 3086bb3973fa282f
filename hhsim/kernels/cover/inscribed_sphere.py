"""Spheres inside a mesh: depth of a centre, largest sphere that touches a point, sphere to cover a micro-triangle."""

import math

import numpy as np

from hhsim.kernels.cover.micro_triangle import MicroTriangles
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh, closest_on_mesh, outside
from hhsim.kernels.mesh.winding_number import winding_at

_SHRINKS = 40
_STRETCHES = 8


UNKNOWN = 0


@jit
def same_side(depth: float, moved2: float) -> int:
    """Return on which side of the surface a point still is that moved by so much [m²] from a depth [m].

    1 is inside, -1 outside, and `UNKNOWN` may be either.
    """
    if not moved2 < depth * depth * (1.0 - 1e-9):
        return UNKNOWN
    return 1 if depth > 0.0 else -1


@jit
def far_corner2(corner: Array, i: int, x: float, y: float, z: float) -> float:
    """Compute the squared distance [m²] of (x, y, z) from the farthest corner of micro-triangle i."""
    farthest2 = 0.0
    for v in range(0, 9, 3):
        dx, dy, dz = corner[i, v] - x, corner[i, v + 1] - y, corner[i, v + 2] - z
        farthest2 = max(farthest2, dx * dx + dy * dy + dz * dz)
    return farthest2


@jit
def depth_at(
    bvh: MeshBvh,
    x: float,
    y: float,
    z: float,
    limit2: float,
    stack: Indices,
    stack_distance2: Array,
    side: int = UNKNOWN,
) -> tuple[float, float, float, float]:
    """Compute the depth [m], negative outside, −inf beyond the limit, and the closest surface point.

    Where the BVH has moments of the winding number, the sign is that of `side`, and its own if that is `UNKNOWN`.
    """
    triangle, qx, qy, qz, d2, feature = closest_on_mesh(bvh, x, y, z, limit2, stack, stack_distance2)
    if triangle < 0:
        return -np.inf, qx, qy, qz
    depth = math.sqrt(d2)
    if bvh.moments.radius.shape[0] == 0:
        is_outside = outside(bvh, triangle, feature, x - qx, y - qy, z - qz)
    elif side != UNKNOWN:
        is_outside = side < 0
    else:
        box = bvh.bound[0]
        in_box = box[0] <= x <= box[3] and box[1] <= y <= box[4] and box[2] <= z <= box[5]
        is_outside = not (in_box and winding_at(bvh, bvh.moments, x, y, z, stack) > 0.5)
    if is_outside:
        depth = -depth
    return depth, qx, qy, qz


@jit_allocating
def depths_at(bvh: MeshBvh, points: Array, depth_out: Array) -> None:
    """Compute the depths [m], negative outside, of points [m], shape (n, 3)."""
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    for i in range(points.shape[0]):
        depth, _, _, _ = depth_at(bvh, points[i, 0], points[i, 1], points[i, 2], np.inf, stack, stack_distance2)
        depth_out[i] = depth


@jit
def inscribed_sphere(
    bvh: MeshBvh,
    px: float,
    py: float,
    pz: float,
    nx: float,
    ny: float,
    nz: float,
    radius: float,
    stack: Indices,
    stack_distance2: Array,
) -> tuple[float, float, float, float]:
    """Compute the radius [m] of the largest inner sphere that touches the surface at p with outward normal n.

    It shrinks from `radius` [m] until no surface point lies inside (Ma, Bae and Choi, 2012). Returned with the surface
    point that stopped it.
    """
    sx, sy, sz = px, py, pz
    for _ in range(_SHRINKS):
        cx, cy, cz = px - radius * nx, py - radius * ny, pz - radius * nz
        limit = radius * (1.0 - 1e-9)
        triangle, qx, qy, qz, _, _ = closest_on_mesh(bvh, cx, cy, cz, limit * limit, stack, stack_distance2)
        if triangle < 0:
            break
        dx, dy, dz = px - qx, py - qy, pz - qz
        along = dx * nx + dy * ny + dz * nz
        if not along > 0.0:
            break
        smaller = 0.5 * (dx * dx + dy * dy + dz * dz) / along
        if not smaller < radius:
            break
        radius = smaller
        sx, sy, sz = qx, qy, qz
    return radius, sx, sy, sz


@jit
def place_sphere(
    bvh: MeshBvh,
    micro: MicroTriangles,
    i: int,
    largest: float,
    allowed: float,
    stack: Indices,
    stack_distance2: Array,
    center_out: Array,
) -> float:
    """Place a sphere for micro-triangle i; return its depth [m].

    It starts as the largest inner sphere that touches there, of at most `largest` [m], and then goes deeper along the
    medial axis, away from both points that it touches, while its cost for i stays within `allowed` [m]: a deeper sphere
    covers more around i.
    """
    t = micro.corner[i]
    px, py, pz = (t[0] + t[3] + t[6]) / 3.0, (t[1] + t[4] + t[7]) / 3.0, (t[2] + t[5] + t[8]) / 3.0
    nx, ny, nz = micro.normal[i, 0], micro.normal[i, 1], micro.normal[i, 2]
    radius, sx, sy, sz = inscribed_sphere(bvh, px, py, pz, nx, ny, nz, largest, stack, stack_distance2)
    x, y, z = px - radius * nx, py - radius * ny, pz - radius * nz
    depth, _, _, _ = depth_at(bvh, x, y, z, np.inf, stack, stack_distance2)

    ux, uy, uz = (x - sx) / radius - nx, (y - sy) / radius - ny, (z - sz) / radius - nz
    norm = math.sqrt(ux * ux + uy * uy + uz * uz)
    if norm > 1e-6:
        ux, uy, uz = ux / norm, uy / norm, uz / norm
        x0, y0, z0 = x, y, z
        good, step = 0.0, max(depth, allowed)
        for _ in range(_STRETCHES):
            length = good + step
            tx, ty, tz = x0 + length * ux, y0 + length * uy, z0 + length * uz
            side = same_side(depth, (tx - x) ** 2 + (ty - y) ** 2 + (tz - z) ** 2)
            deeper, _, _, _ = depth_at(bvh, tx, ty, tz, np.inf, stack, stack_distance2, side)
            if deeper > depth and math.sqrt(far_corner2(micro.corner, i, tx, ty, tz)) - deeper <= allowed:
                good, depth = length, deeper
                x, y, z = tx, ty, tz
                step *= 1.5
            else:
                step *= 0.4
    center_out[0], center_out[1], center_out[2] = x, y, z
    return depth
