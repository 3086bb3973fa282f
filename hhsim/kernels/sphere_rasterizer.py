"""Balls as a viewer far away sees them, pixel by pixel and exact."""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import jit

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@jit
def nearest_balls(center: Array, radius: Array, depth_out: Array, owner_out: Indices) -> None:
    """Find the ball that is nearest to the viewer at each pixel.

    Args:
        center: Column, row and coordinate towards the viewer of each ball, all in pixels, shape (n, 3).
        radius: [pixels], shape (n,).
        depth_out: Coordinate of the ball's surface towards the viewer [pixels], minus infinity where there is none,
            shape (rows, columns).
        owner_out: The ball or −1, shape (rows, columns).
    """
    rows, columns = depth_out.shape
    depth_out[:] = -np.inf
    owner_out[:] = -1
    for ball in range(radius.shape[0]):
        x, y, z, r = center[ball, 0], center[ball, 1], center[ball, 2], radius[ball]
        for row in range(max(0, math.ceil(y - r)), min(rows - 1, math.floor(y + r)) + 1):
            half2 = r * r - (row - y) * (row - y)
            half = math.sqrt(max(half2, 0.0))
            for column in range(max(0, math.ceil(x - half)), min(columns - 1, math.floor(x + half)) + 1):
                towards = z + math.sqrt(max(half2 - (column - x) * (column - x), 0.0))
                if towards > depth_out[row, column]:
                    depth_out[row, column] = towards
                    owner_out[row, column] = ball
