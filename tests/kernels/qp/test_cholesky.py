"""Small symmetric positive definite systems against numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.arrays import FloatArray
from hhsim.kernels.qp.cholesky import NOT_POSITIVE, factorise, solve_factorised


def definite(random: np.random.Generator, count: int, rank: int, weight: float) -> FloatArray:
    """The identity and `rank` springs of very different stiffness, as the method `penalty` makes them."""
    rows = random.normal(0.0, 1.0, (rank, count))
    spring = weight * 10.0 ** random.uniform(-3.0, 0.0, rank)
    matrix: FloatArray = np.eye(count) + rows.T @ (spring[:, None] * rows)
    return matrix


@given(st.integers(0, 2**32 - 1), st.integers(1, 21), st.integers(0, 60), st.floats(1e-3, 1e6))
def test_the_solution_is_that_of_numpy(seed: int, count: int, rank: int, weight: float) -> None:
    random = np.random.default_rng(seed)
    matrix = definite(random, count, rank, weight)
    wanted = random.normal(0.0, 1.0, count)
    vector = matrix @ wanted
    # Whatever stands behind the leading part, or below the diagonal, is neither read nor written.
    whole = np.full((21, 21), np.nan)
    whole[:count, :count] = np.triu(matrix) + np.tril(np.full_like(matrix, np.nan), -1)
    padded = np.full(21, np.nan)
    padded[:count] = vector
    assert factorise(whole, count) == 0
    upper = np.triu(whole[:count, :count])
    np.testing.assert_allclose(upper.T @ upper, matrix, rtol=1e-12, atol=1e-12 * np.abs(matrix).max())
    np.testing.assert_allclose(upper, np.linalg.cholesky(matrix).T, rtol=1e-6, atol=1e-8 * np.sqrt(matrix.max()))
    solve_factorised(whole, count, padded)
    found = padded[:count]
    error = np.linalg.cond(matrix) * 21 * np.finfo(float).eps * np.linalg.norm(wanted)
    assert np.linalg.norm(found - np.linalg.solve(matrix, vector)) <= error
    assert np.linalg.norm(matrix @ found - vector) <= 1e-12 * np.linalg.norm(matrix) * np.linalg.norm(wanted)
    assert np.isnan(padded[count:]).all()
    assert np.isnan(whole[np.tril_indices(21, -1)]).all()


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("place", [0, 2, 3])
def test_a_matrix_that_is_not_positive_definite_is_refused(bad: float, place: int) -> None:
    matrix = np.eye(4)
    matrix[place, place] = bad
    assert factorise(matrix, 4) == NOT_POSITIVE


def test_an_indefinite_matrix_with_a_positive_diagonal_is_refused() -> None:
    assert factorise(np.array([[1.0, 2.0], [2.0, 1.0]]), 2) == NOT_POSITIVE
