"""The smallest enclosing sphere of spheres against scipy, and its guarantee against anything."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import NonlinearConstraint, minimize

from hhsim.arrays import FloatArray
from hhsim.kernels.enclosing_sphere import enclosing_sphere


def sphere_around(center: FloatArray, radius: FloatArray) -> FloatArray:
    out = np.empty(4)
    enclosing_sphere(np.asarray(center, float), np.asarray(radius, float), np.arange(len(radius)), out)
    return out


def reach(center: FloatArray, radius: FloatArray, sphere: FloatArray) -> float:
    return float((np.linalg.norm(center - sphere[:3], axis=1) + radius).max())


@settings(max_examples=40)
@given(st.integers(1, 40), st.integers(0, 2**31), st.floats(0.0, 2.0))
def test_is_the_smallest(count: int, seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    center, radius = rng.normal(size=(count, 3)), spread * rng.random(count)
    sphere = sphere_around(center, radius)
    assert reach(center, radius, sphere) <= sphere[3]

    def constraints(v: FloatArray) -> FloatArray:
        return np.asarray(v[3] - np.sqrt(((center - v[:3]) ** 2).sum(axis=1) + 1e-16) - radius)

    mean = center.mean(axis=0)
    start = np.append(mean, reach(center, radius, np.append(mean, 0.0)))
    best = minimize(  # type: ignore[call-overload]
        lambda v: float(v[3]),
        start,
        constraints=NonlinearConstraint(constraints, 0.0, np.inf),
        method="SLSQP",
        tol=1e-12,
    )
    assert sphere[3] <= reach(center, radius, best.x) * (1.0 + 1e-9)


@settings(max_examples=60)
@given(st.integers(1, 30), st.integers(0, 2**31), st.integers(1, 3), st.sampled_from([1e-9, 1.0, 1e9]))
def test_encloses_whatever_is_degenerate(count: int, seed: int, values: int, scale: float) -> None:
    # Repeated, collinear and coplanar centres, equal and zero radii.
    rng = np.random.default_rng(seed)
    center = scale * rng.integers(0, values, size=(count, 3)).astype(float)
    radius = scale * rng.integers(0, values, size=count).astype(float)
    sphere = sphere_around(center, radius)
    assert reach(center, radius, sphere) <= sphere[3]
    around_mean = reach(center, radius, np.append(center.mean(axis=0), 0.0))
    assert sphere[3] <= around_mean * (1.0 + 1e-9)
