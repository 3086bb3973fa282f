"""The winding kernel against arctangents in numpy and against solids whose inside is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.mesh.winding_number import winding_numbers
from tools.shapes.generators import cube, cup, sphere


def winding(triangles: FloatArray, points: FloatArray) -> FloatArray:
    result = np.full(len(points), np.nan)
    winding_numbers(np.ascontiguousarray(triangles), np.ascontiguousarray(points), result)
    return result


def by_arctangents(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Van Oosterom and Strackee's formula, one arctangent a triangle."""
    a, b, c = (triangles[None, :, corner] - points[:, None] for corner in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    n = np.einsum("pti,pti->pt", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("pti,pti->pt", first, second) for first, second in ((a, b), (b, c), (c, a)))
    return np.asarray(np.arctan2(n, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2.0 * np.pi))


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
def test_equals_the_sum_of_arctangents_on_random_triangles(seed: int, count: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    triangles = generator.normal(size=(count, 3, 3)) * scale
    points = generator.normal(size=(20, 3)) * scale
    np.testing.assert_allclose(winding(triangles, points), by_arctangents(triangles, points), atol=1e-11 * count)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_turned_faces_and_moved_space(seed: int) -> None:
    generator = np.random.default_rng(seed)
    triangles = generator.normal(size=(30, 3, 3))
    points = generator.normal(size=(10, 3))
    expected = winding(triangles, points)
    np.testing.assert_allclose(winding(triangles[:, ::-1], points), -expected, atol=1e-10)
    rotation, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    shift = generator.normal(size=3)
    np.testing.assert_allclose(
        winding(triangles @ rotation.T + shift, points @ rotation.T + shift), expected, atol=1e-9
    )


def test_one_octant_is_an_eighth() -> None:
    assert winding(np.eye(3)[None], np.zeros((1, 3)))[0] == pytest.approx(0.125, abs=1e-15)


def test_each_face_of_a_cube_is_a_sixth_from_its_middle() -> None:
    triangles = cube().triangles
    top = triangles[(triangles[:, :, 2] > 0.0).all(axis=1)]
    assert len(top) == 2
    assert winding(top, np.zeros((1, 3)))[0] == pytest.approx(1.0 / 6.0, abs=1e-15)


def test_inside_of_a_cube_by_its_coordinates() -> None:
    points = np.random.default_rng(1).uniform(-0.05, 0.05, size=(3000, 3))
    inside = (np.abs(points) < 0.035).all(axis=1)
    assert inside.any()
    np.testing.assert_allclose(winding(cube(0.07).triangles, points), inside, atol=1e-12)


def test_inside_of_a_sphere_by_its_radius() -> None:
    mesh = sphere(0.08, subdivisions=3)
    points = np.random.default_rng(2).uniform(-0.05, 0.05, size=(2000, 3))
    radius = np.linalg.norm(points, axis=1)
    # Between the inscribed and the circumscribed ball the triangles decide.
    clear = np.abs(radius - 0.04) > 0.0005
    np.testing.assert_allclose(winding(mesh.triangles, points)[clear], (radius < 0.04)[clear], atol=1e-12)


def test_inside_of_a_hollow_cup() -> None:
    mesh = cup()
    low, high = mesh.bounds
    # On the axis of the turned wall: bottom, hollow, above.
    axis = low[0] + 0.04
    points = np.array([[axis, 0.0, low[2] + 0.002], [axis, 0.0, 0.0], [axis, 0.0, high[2] + 0.01]])
    np.testing.assert_allclose(winding(mesh.triangles, points), [1.0, 0.0, 0.0], atol=1e-10)


def test_two_layers_count_twice_and_an_open_surface_in_part() -> None:
    triangles = sphere(0.08, subdivisions=2).triangles
    center = np.zeros((1, 3))
    assert winding(np.concatenate([triangles, triangles]), center)[0] == pytest.approx(2.0, abs=1e-12)
    half = triangles[triangles.mean(axis=1)[:, 2] > 0.0]
    assert 0.4 < winding(half, center)[0] < 0.6


def test_degenerate_triangles_and_points_on_the_surface_stay_finite() -> None:
    flat = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]] * 3])
    points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 1.0, 1.0], [3.0, 1.0, 2.0]])
    np.testing.assert_array_equal(winding(flat, points), 0.0)
    corners = cube().vertices
    assert np.isfinite(winding(cube().triangles, corners)).all()


def test_no_triangles_surround_nothing() -> None:
    np.testing.assert_array_equal(winding(np.empty((0, 3, 3)), np.zeros((2, 3))), 0.0)


@pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler there are no signatures")
def test_one_signature() -> None:
    winding(np.eye(3)[None], np.zeros((1, 3)))
    assert len(winding_numbers.signatures) == 1  # type: ignore[attr-defined]
