"""Inside and outside by winding number and by sheets, and straight lines through both."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import BoolArray, FloatArray
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals
from hhsim.kernels.mesh.inside_field import SolidField, count_hits, inside, leave_inside, near
from hhsim.kernels.mesh.winding_number import winding_moments
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import face_samples
from tools.shapes.generators import cube, sphere

NOTHING = build_mesh_bvh(np.zeros((1, 3)), np.zeros((1, 3), np.int64), signed=False)


def solid(mesh: Mesh) -> SolidField:
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces, signed=False)
    return SolidField(bvh, winding_moments(bvh), NOTHING, -1.0)


def sheet(mesh: Mesh, half: float) -> SolidField:
    return SolidField(NOTHING, winding_moments(NOTHING), build_mesh_bvh(mesh.vertices, mesh.faces, signed=False), half)


def within(field: SolidField, points: FloatArray) -> BoolArray:
    result = np.empty(len(points), np.bool_)
    inside(field, np.ascontiguousarray(points), result)
    return result


def shares(field: SolidField, start: FloatArray, end: FloatArray) -> FloatArray:
    result = np.empty(len(start))
    leave_inside(field, np.ascontiguousarray(start), np.ascontiguousarray(end), result)
    return result


def test_a_cube_is_inside_by_its_coordinates() -> None:
    points = np.random.default_rng(0).uniform(-0.05, 0.05, size=(3000, 3))
    np.testing.assert_array_equal(within(solid(cube(0.07)), points), (np.abs(points) < 0.035).all(axis=1))


def test_a_sheet_is_inside_by_its_distance() -> None:
    field = sheet(cube(0.07), 0.004)
    points = np.random.default_rng(1).uniform(-0.05, 0.05, size=(3000, 3))
    out = np.linalg.norm(np.maximum(np.abs(points) - 0.035, 0.0), axis=1)
    deep = 0.035 - np.abs(points).max(axis=1)
    np.testing.assert_array_equal(within(field, points), np.where(out > 0.0, out, deep) < 0.004)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_segments_meet_as_many_triangles_as_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corner = rng.normal(size=(60, 3, 3))
    start, along = rng.normal(size=(20, 3)), rng.normal(size=(20, 3)) * 3.0
    counts = np.empty(20, np.int64)
    bvh = build_mesh_bvh(corner.reshape(-1, 3), np.arange(180).reshape(-1, 3), signed=False)
    count_hits(bvh, start, along, counts)
    # By solving for the weights of the corners and the share of the segment.
    matrix = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    expected = []
    for p, d in zip(start, along):
        system = np.concatenate([matrix, np.broadcast_to(-d[:, None], (60, 3, 1))], axis=2)
        u, v, s = np.linalg.solve(system, (p - corner[:, 0])[:, :, None])[:, :, 0].T
        expected.append(int(((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (s > 0.0) & (s < 1.0)).sum()))
    np.testing.assert_array_equal(counts, expected)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_a_cube_is_left_at_its_faces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.03, 0.03, size=(20, 3))
    way = rng.normal(size=(20, 3))
    end = start + way * (0.2 / np.abs(way).max(axis=1))[:, None]
    found = start + shares(solid(cube(0.07)), start, end)[:, None] * (end - start)
    np.testing.assert_allclose(np.abs(found).max(axis=1), 0.035, atol=1e-12)


def test_a_hole_is_left_where_the_winding_number_is_one_half() -> None:
    mesh = cube(0.07)
    top = (mesh.triangles[:, :, 2] > 0.0).all(axis=1)
    open_box = Mesh(mesh.vertices, mesh.faces[~top])
    start = np.array([[0.0, 0.0, 0.0], [0.001, 0.002, -0.02]])
    end = start + np.array([0.0, 0.0, 0.1])
    found = start + shares(solid(open_box), start, end)[:, None] * (end - start)
    # From the plane of a hole its edge hides just half of all directions.
    np.testing.assert_allclose(found[:, 2], 0.035, atol=1e-3)


def test_a_sheet_is_left_half_its_thickness_away() -> None:
    field = sheet(sphere(0.08, subdivisions=4), 0.003)
    way = np.random.default_rng(2).normal(size=(50, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    start, end = 0.04 * way, 0.05 * way
    found = start + shares(field, start, end)[:, None] * (end - start)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 0.043, atol=5e-5)


def test_near_is_a_distance() -> None:
    points = np.array([[0.0, 0.0, 0.036], [0.0, 0.0, 0.0381], [0.0, 0.0, 0.0]])
    found = np.empty(3, np.bool_)
    near(solid(cube(0.07)).bvh, points, 0.002, found)
    assert found.tolist() == [True, False, False]


def test_samples_lie_on_their_faces_and_stand_for_all_the_area() -> None:
    mesh = cube(0.07)
    point, face, area = face_samples(mesh.vertices, mesh.faces, 500, np.random.default_rng(0))
    assert area.sum() == pytest.approx(6.0 * 0.07**2)
    np.testing.assert_allclose(np.abs(point).max(axis=1), 0.035)
    assert np.bincount(face, minlength=12).min() >= 40
    normal = face_normals(mesh.vertices, mesh.faces)[face]
    np.testing.assert_allclose(np.einsum("ij,ij->i", point - mesh.triangles[face, 0], normal), 0.0, atol=1e-15)
