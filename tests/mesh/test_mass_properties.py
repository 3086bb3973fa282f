"""Mass properties of closed meshes: against trimesh, formulas, motion, and meshes that enclose nothing."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hhsim.errors import MeshError
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh, mass_properties
from tools.shapes.generators import cube, sphere


@pytest.mark.parametrize("name", object_names())
def test_of_every_object_as_trimesh_has_them(name: str) -> None:
    item = load_object(name)
    found = mass_properties(item.mesh)
    other = trimesh.Trimesh(item.mesh.vertices, item.mesh.faces, process=False)
    assert found.volume == pytest.approx(other.volume, rel=1e-9)
    np.testing.assert_allclose(found.center, other.center_mass, atol=1e-12)
    np.testing.assert_allclose(found.inertia, other.moment_inertia, rtol=1e-9, atol=1e-9 * found.inertia.max())
    # Something that a hand lifts, on a skin that slips less than rubber.
    assert 0.02 < item.density * found.volume < 1.0
    assert 0.2 < item.friction < 0.9


def test_a_box_and_a_ball_by_their_formulas() -> None:
    box = mass_properties(cube(0.07).transformed(np.eye(3), [1.0, -2.0, 3.0]))
    np.testing.assert_allclose(box.center, [1.0, -2.0, 3.0], atol=1e-14)
    np.testing.assert_allclose(box.inertia, 0.07**5 / 6.0 * np.eye(3), rtol=1e-10, atol=1e-19)
    ball = mass_properties(sphere(0.1, subdivisions=5))
    # Its facets lie inside the ball: 0.04 % of its inertia over its volume.
    np.testing.assert_allclose(ball.inertia / ball.volume, 0.4 * 0.05**2 * np.eye(3), rtol=4e-4, atol=1e-12)


def test_they_move_with_the_mesh() -> None:
    mesh = load_object("cup").mesh
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([0.4, 0.1, -0.3])
    here, there = mass_properties(mesh), mass_properties(mesh.transformed(turn, shift))
    np.testing.assert_allclose(there.center, turn @ here.center + shift, atol=1e-14)
    np.testing.assert_allclose(there.inertia, turn @ here.inertia @ turn.T, rtol=1e-9, atol=1e-19)


def test_what_encloses_nothing_is_refused() -> None:
    box = cube(0.07)
    with pytest.raises(MeshError, match="not closed"):
        mass_properties(replace(box, faces=box.faces[1:]))
    sheet = Mesh(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]), name="sheet")
    with pytest.raises(MeshError, match="sheet: the triangles enclose 0 cm³"):
        mass_properties(sheet)
    with pytest.raises(MeshError, match="needs a solid, wound outward"):
        mass_properties(replace(box, faces=box.faces[:, ::-1]))
    loose = Mesh(box.triangles.reshape(-1, 3), np.arange(36).reshape(12, 3))
    assert mass_properties(loose).volume == pytest.approx(0.07**3)
