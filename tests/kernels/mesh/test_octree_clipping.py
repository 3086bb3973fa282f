"""Pieces of faces in an octree's cells, against areas, bounds and a brute-force search."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.kernels.mesh.octree_clipping import cut_by_cells

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def pieces_of(corner: Array, low: Array, size: float, level: int) -> tuple[list[Array], Indices]:
    none = np.empty(0, np.int64)
    points, pieces = cut_by_cells(corner, low, size, level, np.empty((0, 3)), none, none)
    point, cell, end = np.empty((points, 3)), np.empty(pieces, np.int64), np.empty(pieces, np.int64)
    assert cut_by_cells(corner, low, size, level, point, cell, end) == (points, pieces)
    return np.split(point, end[:-1]), cell


def cell_low(code: int, low: Array, size: float, level: int) -> Array:
    place = low.copy()
    for depth in range(level):
        for k in range(3):
            place[k] += (code >> (3 * (level - 1 - depth) + k) & 1) * size * 0.5 ** (depth + 1)
    return place


def area(polygon: Array) -> float:
    around = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return 0.5 * float(np.linalg.norm(around.sum(axis=0)))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 4))
def test_pieces_lie_in_their_cells_and_make_up_the_face(seed: int, level: int) -> None:
    rng = np.random.default_rng(seed)
    corner = rng.random((3, 9))
    if seed % 3 == 0:
        # Corners on the walls of cells, where sides are hardest to tell.
        corner = np.round(corner * 8.0) / 8.0
    low = np.zeros(3)
    polygons, cell = pieces_of(corner, low, 1.0, level)
    for polygon, code in zip(polygons, cell, strict=True):
        place = cell_low(int(code), low, 1.0, level)
        assert (polygon >= place - 1e-12).all() and (polygon <= place + 0.5**level + 1e-12).all()
    whole = sum(area(triangle.reshape(3, 3)) for triangle in corner)
    assert sum(area(polygon) for polygon in polygons) == pytest.approx(whole, rel=1e-9, abs=1e-15)
    samples = rng.dirichlet(np.ones(3), 200)
    on_first = samples @ corner[0].reshape(3, 3)
    index = np.floor(on_first * 2**level).astype(np.int64)
    inside = (np.abs(on_first * 2**level - np.round(on_first * 2**level)) > 1e-9).all(axis=1)
    found = {tuple(np.floor(cell_low(int(code), low, 1.0, level) * 2**level + 0.5).astype(int)) for code in cell}
    assert {tuple(at) for at in index[inside]} <= found


def test_a_face_in_a_wall_belongs_to_the_side_of_the_solid() -> None:
    box = trimesh.creation.box((0.5, 0.5, 0.5))
    corner = np.array(box.triangles, np.float64).reshape(-1, 9) + 0.25
    # The box fills one of the eight cells: no other gets a piece, although all its inner faces lie in walls.
    _, cell = pieces_of(corner, np.zeros(3), 1.0, 1)
    assert set(cell.tolist()) == {0}
    _, cell = pieces_of(corner + 0.5, np.zeros(3), 1.0, 1)
    assert set(cell.tolist()) == {7}
