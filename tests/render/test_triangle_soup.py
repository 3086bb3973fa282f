"""Surfaces for pictures.

They are the bodies that collide, their normals point outwards, arrows end where they should.
"""

import numpy as np
import pytest

from hhsim.hand.model import HandModel
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.round_cone_distance import sphere_round_cone_distance
from hhsim.mesh.catalogue import load_object
from hhsim.render.triangle_soup import NAIL, SKIN, SPHERE, arrow_surface, hand_surface, joined, mesh_surface, painted
from hhsim.render.triangle_soup import round_cone_surface as cone
from tools.shapes.generators import cube, sphere

IDENTITY = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("tip", [0.01, 0.006])
@pytest.mark.parametrize("end", [(0.03, 0.01, -0.02), (0.0, 0.0, 0.0)])
def test_surface_is_the_round_cones(tip: float, end: tuple[float, float, float]) -> None:
    a, b = np.zeros(3), np.array(end)
    tip = 0.01 if not b.any() else tip
    surface = cone(a, b, 0.01, tip, SKIN)
    for point, normal in zip(surface.points, surface.normals):
        distance, _ = sphere_round_cone_distance(point, 0.0, a, b, 0.01, tip)
        outside, _ = sphere_round_cone_distance(point + 0.001 * normal, 0.0, a, b, 0.01, tip)
        assert abs(distance) < 1e-16 + 1e-15
        assert outside == pytest.approx(0.001, abs=1e-15)


def test_a_smooth_mesh_is_shaded_smoothly() -> None:
    surface = mesh_surface(sphere(), SKIN)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, rtol=1e-12)
    radial = surface.points / np.linalg.norm(surface.points, axis=1, keepdims=True)
    assert (np.einsum("vi,vi->v", surface.normals, radial) > 0.999).all()


def test_a_sharp_edge_stays_sharp() -> None:
    surface = mesh_surface(cube(), SKIN)
    np.testing.assert_allclose(np.sort(np.abs(surface.normals), axis=1), np.tile((0.0, 0.0, 1.0), (36, 1)), atol=1e-12)
    a, b, c = surface.points[surface.faces].transpose(1, 0, 2)
    facing = np.cross(b - a, c - a)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    np.testing.assert_allclose(surface.normals.reshape(-1, 3, 3), np.repeat(facing[:, None], 3, axis=1), atol=1e-12)


def test_a_corner_is_smooth_over_the_faces_of_its_vertex_that_lie_flat_enough() -> None:
    mesh = load_object("cup").mesh
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    surface = mesh_surface(mesh, SKIN, crease=40.0)
    np.testing.assert_array_equal(surface.points.reshape(-1, 3, 3), mesh.triangles)
    for corner in range(0, mesh.faces.size, 7):
        around = np.flatnonzero((mesh.faces == mesh.faces.flat[corner]).any(axis=1))
        flat = around[unit[around] @ unit[corner // 3] > np.cos(np.radians(40.0))]
        expected = area[flat].sum(axis=0)
        np.testing.assert_allclose(surface.normals[corner], expected / np.linalg.norm(expected), atol=1e-12)


def test_joined_surfaces_keep_their_triangles() -> None:
    first, second = cone(np.zeros(3), np.zeros(3), 0.01, 0.01, SKIN), mesh_surface(cube(), SPHERE)
    both = joined([first, second])
    triangles = both.points[both.faces]
    np.testing.assert_array_equal(triangles[: len(first.faces)], first.points[first.faces])
    np.testing.assert_array_equal(triangles[len(first.faces) :], second.points[second.faces])
    assert (both.colors[both.faces[len(first.faces) :]] == SPHERE).all()
    assert (painted(both, NAIL).colors == NAIL).all()


def test_the_hand_is_drawn_where_it_is() -> None:
    hand = HandModel.default()
    position, orientation = np.array([0.1, -0.2, 0.3]), np.array([0.5, -0.5, 0.5, 0.5])
    flexion, abduction = np.full((5, 3), 0.3), np.zeros(5)
    at_home = hand_surface(hand, np.zeros(3), IDENTITY, flexion, abduction)
    moved = hand_surface(hand, position, orientation, flexion, abduction)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(orientation, rotation)
    palm = slice(3 * len(hand.palm_mesh.faces))
    np.testing.assert_allclose(moved.points[palm], at_home.points[palm] @ rotation.T + position, atol=1e-15)
    np.testing.assert_allclose(moved.normals[palm], at_home.normals[palm] @ rotation.T, atol=1e-12)
    tip = hand.joints(position, orientation, flexion, abduction)[1, 3]
    nearest = np.linalg.norm(moved.points - tip, axis=1)
    assert np.isclose(nearest, hand.radius[1, 3], rtol=1e-12).any()


@pytest.mark.parametrize("flexion", [0.1, 0.0, -0.1])
@pytest.mark.parametrize("finger", range(1, 5))
def test_nails_are_on_the_backs_of_the_fingertips(finger: int, flexion: float) -> None:
    hand = HandModel.default()
    pose = np.zeros(3), IDENTITY, np.full((5, 3), flexion), np.zeros(5)
    surface = hand_surface(hand, *pose)
    tip = hand.joints(*pose)[finger, 3]
    near = np.linalg.norm(surface.points - tip, axis=1) < 2.0 * hand.radius[finger, 3]
    nail = near & (surface.colors == NAIL).all(axis=1)
    assert nail.sum() > 100
    # A straight hand's backs are up.
    assert surface.points[nail][:, 2].mean() > tip[2] + 0.3 * hand.radius[finger, 3]


def test_hybrid_shows_spheres() -> None:
    for hybrid in (False, True):
        surface = hand_surface(HandModel.default(), np.zeros(3), IDENTITY, np.zeros((5, 3)), np.zeros(5), hybrid)
        assert bool((surface.colors == SPHERE).all(axis=1).any()) is hybrid


@pytest.mark.parametrize("length", [0.05, 0.004])
def test_an_arrow_reaches_from_its_start_to_its_tip(length: float) -> None:
    start, direction = np.array([0.01, 0.02, 0.03]), np.array([0.6, 0.0, 0.8])
    surface = arrow_surface(start, length * direction, 0.001, SKIN)
    along = (surface.points - start) @ direction
    assert along.max() == pytest.approx(length, abs=3e-4)
    assert -0.002 < along.min() <= 0.0
    across = np.linalg.norm(surface.points - start - along[:, None] * direction, axis=1)
    assert across.max() <= 0.0025 + 1e-12
