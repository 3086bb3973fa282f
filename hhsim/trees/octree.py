"""Sphere trees from an octree: the comparison that the literature starts from.

The cube around the object is halved along its three axes again and again; a cell that the surface passes through gets
a ball. As published, the ball is that around the cell (Palmer and Grimsdale 1995, "Collision detection for animation
using sphere-trees"; Hubbard 1996; O'Sullivan and Dingliana 1999, "Real-time collision detection and response using
sphere-trees"). Fitted, it is the smallest ball around that part of the surface that lies in the cell.
Cells that lie wholly inside get no ball: they would cost spheres and leave every error as it is.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.kernels.enclosing_ball import enclosing_ball
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.mesh.octree_clipping import cut_by_cells
from hhsim.mesh.mesh import Mesh
from hhsim.trees.enclosing_tree import cover_with_proof, enclosing_tree
from hhsim.trees.level_cover import LevelCover
from hhsim.trees.sphere_tree import SphereTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

BRANCHING = 8
"""Of an octree."""

SEAM = 2e-5
"""Fitted balls are made larger by this share of the root cell, so that those of neighbours overlap where they meet."""


def build_octree(
    mesh: Mesh, level: int, branching: int, leaves: int | None = None, progress: Progress | None = None
) -> SphereTree:
    """Build the tree of the finest octree that has few enough cells, with the balls around the cells.

    The balls of each level cover the surface, and every inner node encloses the leaves below it.

    Args:
        mesh: Any; it need not be closed.
        level: Of the finest cells, at most; the root is level 0.
        branching: 8.
        leaves: Most leaves, None for any number. A level of the octree with more cells is not built: the tree ends
            above it.
        progress: called with ("cover", levels done, levels).

    Returns:
        The tree with the cover of each level, not measured.

    Raises:
        InputError: Another branching.
    """
    return _build(mesh, level, branching, leaves, progress, fitted=False)


def build_fitted_octree(
    mesh: Mesh, level: int, branching: int, leaves: int | None = None, progress: Progress | None = None
) -> SphereTree:
    """Build it with the smallest balls around the surface in each cell; arguments as of `build_octree`."""
    return _build(mesh, level, branching, leaves, progress, fitted=True)


def _build(
    mesh: Mesh, level: int, branching: int, leaves: int | None, progress: Progress | None, *, fitted: bool
) -> SphereTree:
    if branching != BRANCHING:
        raise InputError(f"tree branching {branching}: an octree has {BRANCHING} children a cell")
    low, size = root_cell(mesh)
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    codes: list[IntArray] = []
    covers: list[LevelCover] = []
    started = [time.process_time()]
    for finer in range(level + 1):
        cells = _cells(mesh, low, size, finer)
        if leaves is not None and len(cells.code) > leaves:
            break
        codes.append(cells.code)
        ball = _fitted(cells, size) if fitted else _around(cells, low, size)
        covers.append(cover_with_proof(mesh, bvh, *ball))
        started.append(time.process_time())
        if progress is not None:
            progress("cover", finer, level)
    parents = [np.searchsorted(codes[at], codes[at + 1] // BRANCHING) for at in range(len(codes) - 1)]
    return enclosing_tree(covers, parents, np.diff(started).tolist())


def root_cell(mesh: Mesh) -> tuple[FloatArray, float]:
    """The cube about the middle of the mesh's bounding box that just holds it: lowest corner, shape (3,), and edge."""
    low, high = mesh.bounds
    # So much larger that rounding cannot put a vertex outside.
    size = float((high - low).max()) * (1.0 + 1e-12)
    return np.asarray(0.5 * (low + high) - 0.5 * size), size


class _Cells(NamedTuple):
    """Cells of a level that the surface passes through, in order, and the corners of the surface's pieces in them.

    level: of the octree; code: shape (n,), three bits a level; points: [m], shape (P, 3), those of cell i from first[i]
    to first[i + 1] − 1.
    """

    level: int
    code: IntArray
    points: FloatArray
    first: IntArray


def _cells(mesh: Mesh, low: FloatArray, size: float, level: int) -> _Cells:
    corner = np.ascontiguousarray(mesh.triangles.reshape(-1, 9))
    none = np.empty(0, np.int64)
    point_count, piece_count = cut_by_cells(corner, low, size, level, np.empty((0, 3)), none, none)
    points = np.empty((point_count, 3))
    piece_cell, piece_end = np.empty((2, piece_count), np.int64)
    cut_by_cells(corner, low, size, level, points, piece_cell, piece_end)
    of_point = np.repeat(piece_cell, np.diff(piece_end, prepend=0))
    order = np.argsort(of_point, kind="stable")
    code, first = np.unique(of_point[order], return_index=True)
    return _Cells(level, code, points[order], np.append(first, point_count))


def _around(cells: _Cells, low: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Balls around the cells: centres [m], shape (n, 3), and radii [m], shape (n,)."""
    edge = size * 0.5**cells.level
    index = np.zeros((len(cells.code), 3))
    for bit in range(cells.level):
        for k in range(3):
            index[:, k] += (cells.code >> (3 * bit + k) & 1) << bit
    return low + (index + 0.5) * edge, np.full(len(index), 0.5 * np.sqrt(3.0) * edge)


def _fitted(cells: _Cells, size: float) -> tuple[FloatArray, FloatArray]:
    """The smallest balls around the surface in the cells: centres [m], shape (n, 3), and radii [m], shape (n,)."""
    balls, no_radius = np.empty((len(cells.code), 4)), np.zeros(len(cells.points))
    for at, ball in enumerate(balls):
        enclosing_ball(cells.points, no_radius, np.arange(cells.first[at], cells.first[at + 1]), ball)
    return balls[:, :3], balls[:, 3] + SEAM * size
