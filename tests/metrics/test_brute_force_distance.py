"""Distances by brute force, against a dense sampling of the axis and the trees'."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.metrics.brute_force_distance import round_cone_distance


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_a_round_cone_is_the_union_of_the_spheres_on_its_axis(seed: int) -> None:
    random = np.random.default_rng(seed)
    a, b = random.normal(0.0, 0.02, (2, 3))
    length = float(np.linalg.norm(b - a))
    radius_a = random.uniform(0.005, 0.02)
    radius_b = radius_a - random.uniform(0.0, 0.95) * min(length, radius_a)
    points = random.normal(0.0, 0.04, (30, 3))
    s = np.linspace(0.0, 1.0, 20_001)
    axis, radius = a + s[:, None] * (b - a), radius_a + s * (radius_b - radius_a)
    sampled = np.array([(np.linalg.norm(axis - point, axis=1) - radius).min() for point in points])
    exact = round_cone_distance(points, a, b, radius_a, radius_b)
    outside = sampled > 0.0
    assert (exact[outside] <= sampled[outside] + 1e-15).all()
    np.testing.assert_allclose(exact[outside], sampled[outside], atol=2.0 * length / 20_000)
    assert (exact[~outside] <= 1e-15).all()
