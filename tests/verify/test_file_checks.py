"""How far a mesh sticks out of spheres, against a closed form; a mesh that is none; figures that differ."""

import math

import numpy as np
import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh.mesh import LARGEST_NUMBER
from hhsim.verify.claim import told_apart
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


@pytest.mark.parametrize(
    ("stored", "own", "told"),
    [
        (1.0, 1.20323, ("1", "1.20323")),
        (0.0014028467, 0.0014028469, ("0.0014028467", "0.0014028469")),
        (1.0, math.nextafter(1.0, 2.0), ("1", "1.0000000000000002")),
        (math.nan, 0.5, ("nan", "0.5")),
    ],
)
def test_two_figures_that_differ_read_as_two(stored: float, own: float, told: tuple[str, str]) -> None:
    assert told_apart(stored, own) == told
