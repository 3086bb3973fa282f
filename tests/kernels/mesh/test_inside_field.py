"""Inside and outside of what is closed by winding number, and of sheets by their thickness."""

import numpy as np

from hhsim.kernels.mesh.bvh import build_mesh_bvh, winding_moments
from hhsim.kernels.mesh.inside_field import SolidField, inside, leave_inside
from tools.shapes.generators import cube

NOTHING = build_mesh_bvh(np.zeros((1, 3)), np.zeros((1, 3), np.int64), signed=False)
CUBE = cube(0.07)


def test_a_sheet_is_inside_by_its_distance() -> None:
    walls = build_mesh_bvh(CUBE.vertices, CUBE.faces, signed=False)
    points, found = np.random.default_rng(1).uniform(-0.05, 0.05, size=(3000, 3)), np.empty(3000, np.bool_)
    inside(SolidField(NOTHING, winding_moments(NOTHING), walls, 0.004), points, found)
    out = np.linalg.norm(np.maximum(np.abs(points) - 0.035, 0.0), axis=1)
    deep = 0.035 - np.abs(points).max(axis=1)
    np.testing.assert_array_equal(found, np.where(out > 0.0, out, deep) < 0.004)


def test_a_hole_is_left_where_the_winding_number_is_one_half() -> None:
    top = (CUBE.triangles[:, :, 2] > 0.0).all(axis=1)
    walls = build_mesh_bvh(CUBE.vertices, CUBE.faces[~top], signed=False)
    start, share = np.array([[0.0, 0.0, 0.0], [0.001, 0.002, -0.02]]), np.empty(2)
    leave_inside(SolidField(walls, winding_moments(walls), NOTHING, -1.0), start, start + [0.0, 0.0, 0.1], share)
    # From the plane of a hole its edge hides just half of all directions.
    np.testing.assert_allclose(start[:, 2] + 0.1 * share, 0.035, atol=1e-3)
