"""Factors of small systems: orthonormal and exact after many updates, and what is solved with them, against numpy."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from qp_problems import rubbish_work
from sampled import sampled

from hhsim.arrays import FloatArray
from hhsim.kernels.qp.cholesky import NOT_POSITIVE, factorise, solve_factorised
from hhsim.kernels.qp.qr_update import append, back_substitute, project, remove, resolve


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


def load(work: Any, normal: FloatArray) -> None:
    work.normal[:] = 0.0
    work.normal[: normal.size] = normal


def factored(work: Any, n: int, k: int) -> tuple[FloatArray, FloatArray]:
    """Q (k, n) and R (k, k), with everything that pads them checked to be zero."""
    padded = -(-n // 8) * 8
    assert not work.basis[:k, n:padded].any()
    for j in range(k):
        assert not work.column[j, j + 1 : -(-(j + 1) // 8) * 8].any()
    return work.basis[:k, :n].copy(), np.triu(work.column[:k, :k].T)


@pytest.mark.parametrize("n", sampled([1, 3, 6, 8, 21, 24, 30], lambda place, n: n in (1, 6, 8, 21)))
def test_factors_survive_a_thousand_updates(n: int) -> None:
    rng = np.random.default_rng(n)
    work = rubbish_work(n, 1)
    normals: list[FloatArray] = []
    for step in range(1000):
        k = len(normals)
        if k == n or (k > 0 and rng.random() < 0.45):
            position = int(rng.integers(0, k))
            remove(n, k, position, work)
            del normals[position]
        else:
            normal = rng.normal(size=n)
            if k > 0 and rng.random() < 0.3:
                normal = normals[int(rng.integers(0, k))] + 1e-6 * normal
            normal /= np.linalg.norm(normal)
            load(work, normal)
            square = project(n, k, work)
            assert square == pytest.approx(float(work.direction[:n] @ work.direction[:n]), rel=1e-13)
            append(n, k, step, 0.0, float(np.sqrt(square)), work)
            normals.append(normal)
        k = len(normals)
        basis, triangle = factored(work, n, k)
        np.testing.assert_allclose(basis @ basis.T, np.eye(k), atol=1e-12)
        np.testing.assert_allclose(triangle.T @ basis, np.array(normals).reshape(k, n), atol=1e-12)
        assert np.all(np.diag(triangle) > 0.0)
        np.testing.assert_allclose(work.inverse_diagonal[:k] * np.diag(triangle), 1.0, rtol=1e-14)


@pytest.mark.parametrize("share", [1.0, 1e-1, 1e-3, 1e-6, 1e-9])
def test_a_second_pass_keeps_nearly_dependent_normals_orthogonal(share: float) -> None:
    rng = np.random.default_rng(2)
    n = 21
    for _ in range(50):
        work = rubbish_work(n, 1)
        inside = rng.normal(size=(n - 1, n))
        for k in range(n):
            normal = inside[k] if k < n - 1 else rng.normal(size=n - 1) @ inside
            normal /= np.linalg.norm(normal)
            if k == n - 1:
                normal += share * rng.normal(size=n)
                normal /= np.linalg.norm(normal)
            load(work, normal)
            append(n, k, k, 0.0, float(np.sqrt(project(n, k, work))), work)
        basis, _ = factored(work, n, n)
        np.testing.assert_allclose(basis @ basis.T, np.eye(n), atol=1e-13)


@pytest.mark.parametrize("n", [3, 6, 21])
def test_equations_are_solved_with_their_multipliers(n: int) -> None:
    rng = np.random.default_rng(n)
    for k in range(n + 1):
        work = rubbish_work(n, 1)
        matrix = rng.normal(size=(k, n))
        matrix /= np.linalg.norm(matrix, axis=1)[:, None]
        rhs, target = rng.normal(size=k), rng.normal(size=n)
        for i in range(k):
            load(work, matrix[i])
            append(n, i, i, rhs[i] - matrix[i] @ target, float(np.sqrt(project(n, i, work))), work)
        resolve(n, k, target, work)
        gram = np.linalg.solve(matrix @ matrix.T, rhs - matrix @ target) if k else np.zeros(0)
        scale = 1.0 + np.abs(gram).max(initial=0.0)
        np.testing.assert_allclose(work.multiplier[:k], gram, atol=1e-11 * scale)
        np.testing.assert_allclose(work.x[:n], target + matrix.T @ gram, atol=1e-11 * scale)
        _, triangle = factored(work, n, k)
        other = rng.normal(size=work.dual_step.size)
        expected = np.linalg.solve(triangle, other[:k]) if k else np.zeros(0)
        back_substitute(k, work, other, work.dual_step)
        np.testing.assert_allclose(work.dual_step[:k], expected, atol=1e-11 * (1.0 + np.abs(expected).max(initial=0.0)))
