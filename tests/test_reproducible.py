"""Products, angles and axes that do not depend on the machine, against numpy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hhsim.arrays import FloatArray
from hhsim.reproducible import arc_tangent, dot, exponential, matmul, norm, principal_axes, sine_and_cosine

MATRICES = arrays(np.float64, (3, 3), elements=st.floats(-10.0, 10.0))


@given(MATRICES, MATRICES)
def test_products(first: FloatArray, second: FloatArray) -> None:
    np.testing.assert_allclose(matmul(first, second), first @ second, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(matmul(first, second[0]), first @ second[0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(matmul(first[None, None], second), (first @ second)[None, None], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(dot(first, second), np.einsum("ij,ij->i", first, second), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(norm(first), np.linalg.norm(first, axis=1), rtol=1e-15)


def test_a_product_takes_its_terms_one_after_the_other() -> None:
    first, second = np.random.default_rng(0).normal(size=(2, 3, 3))
    for i in range(3):
        for j in range(3):
            total = first[i, 0] * second[0, j]
            for k in (1, 2):
                total = total + first[i, k] * second[k, j]
            assert matmul(first, second)[i, j] == total


def test_angles_keep_the_shape() -> None:
    angle = np.random.default_rng(1).normal(size=(4, 5))
    sine, cosine = sine_and_cosine(angle)
    np.testing.assert_allclose([sine, cosine], [np.sin(angle), np.cos(angle)], rtol=0.0, atol=2e-16)
    np.testing.assert_allclose(arc_tangent(angle, angle[:1]), np.arctan2(angle, angle[:1]), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(exponential(angle), np.exp(angle), rtol=1e-15)
    assert sine_and_cosine(0.5)[0].shape == arc_tangent(1.0, 2.0).shape == exponential(1.0).shape == ()


@given(arrays(np.float64, (4, 3), elements=st.floats(-10.0, 10.0)))
def test_principal_axes_diagonalise_the_matrix(points: FloatArray) -> None:
    matrix = points.T @ points
    value, axes = principal_axes(matrix)
    scale = max(1.0, float(np.abs(matrix).max()))
    np.testing.assert_allclose(value, np.linalg.eigvalsh(matrix), rtol=0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(axes @ np.diag(value) @ axes.T, matrix, rtol=0.0, atol=1e-13 * scale)
    assert np.linalg.det(axes) > 0.0
    assert all(axes[np.abs(axes[:, k]).argmax(), k] > 0.0 for k in (0, 1))
