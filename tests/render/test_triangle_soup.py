"""Surfaces for pictures: the bodies that collide, with outward normals, arrows, and cuts at a box."""

import numpy as np
import pytest
import trimesh
from mesh_oracle import to_cone

from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.render.triangle_soup import FAR, NEAR, SKIN, arrow_surface, clipped, mesh_surface, near_hands
from hhsim.render.triangle_soup import round_cone_surface as cone


@pytest.mark.parametrize("tip", [0.01, 0.006])
@pytest.mark.parametrize("end", [(0.03, 0.01, -0.02), (0.0, 0.0, 0.0)])
def test_surface_is_the_round_cones(tip: float, end: tuple[float, float, float]) -> None:
    a, b = np.zeros(3), np.array(end)
    tip = 0.01 if not b.any() else tip
    surface = cone(a, b, 0.01, tip, SKIN)
    for away in (0.0, 0.001):
        distance = to_cone(surface.points + away * surface.normals, a, b, 0.01, tip)
        np.testing.assert_allclose(distance, away, rtol=0.0, atol=1e-15)


@pytest.mark.soak
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


@pytest.mark.parametrize("length", [0.05, 0.004])
def test_an_arrow_reaches_from_its_start_to_its_tip(length: float) -> None:
    start, direction = np.array([0.01, 0.02, 0.03]), np.array([0.6, 0.0, 0.8])
    surface = arrow_surface(start, length * direction, 0.001, SKIN)
    along = (surface.points - start) @ direction
    assert along.max() == pytest.approx(length, abs=3e-4)
    assert -0.002 < along.min() <= 0.0
    across = np.linalg.norm(surface.points - start - along[:, None] * direction, axis=1)
    assert across.max() <= 0.0025 + 1e-12


def shape(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(solid.vertices, solid.faces, "shape", "shape")


def area(mesh: Mesh) -> float:
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_door_without_a_corner_near_is_cut_to_the_box() -> None:
    low, high = np.array([-0.2, -0.3, -0.1]), np.array([0.1, 0.3, 0.5])
    part = clipped(shape(trimesh.creation.box((0.9, 0.04, 2.0))), low, high)
    assert part is not None
    np.testing.assert_allclose(part.bounds, [(-0.2, -0.02, -0.1), (0.1, 0.02, 0.5)], atol=1e-12)
    # Of the six sides only the front and the back go through the box.
    assert area(part) == pytest.approx(2 * 0.3 * 0.6)
    assert clipped(part, high + 1.0, high + 2.0) is None


def test_a_large_object_is_cut_near_the_hands_and_a_small_one_is_whole() -> None:
    hands = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]])
    size = np.linalg.norm(hands[1] - hands[0])
    door = shape(trimesh.creation.box((0.9, 0.04, 2.0)))
    height = near_hands(door, hands).bounds[:, 2]
    np.testing.assert_allclose(height, (-NEAR * size, 0.1 + NEAR * size), atol=1e-12)
    ball = shape(trimesh.creation.icosphere(1, FAR * size - 1e-3))
    assert near_hands(ball, hands) is ball
    # A hand that is nowhere near it is shown with all of it.
    assert near_hands(door, hands + 50.0) is door
