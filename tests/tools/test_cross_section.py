"""Sections: against areas and distances that are known in closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_oracle import to_cone

from tools.cross_section import Plane, cut_mesh, cut_spheres, round_cone_outline
from tools.shapes.generators import sphere

FLAT = Plane(np.zeros(3), np.eye(3))


def area(curve: np.ndarray) -> float:
    x, y = curve.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def turned(seed: int) -> np.ndarray:
    """A rotation at random."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


def test_a_ball_is_cut_into_a_circle_or_not_at_all() -> None:
    center = np.array([[0.1, 0.2, 0.03], [0.0, 0.0, -0.06], [0.0, 0.0, 0.0]])
    flat, radius, which = cut_spheres(FLAT, center, np.array([0.05, 0.05, 0.02]))
    assert which.tolist() == [0, 2]
    np.testing.assert_allclose(flat, [[0.1, 0.2], [0.0, 0.0]])
    np.testing.assert_allclose(radius, [0.04, 0.02], rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_sphere_is_cut_into_one_curve_of_its_area(seed: int) -> None:
    mesh = sphere(0.1)
    plane = Plane(np.array([0.001, 0.002, 0.003]), turned(seed))
    away = plane.height(np.zeros(3))
    (curve,) = cut_mesh(plane, mesh.vertices, mesh.faces)
    assert area(curve) == pytest.approx(np.pi * (0.05**2 - away**2), rel=0.02)


@given(
    length=st.floats(0.0, 0.05),
    thick=st.floats(1e-3, 0.02),
    share=st.floats(0.0, 1.0),
    heading=st.floats(-np.pi, np.pi),
)
def test_an_outline_is_where_the_round_cone_ends(length: float, thick: float, share: float, heading: float) -> None:
    a = np.array([0.01, -0.02])
    b = a + length * np.array([np.cos(heading), np.sin(heading)])
    outline = round_cone_outline(a, b, thick, share * thick)
    corners, first, last = (np.pad(points, [(0, 0)] * (points.ndim - 1) + [(0, 1)]) for points in (outline[::7], a, b))
    assert np.abs(to_cone(corners, first, last, thick, share * thick)).max() < 1e-9
