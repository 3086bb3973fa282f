"""Inside and outside of what is closed by winding number."""

import numpy as np

from hhsim.kernels.mesh.bvh import build_mesh_bvh, winding_moments
from hhsim.kernels.mesh.inside_field import SolidField, leave_inside
from tools.shapes.generators import cube

CUBE = cube(0.07)


def test_a_hole_is_left_where_the_winding_number_is_one_half() -> None:
    top = (CUBE.triangles[:, :, 2] > 0.0).all(axis=1)
    walls = build_mesh_bvh(CUBE.vertices, CUBE.faces[~top], signed=False)
    start, share = np.array([[0.0, 0.0, 0.0], [0.001, 0.002, -0.02]]), np.empty(2)
    leave_inside(SolidField(walls, winding_moments(walls)), start, start + [0.0, 0.0, 0.1], share)
    # From the plane of a hole its edge hides just half of all directions.
    np.testing.assert_allclose(start[:, 2] + 0.1 * share, 0.035, atol=1e-3)
