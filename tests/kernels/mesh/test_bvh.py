"""The mesh BVH against brute force over all triangles; its sign against ray casting, windings against arctangents."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import by_arctangents, from_triangles

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.bvh import (
    build_mesh_bvh,
    closest_points,
    fast_winding_numbers,
    mesh_signed_distance,
    winding_numbers,
)
from hhsim.kernels.mesh.inside_field import leave_inside
from tools.shapes.generators import cube


def arrays(shape: trimesh.Trimesh) -> tuple[FloatArray, IntArray]:
    return np.array(shape.vertices, dtype=np.float64), np.array(shape.faces, dtype=np.int64)


SHAPES = {
    "icosphere": trimesh.creation.icosphere(3, 0.05),
    "box": trimesh.creation.box((0.1, 0.06, 0.02)),
    "cylinder": trimesh.creation.cylinder(0.03, 0.1, sections=48),
    "torus": trimesh.creation.torus(0.04, 0.012),
}


@pytest.mark.parametrize("name", SHAPES)
def test_is_the_brute_force_distance_with_the_sign_of_ray_casting(name: str) -> None:
    vertices, faces = arrays(SHAPES[name])
    points = np.random.default_rng(1).uniform(1.3 * vertices.min(axis=0), 1.3 * vertices.max(axis=0), (200, 3))
    bvh = build_mesh_bvh(vertices, faces)
    signed = mesh_signed_distance(bvh, points)
    assert np.abs(np.abs(signed) - from_triangles(vertices[faces])(points[:, None]).min(axis=1)).max() < 1e-12
    inside = np.asarray(SHAPES[name].contains(points))
    assert inside.any() and not inside.all()
    assert np.array_equal(signed < 0.0, inside)

    closest = np.empty((len(points), 3))
    closest_points(bvh, points, closest, signed)
    assert np.abs(np.linalg.norm(closest - points, axis=1) - np.abs(signed)).max() < 1e-15
    assert np.abs(mesh_signed_distance(bvh, closest)).max() < 1e-9


def test_what_is_beyond_the_box_of_a_mesh_that_cuts_through_itself_is_outside() -> None:
    # The nearest face is one of the smaller box, which is wound the other way and sticks out of the larger one.
    vertices, faces = arrays(trimesh.creation.box((0.1, 0.06, 0.02)))
    smaller, turned = arrays(trimesh.creation.box((0.02, 0.02, 0.02)))
    vertices = np.concatenate([vertices, smaller + [0.05, 0.0, 0.0]])
    bvh = build_mesh_bvh(vertices, np.concatenate([faces, turned[:, ::-1] + 8]))
    away = np.array([[0.09, 0.0, 0.0], [0.061, 0.005, -0.002]])
    np.testing.assert_allclose(mesh_signed_distance(bvh, away), [0.03, 0.001], atol=1e-15)


CUBE = cube(0.07)


def winding(triangles: FloatArray, points: FloatArray) -> FloatArray:
    result = np.full(len(points), np.nan)
    winding_numbers(np.ascontiguousarray(triangles), np.ascontiguousarray(points), result)
    return result


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
def test_equals_the_sum_of_arctangents_on_random_triangles(seed: int, count: int, scale: float) -> None:
    generator = np.random.default_rng(seed)
    triangles = generator.normal(size=(count, 3, 3)) * scale
    points = generator.normal(size=(20, 3)) * scale
    np.testing.assert_allclose(winding(triangles, points), by_arctangents(triangles, points), atol=1e-11 * count)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 400), scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
def test_the_fast_one_is_near_the_exact_one_for_loose_triangles(seed: int, count: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    vertices = (rng.normal(size=(count, 1, 3)) + 0.1 * rng.normal(size=(count, 3, 3))).reshape(-1, 3) * scale
    faces = np.arange(3 * count).reshape(-1, 3)
    points = rng.normal(size=(50, 3)) * scale * rng.choice([1.0, 10.0])
    bvh = build_mesh_bvh(vertices, faces, signed=False, by_winding=True)
    np.testing.assert_allclose(fast_winding_numbers(bvh, points), winding(vertices[faces], points), atol=0.05)


def test_a_hole_is_left_where_the_winding_number_is_one_half() -> None:
    top = (CUBE.triangles[:, :, 2] > 0.0).all(axis=1)
    walls = build_mesh_bvh(CUBE.vertices, CUBE.faces[~top], signed=False, by_winding=True)
    start, share = np.array([[0.0, 0.0, 0.0], [0.001, 0.002, -0.02]]), np.empty(2)
    leave_inside(walls, start, start + [0.0, 0.0, 0.1], share)
    # From the plane of a hole its edge hides just half of all directions.
    np.testing.assert_allclose(start[:, 2] + 0.1 * share, 0.035, atol=1e-3)
