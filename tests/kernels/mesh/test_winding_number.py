"""The winding kernels against arctangents in numpy, and inside and outside of what is closed by winding number."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import by_arctangents

from hhsim.arrays import FloatArray
from hhsim.kernels.mesh.bvh import build_mesh_bvh, fast_winding_numbers, winding_numbers
from hhsim.kernels.mesh.inside_field import leave_inside
from tools.shapes.generators import cube

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
