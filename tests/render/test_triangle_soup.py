"""Surfaces for pictures: the bodies that collide, with outward normals, arrows, and cuts at a box."""

import numpy as np
import pytest
import trimesh
from mesh_oracle import to_cone

from hhsim.hand.model import HandModel
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.render.triangle_soup import (
    FAR,
    NAIL,
    NEAR,
    SKIN,
    SPHERE,
    Surface,
    arrow_surface,
    clipped,
    hand_surface,
    joined,
    mesh_surface,
    near_hands,
    painted,
)
from hhsim.render.triangle_soup import round_cone_surface as cone
from tools.shapes.generators import cube

IDENTITY = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("tip", [0.01, 0.006])
@pytest.mark.parametrize("end", [(0.03, 0.01, -0.02), (0.0, 0.0, 0.0)])
def test_surface_is_the_round_cones(tip: float, end: tuple[float, float, float]) -> None:
    a, b = np.zeros(3), np.array(end)
    tip = 0.01 if not b.any() else tip
    surface = cone(a, b, 0.01, tip, SKIN)
    for away in (0.0, 0.001):
        distance = to_cone(surface.points + away * surface.normals, a, b, 0.01, tip)
        np.testing.assert_allclose(distance, away, rtol=0.0, atol=1e-15)


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


STONE = np.array([0.8, 0.8, 0.78])


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return mesh_surface(Mesh(mesh.vertices, mesh.faces, "shape", "shape"), STONE)


def area(surface: Surface) -> float:
    a, b, c = surface.points[surface.faces].transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_door_without_a_corner_near_is_cut_to_the_box() -> None:
    door = surface_of(trimesh.creation.box((0.9, 0.04, 2.0)))
    part = clipped(door, (-0.2, -0.3, -0.1), (0.1, 0.3, 0.5))
    np.testing.assert_allclose(part.points[part.faces].reshape(-1, 3).min(axis=0), (-0.2, -0.02, -0.1), atol=1e-12)
    np.testing.assert_allclose(part.points[part.faces].reshape(-1, 3).max(axis=0), (0.1, 0.02, 0.5), atol=1e-12)
    # Of the six sides only the front and the back go through the box.
    assert area(part) == pytest.approx(2 * 0.3 * 0.6)


def test_corners_keep_their_order_and_normals_their_length() -> None:
    ball = surface_of(trimesh.creation.icosphere(2, 0.05))
    part = clipped(ball, (-0.02, -0.02, -0.02), (0.03, 0.1, 0.1))
    a, b, c = part.points[part.faces].transpose(1, 0, 2)
    outward = np.cross(b - a, c - a)
    large = np.linalg.norm(outward, axis=1) > 1e-12
    assert (np.einsum("ni,ni->n", outward, a + b + c)[large] > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-9)


def test_what_is_inside_stays_and_what_is_outside_goes() -> None:
    ball = surface_of(trimesh.creation.icosphere(2, 0.05))
    assert clipped(ball, (-1.0,) * 3, (1.0,) * 3) is ball
    assert len(clipped(ball, (0.5,) * 3, (1.0,) * 3).faces) == 0


def test_a_large_object_is_cut_near_the_hands_and_a_small_one_is_whole() -> None:
    hands = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]])
    size = np.linalg.norm(hands[1] - hands[0])
    door = surface_of(trimesh.creation.box((0.9, 0.04, 2.0)))
    part = near_hands(door, hands)
    corners = part.points[part.faces].reshape(-1, 3)
    np.testing.assert_allclose(corners[:, 2].min(), -NEAR * size, atol=1e-12)
    np.testing.assert_allclose(corners[:, 2].max(), 0.1 + NEAR * size, atol=1e-12)
    ball = surface_of(trimesh.creation.icosphere(1, FAR * size - 1e-3))
    assert near_hands(ball, hands) is ball
    # A hand that is nowhere near it is shown with all of it.
    assert near_hands(door, hands + 50.0) is door
