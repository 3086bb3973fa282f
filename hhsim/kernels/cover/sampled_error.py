"""Sampled gap and protrusion of a union of spheres, by brute force and independent of the tree builder."""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_inline

Flags = NDArray[np.bool_]

_CHUNK = 64


@jit
def _nearest_surface(px: float, py: float, pz: float, x: Array, y: Array, z: Array, radius: Array) -> float:
    """Compute the least signed distance [m] from p to the spheres."""
    least = np.inf
    for j in range(radius.shape[0]):
        dx, dy, dz = x[j] - px, y[j] - py, z[j] - pz
        least = min(least, math.sqrt(dx * dx + dy * dy + dz * dz) - radius[j])
    return least


@jit_inline
def _chunk(x: Array, y: Array, z: Array, radius: Array, begin: int) -> tuple[Array, Array, Array, Array]:
    end = begin + _CHUNK
    return x[begin:end], y[begin:end], z[begin:end], radius[begin:end]


@jit
def union_distance(points: Array, x: Array, y: Array, z: Array, radius: Array, distance_out: Array) -> None:
    """Compute the distance [m] from points, shape (n, 3), to a union of spheres: 0 inside, shape (n,)."""
    spheres = radius.shape[0]
    latest = as_int64(0)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        # Neighbouring samples tend to lie in the same spheres.
        least = _nearest_surface(px, py, pz, *_chunk(x, y, z, radius, latest))
        begin = as_int64(0)
        while begin < spheres and least > 0.0:
            least = min(least, _nearest_surface(px, py, pz, *_chunk(x, y, z, radius, begin)))
            if least <= 0.0:
                latest = begin
            begin += _CHUNK
        distance_out[i] = max(least, 0.0)


@jit
def exposed(points: Array, owner: Indices, x: Array, y: Array, z: Array, radius: Array, exposed_out: Flags) -> None:
    """Mark the points [m], shape (n, 3), each on the surface of its sphere `owner`, that lie in no other sphere."""
    spheres = radius.shape[0]
    latest = -1
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        exposed_out[i] = True
        for k in range(-1, spheres):
            j = latest if k < 0 else k
            if j < 0 or j == owner[i]:
                continue
            dx, dy, dz = x[j] - px, y[j] - py, z[j] - pz
            if dx * dx + dy * dy + dz * dz < radius[j] * radius[j]:
                exposed_out[i] = False
                latest = j
                break
