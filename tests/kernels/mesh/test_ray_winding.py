"""What closed triangles go around, by three rays, against the winding number by solid angles."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from hhsim.kernels.jit import jit_allocating
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.mesh.ray_winding import DIRECTIONS, is_surrounded
from hhsim.kernels.mesh.winding_number import winding_numbers
from hhsim.kernels.sphere_tree import STACK_SIZE
from hhsim.mesh.features import mesh_features


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
    points = np.random.default_rng(1).uniform(-0.07, 0.07, (4000, 3))
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
