"""Surfaces cut at a box: areas and volumes as they are by other means, whatever the size of the triangles."""

import numpy as np
import pytest
import trimesh

from hhsim.mesh.mesh import Mesh
from hhsim.render.triangle_soup import FAR, NEAR, Surface, clipped, mesh_surface, near_hands

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
