"""Closest point of a triangle against the optimality condition of a projection."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray
from hhsim.kernels.triangle import Triangle, closest_on_triangle, longest_edge


def corners(t: FloatArray) -> Triangle:
    return Triangle(*t.ravel().tolist())


def closest(p: FloatArray, t: FloatArray) -> tuple[FloatArray, float, int]:
    x, y, z, square, feature = closest_on_triangle(float(p[0]), float(p[1]), float(p[2]), corners(t))
    return np.array([x, y, z]), float(np.sqrt(square)), feature


coordinate = st.floats(-1.0, 1.0, width=32)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)


def on_feature(q: FloatArray, t: FloatArray, feature: int) -> float:
    if feature == 0:
        return 0.0
    if feature <= 3:
        return float(np.linalg.norm(q - t[feature - 1]))
    a, b = t[feature - 4], t[(feature - 3) % 3]
    along = np.clip((q - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(q - a - along * (b - a)))


@settings(max_examples=400)
@given(point, point, point, point)
def test_is_the_projection(p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    t = np.array([a, b, c])
    q, distance, feature = closest(p, t)
    assert distance == pytest.approx(np.linalg.norm(p - q), abs=1e-12)
    # q is the projection onto a convex set exactly if no corner lies ahead of it in the direction of p.
    assert ((t - q) @ (p - q)).max() <= 2e-6
    assert on_feature(q, t, feature) <= 1e-9
    # and q lies in the triangle: the distance to it is that of a convex combination of the corners.
    weights, *_ = np.linalg.lstsq(np.vstack([t.T, np.ones(3)]), np.append(q, 1.0), rcond=None)
    assert np.allclose(t.T @ weights, q, atol=1e-9)


@settings(max_examples=100)
@given(point, point, point, st.floats(0.0, 1.0))
def test_without_area_it_is_a_segment(p: FloatArray, a: FloatArray, b: FloatArray, along: float) -> None:
    t = np.array([a, b, a + along * (b - a)])
    q, distance, _ = closest(p, t)
    s = np.clip((p - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-300), 0.0, 1.0)
    assert distance == pytest.approx(np.linalg.norm(p - a - s * (b - a)), abs=1e-6)
    assert np.isfinite(q).all()


def test_every_feature_is_named() -> None:
    t = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    places = [(0.2, 0.2), (-1.0, -1.0), (2.0, -0.5), (-0.5, 2.0), (0.5, -1.0), (1.0, 1.0), (-1.0, 0.5)]
    assert [closest(np.array([x, y, 0.3]), t)[2] for x, y in places] == list(range(7))


def test_longest_edge_takes_the_first_of_equals() -> None:
    t = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert longest_edge(corners(t)) == (1, 2.0)
    assert longest_edge(corners(np.roll(t, 1, axis=0))) == (2, 2.0)
    assert longest_edge(corners(np.zeros((3, 3)))) == (0, 0.0)
