"""Edges, parts, loops and windings of small meshes whose answers are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.mesh.topology import (
    boundary_loops,
    distinct_rows,
    face_areas,
    hole_caps,
    in_fixed_order,
    is_closed,
    merged_vertices,
    part_labels,
    undirected_edges,
)
from tools.shapes.generators import cube, cup, sphere
from tools.shapes.surface_parts import band

BALL = sphere(0.08, subdivisions=2)


def test_edges_of_a_closed_surface_follow_eulers_formula() -> None:
    for mesh, genus in ((BALL, 0), (cube(), 0), (cup(), 1)):
        index, count, balance = undirected_edges(mesh.faces)
        assert index.shape == (3 * len(mesh.faces),)
        assert (count == 2).all()
        assert not balance.any()
        assert len(mesh.vertices) - len(count) + len(mesh.faces) == 2 - 2 * genus
        assert is_closed(mesh.faces)
    assert not is_closed(BALL.faces[1:])


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_fixed_order_does_not_depend_on_the_order_before(seed: int) -> None:
    generator = np.random.default_rng(seed)
    vertex_order = generator.permutation(len(BALL.vertices))
    rank = np.argsort(vertex_order)
    turns = generator.integers(0, 3, len(BALL.faces))[:, None]
    faces = np.take_along_axis(rank[BALL.faces], (turns + np.arange(3)) % 3, axis=1)
    vertices, faces = in_fixed_order(BALL.vertices[vertex_order], faces[generator.permutation(len(faces))])
    np.testing.assert_array_equal(vertices, BALL.vertices)
    np.testing.assert_array_equal(faces, BALL.faces)


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 4))
@settings(max_examples=30)
def test_equal_rows_are_those_that_numpy_finds(seed: int, count: int, width: int) -> None:
    rows = np.random.default_rng(seed).integers(-2, 3, (count, width))
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    for table in (rows, rows.astype(np.float64)):
        found = distinct_rows(table)
        np.testing.assert_array_equal(found[0], first)
        np.testing.assert_array_equal(found[1], kind.reshape(-1))


def test_merging_knows_no_sign_of_zero_and_drops_the_unused() -> None:
    vertices = np.array([[9.0, 9.0, 9.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-0.0, 0.0, -0.0], [0.0, 1.0, 0.0]])
    merged, faces = merged_vertices(vertices, np.array([[1, 2, 4], [2, 3, 4]]))
    np.testing.assert_array_equal(merged, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_array_equal(faces, [[0, 1, 2], [1, 0, 2]])


def test_merging_within_a_distance_spans_chains() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [1.8, 0.0, 0.0], [5.0, 0.0, 0.0]])
    faces = np.array([[0, 1, 3], [2, 1, 3]])
    assert len(merged_vertices(vertices, faces, 1.0)[0]) == 2
    assert len(merged_vertices(vertices, faces, 0.5)[0]) == 4


def test_parts_do_not_join_through_an_edge_of_three_faces() -> None:
    assert part_labels(BALL.faces).max() == 0
    assert part_labels(np.concatenate([BALL.faces, BALL.faces + len(BALL.vertices)])).max() == 1
    fan_of_three = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert len(np.unique(part_labels(fan_of_three))) == 3


def test_loops_run_with_the_faces_around_them() -> None:
    loops = boundary_loops(np.delete(BALL.faces, [0, 200], axis=0))
    found = {tuple(np.roll(loop, -int(np.argmin(loop))).tolist()) for loop in loops}
    # The hole left by a face is walked against that face.
    wanted = {tuple(np.roll(face[::-1], -int(np.argmin(face[::-1]))).tolist()) for face in BALL.faces[[0, 200]]}
    assert found == wanted


def test_loops_that_touch_in_a_vertex_are_two() -> None:
    around = np.flatnonzero((BALL.faces == 50).any(axis=1))
    opposite = [face for face in around if len(np.intersect1d(BALL.faces[face], BALL.faces[around[0]])) == 1]
    missing = [around[0], opposite[0]]
    loops = boundary_loops(np.delete(BALL.faces, missing, axis=0))
    assert sorted(len(loop) for loop in loops) == [3, 3]


def tube(outline: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """An open upright tube of height 1 over a counter-clockwise outline, shape (n, 2)."""
    count = len(outline)
    rings = [np.column_stack([outline, np.full(count, height)]) for height in (0.0, 1.0)]
    return np.concatenate(rings), band(np.arange(count), np.arange(count, 2 * count))


def polygon_area(outline: FloatArray) -> float:
    x, y = outline.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2.0)


SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
HORSESHOE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])


@pytest.mark.parametrize(("outline", "centers"), [(SQUARE, 2), (HORSESHOE, 0), (SQUARE[:3], 0)])
def test_caps_close_the_tube_with_the_area_of_its_outline(outline: FloatArray, centers: int) -> None:
    vertices, faces = tube(outline)
    caps = hole_caps(vertices, faces)
    assert len(caps.width) == 2
    assert len(caps.vertices) - len(vertices) == centers
    assert is_closed(np.concatenate([faces, caps.faces]))
    # Flat caps that fold nowhere have exactly the outline's area.
    assert face_areas(caps.vertices, caps.faces).sum() == pytest.approx(2.0 * polygon_area(outline))
    np.testing.assert_allclose(caps.bend, 0.0, atol=1e-12)
