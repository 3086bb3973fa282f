"""Edges, parts, loops and windings of small meshes whose answers are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.mesh.topology import face_areas, hole_caps, in_fixed_order, is_closed
from tools.shapes.generators import sphere
from tools.shapes.surface_parts import band

BALL = sphere(0.08, subdivisions=2)


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
