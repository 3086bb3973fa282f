"""The measured errors against closed forms and brute force, and the samples that they rest on."""

import numpy as np
import pytest
import trimesh

from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.error import measure_levels, sample_spheres
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions

BOX = trimesh.creation.box((0.1, 0.1, 0.1))
MESH = Mesh(np.asarray(BOX.vertices), np.asarray(BOX.faces), name="box")


def test_errors_are_true() -> None:
    mesh = MESH
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
    bvh = build_mesh_bvh(MESH.vertices, MESH.faces)
    tree = build_hierarchy(np.zeros((1, 3)), np.array([0.06]), 1, 8)
    error = measure_levels(MESH, bvh, tree)[-1]
    assert error.bound == pytest.approx(0.01)
    assert error.protrusion_max == pytest.approx(0.01, rel=1e-3)
    # Each face lets a cap through whose heights are spread evenly: Archimedes.
    assert error.protrusion_mean == pytest.approx(0.005, rel=0.02)
    assert error.protrusion_p99 == pytest.approx(0.0099, rel=0.01)
    assert error.gap_max == pytest.approx(0.05 * np.sqrt(3.0) - 0.06, rel=0.05)
