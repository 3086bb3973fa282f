"""The fast winding number against the exact one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.mesh.fast_winding_number import fast_winding_numbers, winding_moments
from hhsim.kernels.mesh.winding_number import winding_numbers
from tools.shapes.generators import cup, rock, sphere


def fast(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    bvh = build_mesh_bvh(vertices, faces, signed=False)
    result = np.full(len(points), np.nan)
    fast_winding_numbers(bvh, winding_moments(bvh), np.ascontiguousarray(points), result)
    return result


def exact(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    result = np.full(len(points), np.nan)
    winding_numbers(np.ascontiguousarray(vertices[faces]), np.ascontiguousarray(points), result)
    return result


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 400), scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
def test_is_near_the_exact_one_for_loose_triangles(seed: int, count: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    vertices = (rng.normal(size=(count, 1, 3)) + 0.1 * rng.normal(size=(count, 3, 3))).reshape(-1, 3) * scale
    faces = np.arange(3 * count).reshape(-1, 3)
    points = rng.normal(size=(50, 3)) * scale * rng.choice([1.0, 10.0])
    np.testing.assert_allclose(fast(vertices, faces, points), exact(vertices, faces, points), atol=0.05)


@pytest.mark.parametrize("mesh", [sphere(subdivisions=4), rock(), cup()], ids=["sphere", "rock", "cup"])
def test_is_near_the_exact_one_close_to_surfaces(mesh: "object") -> None:
    vertices, faces = mesh.vertices, mesh.faces  # type: ignore[attr-defined]
    rng = np.random.default_rng(4)
    middle = vertices[faces[rng.choice(len(faces), 300)]].mean(axis=1)
    points = middle + rng.normal(size=middle.shape) * 10.0 ** rng.uniform(-7.0, -1.0, size=(300, 1))
    true = exact(vertices, faces, points)
    assert np.abs(fast(vertices, faces, points) - true).max() < 0.05
    holes = faces[rng.random(len(faces)) < 0.7]
    error = np.abs(fast(vertices, holes, points) - exact(vertices, holes, points))
    assert error.max() < 0.05
    assert error.mean() < 0.01


def test_far_away_one_triangle_is_its_solid_angle() -> None:
    vertices = np.eye(3)
    points = np.random.default_rng(3).normal(size=(100, 3)) * 50.0
    true = exact(vertices, np.array([[0, 1, 2]]), points)
    # The terms left out are of the order (size / distance)² of the first.
    np.testing.assert_allclose(fast(vertices, np.array([[0, 1, 2]]), points), true, rtol=0.05, atol=1e-6)


def test_moments_of_a_closed_surface_sum_to_its_volume() -> None:
    mesh = rock()
    moments = winding_moments(build_mesh_bvh(mesh.vertices, mesh.faces, signed=False))
    np.testing.assert_allclose(moments.moment[0, :3], 0.0, atol=1e-15)
    # By the divergence theorem ∮ x nᵀ is the volume times the identity.
    np.testing.assert_allclose(moments.moment[0, 3:].reshape(3, 3), mesh.volume * np.eye(3), atol=1e-15)
    assert (moments.radius > 0.0).all()


def test_a_triangle_without_area_counts_nothing() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    points = np.random.default_rng(5).normal(size=(20, 3)) * 3.0
    np.testing.assert_array_equal(fast(vertices, np.array([[0, 1, 2]]), points), 0.0)


@pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler there are no signatures")
def test_one_signature() -> None:
    fast(np.eye(3), np.array([[0, 1, 2]]), np.ones((1, 3)))
    assert len(fast_winding_numbers.signatures) == 1  # type: ignore[attr-defined]
