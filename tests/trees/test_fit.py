"""Figures of a fit against closed forms, and the definitions of cuRobo's as trimesh and numpy have them."""

import numpy as np
import pytest
import trimesh

from hhsim.mesh.mesh import Mesh
from hhsim.trees.fit import measure_fit

BOX = trimesh.creation.box((0.2, 0.2, 0.2))
MESH = Mesh(np.asarray(BOX.vertices), np.asarray(BOX.faces))


@pytest.mark.parametrize("radius", [0.05, 0.12, 0.18])
def test_a_ball_in_the_middle_of_a_cube(radius: float) -> None:
    fit = measure_fit(MESH, np.zeros((1, 3)), np.array([radius]))
    # Caps of the ball that stick out of the six faces; at 0.18 they meet, and all of the cube lies inside.
    share = 0.0 if radius < 0.1 else min(6.0 * 0.5 * (1.0 - 0.1 / radius), 1.0)
    if radius < 0.15:
        assert fit.protrusion == pytest.approx(share, abs=0.08)
    assert fit.coverage == pytest.approx(min(inside_share(radius), 1.0), abs=0.02)
    assert fit.protrusion_max <= max(radius - 0.1, 0.0) + 1e-12 == fit.bound + 1e-12 or radius < 0.1
    assert fit.surface_gap_max == pytest.approx(max(0.1 * np.sqrt(3.0) - radius, 0.0), abs=0.003)
    assert fit.volume_ratio == pytest.approx(4.0 / 3.0 * np.pi * radius**3 / 0.008)
    assert fit.surface_coverage == pytest.approx(1.0 if radius > 0.1733 else faces_share(radius), abs=0.02)


def inside_share(radius: float) -> float:
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (200_000, 3))
    return float((np.linalg.norm(points, axis=1) < radius).mean())


def faces_share(radius: float) -> float:
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (200_000, 3))
    points[:, 2] = 0.1
    return float((np.linalg.norm(points, axis=1) < radius).mean())


def test_figures_are_those_of_the_definitions_on_many_spheres() -> None:
    rng = np.random.default_rng(1)
    center, radius = rng.uniform(-0.08, 0.08, (12, 3)), rng.uniform(0.02, 0.06, 12)
    fit = measure_fit(MESH, center, radius)
    inside = rng.uniform(-0.1, 0.1, (50_000, 3))
    within = (np.linalg.norm(inside[:, None] - center, axis=2) < radius).any(axis=1).mean()
    assert fit.coverage == pytest.approx(within, abs=0.015)
    directions = rng.normal(size=(12, 2000, 3))
    points = center[:, None] + radius[:, None, None] * directions / np.linalg.norm(directions, axis=2, keepdims=True)
    over = np.maximum(np.abs(points.reshape(-1, 3)) - 0.1, 0.0)
    height = np.linalg.norm(over, axis=1)
    assert fit.protrusion == pytest.approx((height > 0.0).mean(), abs=0.03)
    assert fit.protrusion_mean == pytest.approx(height[height > 0.0].mean(), rel=0.1)
    assert fit.protrusion_p95 == pytest.approx(np.quantile(height[height > 0.0], 0.95), rel=0.1)
    surface = trimesh.sample.sample_surface(BOX, 20_000, seed=2)[0]
    gap = np.maximum((np.linalg.norm(surface[:, None] - center, axis=2) - radius).min(axis=1), 0.0)
    assert fit.surface_gap_mean == pytest.approx(gap.mean(), rel=0.05)
    assert fit.surface_gap_p95 == pytest.approx(np.quantile(gap, 0.95), rel=0.05)
    assert fit.surface_coverage == pytest.approx((gap == 0.0).mean(), abs=0.015)
