"""Least-distance programs against scipy's SLSQP, and rows that no point satisfies."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, minimize

from hhsim.arrays import FloatArray
from hhsim.repair.skin_hull import nearest_to_origin


def test_half_spaces() -> None:
    normal = np.array([0.6, 0.8])
    found = nearest_to_origin(normal[None], np.array([2.0]))
    assert found is not None
    np.testing.assert_allclose(found, 2.0 * normal, atol=1e-12)
    found = nearest_to_origin(normal[None], np.array([-2.0]))
    assert found is not None and np.array_equal(found, np.zeros(2))
    assert nearest_to_origin(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0])) is None


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_the_nearest_of_all_feasible_points_is_found(seed: int) -> None:
    random = np.random.default_rng(seed)
    size, count = int(random.integers(1, 8)), int(random.integers(1, 30))
    rows, inside = random.normal(size=(count, size)), random.normal(size=size)
    bounds = rows @ inside - random.uniform(0.0, 1.0, count)
    # Rows that repeat others are harmless.
    rows, bounds = np.vstack([rows, rows[:5]]), np.append(bounds, bounds[:5])
    found = nearest_to_origin(rows, bounds)
    assert found is not None and (rows @ found >= bounds - 1e-9).all()

    def square(x: FloatArray) -> float:
        return float(x @ x)

    within = LinearConstraint(rows, bounds, np.inf)
    other = minimize(square, inside, method="SLSQP", constraints=within, options={"maxiter": 500}).x
    assert found @ found <= other @ other + 1e-6 or (rows @ other < bounds - 1e-6).any()
    # The nearest point of a convex set: no feasible point lies behind the plane through it.
    assert found @ (inside - found) >= -1e-9
