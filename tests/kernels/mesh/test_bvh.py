"""The mesh BVH against brute force over all triangles, and its sign against ray casting."""

import numpy as np
import pytest
import trimesh

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.bvh import build_mesh_bvh, closest_points, mesh_signed_distance


def arrays(shape: trimesh.Trimesh) -> tuple[FloatArray, IntArray]:
    return np.array(shape.vertices, dtype=np.float64), np.array(shape.faces, dtype=np.int64)


SHAPES = {
    "icosphere": trimesh.creation.icosphere(3, 0.05),
    "box": trimesh.creation.box((0.1, 0.06, 0.02)),
    "cylinder": trimesh.creation.cylinder(0.03, 0.1, sections=48),
    "torus": trimesh.creation.torus(0.04, 0.012),
}


@pytest.fixture(params=SHAPES, scope="module")
def shape(request: pytest.FixtureRequest) -> trimesh.Trimesh:
    chosen: trimesh.Trimesh = SHAPES[request.param]
    return chosen


def brute_force(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    # trimesh has absolute tolerances: a mesh in millimetres keeps small triangles above them.
    triangles, distances = 1e3 * vertices[faces], []
    for p in 1e3 * points:
        closest = trimesh.triangles.closest_point(triangles, np.tile(p, (len(faces), 1)))  # type: ignore[no-untyped-call]
        distances.append(np.linalg.norm(closest - p, axis=1).min())
    return 1e-3 * np.array(distances)


def test_is_the_brute_force_distance_with_the_sign_of_ray_casting(shape: trimesh.Trimesh) -> None:
    vertices, faces = arrays(shape)
    points = np.random.default_rng(1).uniform(1.3 * vertices.min(axis=0), 1.3 * vertices.max(axis=0), (200, 3))
    bvh = build_mesh_bvh(vertices, faces)
    signed = mesh_signed_distance(bvh, points)
    assert np.abs(np.abs(signed) - brute_force(vertices, faces, points)).max() < 1e-12
    inside = np.asarray(shape.contains(points))
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
