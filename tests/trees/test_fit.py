"""Figures and errors of a fit against closed forms, brute force, trimesh, and the definitions of cuRobo's."""

import numpy as np
import pytest
import trimesh

from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.error import measure_levels, sample_spheres
from hhsim.trees.fit import measure_fit
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions

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


SMALL_BOX = trimesh.creation.box((0.1, 0.1, 0.1))
SMALL_MESH = Mesh(np.asarray(SMALL_BOX.vertices), np.asarray(SMALL_BOX.faces), name="box")


def test_errors_are_true() -> None:
    mesh = SMALL_MESH
    tree = build_sphere_tree(mesh, TreeOptions(level=2))
    rng = np.random.default_rng(17)
    for error in tree.errors:
        center, radius = tree.spheres(error.level)
        points, owner, area = sample_spheres(center, radius, 40_000, rng)
        distance = np.linalg.norm(points[:, None] - center, axis=2) - radius
        distance[np.arange(len(points)), owner] = np.inf
        points, area = points[distance.min(axis=1) >= 0.0], area[distance.min(axis=1) >= 0.0]
        # The distance from a box in closed form.
        outside = np.linalg.norm(np.maximum(0.0, np.abs(points) - 0.05), axis=1)
        area, outside = area[outside > 0.0], outside[outside > 0.0]
        assert outside.max() <= error.bound
        assert error.protrusion_max <= error.bound * (1.0 + 1e-12)
        assert error.protrusion_max == pytest.approx(outside.max(), rel=0.03)
        assert error.protrusion_mean == pytest.approx(np.average(outside, weights=area), rel=0.03)
        assert error.protrusion_mean <= error.protrusion_p99 <= error.protrusion_max


def test_a_lone_ball_in_closed_form() -> None:
    bvh = build_mesh_bvh(SMALL_MESH.vertices, SMALL_MESH.faces)
    tree = build_hierarchy(np.zeros((1, 3)), np.array([0.06]), 1, 8)
    error = measure_levels(SMALL_MESH, bvh, tree)[-1]
    assert error.bound == pytest.approx(0.01)
    assert error.protrusion_max == pytest.approx(0.01, rel=1e-3)
    # Each face lets a cap through whose heights are spread evenly: Archimedes.
    assert error.protrusion_mean == pytest.approx(0.005, rel=0.02)
    assert error.protrusion_p99 == pytest.approx(0.0099, rel=0.01)
    assert error.gap_max == pytest.approx(0.05 * np.sqrt(3.0) - 0.06, rel=0.05)
