"""The faces of a mesh cut along the walls of an octree's cells, so that each piece lies in one cell."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import jit

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_CELL_LEVEL = 20
"""Finest cells: their three coordinates share 63 bits."""

_CORNERS = 12
"""Room for the corners of a piece: a triangle cut by the six walls of a box has at most nine."""


@jit
def _part(polygon: Array, count: int, axis: int, wall: float, above: bool, part_out: Array) -> int:
    """Cut away what lies beyond a wall across an axis; return how many corners are left."""
    left = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = polygon[i, axis] - wall, polygon[j, axis] - wall
        if above:
            here, there = -here, -there
        if here <= 0.0:
            for k in range(3):
                part_out[left, k] = polygon[i, k]
            left += 1
        if (here < 0.0 and there > 0.0) or (here > 0.0 and there < 0.0):
            share = here / (here - there)
            for k in range(3):
                part_out[left, k] = polygon[i, k] + share * (polygon[j, k] - polygon[i, k])
            part_out[left, axis] = wall
            left += 1
    return left


@jit
def cut_by_cells(
    corner: Array,
    low: Array,
    size: float,
    level: int,
    point_out: Array,
    piece_cell_out: Indices,
    piece_end_out: Indices,
) -> tuple[int, int]:
    """Cut faces along the walls of the cells of a level of an octree.

    What lies in a wall belongs to the cell on the side of the solid, behind the face; so does a piece that only touches
    the wall from there.

    Args:
        corner: a, b, c of the faces [m], wound outward, shape (F, 9).
        low: lowest corner of the root cell [m], which holds all faces, shape (3,).
        size: edge of the root cell [m].
        level: of the cells, 0 for the root, at most `MOST_CELL_LEVEL`.
        point_out: corners of the pieces [m], shape (room, 3); those beyond the room are counted but not stored.
        piece_cell_out: cell of each piece, shape (pieces room,): three bits a level, coarsest first, z y x.
        piece_end_out: where the corners of each piece end, shape (pieces room,).

    Returns:
        How many points and pieces there are.
    """
    waiting = 3 * level + 2
    stack = np.empty((waiting, _CORNERS, 3))
    corners = np.empty(waiting, np.int64)
    cuts, code = np.empty(waiting, np.int64), np.empty(waiting, np.int64)
    cell_low = np.empty((waiting, 3))
    polygon, part = np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3))
    place = np.empty(3)
    points = pieces = 0
    for face in range(corner.shape[0]):
        t = corner[face]
        normal = np.empty(3)
        normal[0] = (t[4] - t[1]) * (t[8] - t[2]) - (t[5] - t[2]) * (t[7] - t[1])
        normal[1] = (t[5] - t[2]) * (t[6] - t[0]) - (t[3] - t[0]) * (t[8] - t[2])
        normal[2] = (t[3] - t[0]) * (t[7] - t[1]) - (t[4] - t[1]) * (t[6] - t[0])
        for v in range(3):
            for k in range(3):
                stack[0, v, k] = t[3 * v + k]
        corners[0], cuts[0], code[0] = 3, 0, 0
        for k in range(3):
            cell_low[0, k] = low[k]
        top = 1
        while top > 0:
            top -= 1
            count, cut, cell = corners[top], cuts[top], code[top]
            for v in range(count):
                for k in range(3):
                    polygon[v, k] = stack[top, v, k]
            for k in range(3):
                place[k] = cell_low[top, k]
            if cut == 3 * level:
                for v in range(count):
                    if points < point_out.shape[0]:
                        for k in range(3):
                            point_out[points, k] = polygon[v, k]
                    points += 1
                if pieces < piece_end_out.shape[0]:
                    piece_cell_out[pieces], piece_end_out[pieces] = cell, points
                pieces += 1
                continue
            axis = 2 - cut % 3
            half = size * 0.5 ** (cut // 3 + 1)
            wall = place[axis] + half
            least, most = np.inf, -np.inf
            for v in range(count):
                least = min(least, polygon[v, axis])
                most = max(most, polygon[v, axis])
            for side in range(2):
                if side == 0:
                    wanted = least < wall or (most <= wall and normal[axis] > 0.0)
                else:
                    wanted = most > wall or (least >= wall and normal[axis] <= 0.0)
                if not wanted:
                    continue
                left = _part(polygon, count, axis, wall, side == 1, part)
                for v in range(left):
                    for k in range(3):
                        stack[top, v, k] = part[v, k]
                for k in range(3):
                    cell_low[top, k] = place[k]
                cell_low[top, axis] += side * half
                corners[top], cuts[top], code[top] = left, cut + 1, 2 * cell + side
                top += 1
    return points, pieces
