"""Depth image of spheres in orthographic projection, exact at each pixel."""

import math

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit


@jit
def nearest_spheres(center: Array, radius: Array, depth_out: Array, owner_out: Indices) -> None:
    """Find the sphere nearest to the viewer at each pixel.

    Spheres are given by column, row and coordinate towards the viewer, shape (n, 3), and radius, all in pixels.
    `depth_out` is the coordinate of the surface, minus infinity for none; `owner_out` the sphere or −1.
    """
    rows, columns = depth_out.shape
    depth_out[:] = -np.inf
    owner_out[:] = -1
    for sphere in range(radius.shape[0]):
        x, y, z, r = center[sphere, 0], center[sphere, 1], center[sphere, 2], radius[sphere]
        for row in range(max(0, math.ceil(y - r)), min(rows - 1, math.floor(y + r)) + 1):
            half2 = r * r - (row - y) * (row - y)
            half = math.sqrt(max(half2, 0.0))
            for column in range(max(0, math.ceil(x - half)), min(columns - 1, math.floor(x + half)) + 1):
                towards = z + math.sqrt(max(half2 - (column - x) * (column - x), 0.0))
                if towards > depth_out[row, column]:
                    depth_out[row, column] = towards
                    owner_out[row, column] = sphere
