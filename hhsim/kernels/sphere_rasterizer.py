"""Spheres as a viewer far away sees them, pixel by pixel and exact."""

import math

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit


@jit
def nearest_spheres(center: Array, radius: Array, depth_out: Array, owner_out: Indices) -> None:
    """Find the sphere that is nearest to the viewer at each pixel.

    Args:
        center: Column, row and coordinate towards the viewer of each sphere, all in pixels, shape (n, 3).
        radius: [pixels], shape (n,).
        depth_out: Coordinate of the sphere's surface towards the viewer [pixels], minus infinity where there is none,
            shape (rows, columns).
        owner_out: The sphere or −1, shape (rows, columns).
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
