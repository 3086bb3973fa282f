"""How far a mesh sticks out of spheres, against a closed form; and of a mesh that no file should hold."""

import numpy as np
import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh.mesh import LARGEST_NUMBER
from hhsim.verify.file_checks import outside_spheres

BOX = trimesh.creation.box((0.2, 0.2, 0.2))


def test_the_corners_of_a_box_stick_out_of_the_ball_within() -> None:
    gap = outside_spheres(np.array(BOX.vertices), np.array(BOX.faces), np.zeros((1, 3)), np.array([0.1]))
    assert gap.max() == pytest.approx(0.1 * (np.sqrt(3.0) - 1.0), abs=1e-12)
    assert gap.min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("far", [1e300, 2.0 * LARGEST_NUMBER])
def test_a_vertex_that_no_number_reaches_sticks_out(far: float) -> None:
    vertices = np.array(BOX.vertices)
    vertices[3, 1] = far
    gap = outside_spheres(vertices, np.array(BOX.faces), np.zeros((1, 3)), np.array([0.1]))
    assert gap.max() == np.inf


def test_triangles_of_vertices_that_are_not_there_are_no_mesh() -> None:
    with pytest.raises(MeshError, match="name a vertex that does not exist"):
        outside_spheres(np.array(BOX.vertices), np.array([[0, 1, 2**46]]), np.zeros((1, 3)), np.array([0.1]))
