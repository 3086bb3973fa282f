"""Caps over holes of known shape: area, winding, the kind of cap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.mesh.topology import face_areas, hole_caps, is_closed
from tools.shapes.generators import sphere
from tools.shapes.surface_parts import band


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


def test_width_and_bend_of_a_known_hole() -> None:
    angle = 2.0 * np.pi * np.arange(48) / 48
    ring = np.column_stack([2.0 * np.cos(angle), np.sin(angle), 0.1 * np.cos(2.0 * angle)])
    vertices = np.concatenate([ring, ring + np.array([0.0, 0.0, 3.0])])
    caps = hole_caps(vertices, band(np.arange(48), np.arange(48, 96)))
    np.testing.assert_allclose(caps.width, 4.0, rtol=1e-3)
    np.testing.assert_allclose(caps.bend, 0.1, rtol=0.05)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), missing=st.integers(1, 40))
def test_any_set_of_missing_faces_is_closed_again(seed: int, missing: int) -> None:
    mesh = sphere(subdivisions=2)
    gone = np.random.default_rng(seed).choice(len(mesh.faces), size=missing, replace=False)
    faces = np.delete(mesh.faces, gone, axis=0)
    assert is_closed(np.concatenate([faces, hole_caps(mesh.vertices, faces).faces]))
