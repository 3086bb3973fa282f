"""The winding kernels against arctangents in numpy and solids whose inside is known, and three rays against them."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import by_arctangents
from numpy.typing import NDArray

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.jit import jit_allocating
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.mesh.ray_winding import DIRECTIONS, is_surrounded
from hhsim.kernels.mesh.winding_number import fast_winding_numbers, winding_moments, winding_numbers
from hhsim.kernels.sphere_tree import STACK_SIZE
from hhsim.mesh.features import mesh_features
from tools.shapes.generators import cube, cup, rock, sphere


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


def test_degenerate_triangles_and_points_on_the_surface_stay_finite() -> None:
    flat = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]] * 3])
    points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 1.0, 1.0], [3.0, 1.0, 2.0]])
    np.testing.assert_array_equal(winding(flat, points), 0.0)
    corners = cube().vertices
    assert np.isfinite(winding(cube().triangles, corners)).all()


def fast(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    bvh = build_mesh_bvh(vertices, faces, signed=False)
    result = np.full(len(points), np.nan)
    fast_winding_numbers(bvh, winding_moments(bvh), np.ascontiguousarray(points), result)
    return result


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 400), scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
def test_the_fast_one_is_near_the_exact_one_for_loose_triangles(seed: int, count: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    vertices = (rng.normal(size=(count, 1, 3)) + 0.1 * rng.normal(size=(count, 3, 3))).reshape(-1, 3) * scale
    faces = np.arange(3 * count).reshape(-1, 3)
    points = rng.normal(size=(50, 3)) * scale * rng.choice([1.0, 10.0])
    np.testing.assert_allclose(fast(vertices, faces, points), winding(vertices[faces], points), atol=0.05)


@pytest.mark.parametrize("mesh", [sphere(subdivisions=4), rock(), cup()], ids=["sphere", "rock", "cup"])
def test_the_fast_one_is_near_the_exact_one_close_to_surfaces(mesh: "object") -> None:
    vertices, faces = mesh.vertices, mesh.faces  # type: ignore[attr-defined]
    rng = np.random.default_rng(4)
    middle = vertices[faces[rng.choice(len(faces), 300)]].mean(axis=1)
    points = middle + rng.normal(size=middle.shape) * 10.0 ** rng.uniform(-7.0, -1.0, size=(300, 1))
    true = winding(vertices[faces], points)
    assert np.abs(fast(vertices, faces, points) - true).max() < 0.05
    holes = faces[rng.random(len(faces)) < 0.7]
    error = np.abs(fast(vertices, holes, points) - winding(vertices[holes], points))
    assert error.max() < 0.05
    assert error.mean() < 0.01


@jit_allocating
def surrounded(mesh: MeshFeatures, points: NDArray[np.float64], found_out: NDArray[np.bool_]) -> None:
    stack = np.empty(STACK_SIZE, np.int64)
    for i in range(points.shape[0]):
        found_out[i] = is_surrounded(
            mesh.spheres, mesh.corner, mesh.multiplicity, points[i, 0], points[i, 1], points[i, 2], stack
        )


@pytest.mark.parametrize("turned", [False, True])
def test_rays_count_as_solid_angles_do_also_where_parts_overlap_or_are_inside_out(turned: bool) -> None:
    ball, ring = trimesh.creation.icosphere(3, 0.04), trimesh.creation.torus(0.04, 0.015)
    faces = np.asarray(ring.faces)[:, ::-1] if turned else np.asarray(ring.faces)
    vertices = np.concatenate([ball.vertices, np.asarray(ring.vertices) + [0.01, 0.0, 0.0]])
    faces = np.concatenate([ball.faces, faces + len(ball.vertices)]).astype(np.int64)
    mesh, _ = mesh_features(vertices, faces, closed=True)
    points = np.random.default_rng(1).uniform(-0.07, 0.07, (1500, 3))
    winding, found = np.empty(len(points)), np.empty(len(points), dtype=bool)
    winding_numbers(np.ascontiguousarray(vertices[faces]), points, winding)
    surrounded(mesh, points, found)
    np.testing.assert_array_equal(found, winding > 0.5)
    assert set(np.round(winding)) == ({-1.0, 0.0, 1.0} if turned else {0.0, 1.0, 2.0})


def test_two_rays_outvote_one_that_meets_a_corner() -> None:
    # The first ray from the middle goes through a corner, which all or none of its four faces have.
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    middles = [[0.0, 0.0, -1.0], (np.array(DIRECTIONS[0]) / max(DIRECTIONS[0])).tolist()]
    vertices = [[x, y, z] for z in (-1.0, 1.0) for x, y in square] + middles
    faces = []
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 0)):
        faces += [[i, j, j + 4], [i, j + 4, i + 4], [j, i, 8], [i + 4, j + 4, 9]]
    mesh, _ = mesh_features(0.05 * np.array(vertices), np.array(faces), closed=True)
    points, found = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.06], [0.06, 0.0, 0.0]]), np.empty(3, dtype=bool)
    surrounded(mesh, points, found)
    np.testing.assert_array_equal(found, [True, False, False])
