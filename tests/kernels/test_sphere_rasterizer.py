"""The nearest sphere at each pixel, against every sphere at every pixel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.kernels.sphere_rasterizer import nearest_spheres


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 8))
def test_nearest_balls(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    # Some lie partly or wholly outside of the picture.
    center = rng.uniform(-8.0, 30.0, (count, 3))
    radius = rng.uniform(0.0, 9.0, count)
    depth, owner = np.empty((18, 25)), np.empty((18, 25), np.int64)
    nearest_spheres(center, radius, depth, owner)
    column, row = np.meshgrid(np.arange(25), np.arange(18))
    away2 = (column[..., None] - center[:, 0]) ** 2 + (row[..., None] - center[:, 1]) ** 2
    inside = away2 <= radius**2
    surface = np.where(inside, center[:, 2] + np.sqrt(np.maximum(radius**2 - away2, 0.0)), -np.inf)
    assert depth == pytest.approx(surface.max(axis=2), abs=1e-6)
    assert ((owner >= 0) == inside.any(axis=2)).all()
    seen = owner >= 0
    assert depth[seen] == pytest.approx(np.take_along_axis(surface, np.maximum(owner, 0)[..., None], 2)[seen][:, 0])
