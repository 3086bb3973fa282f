"""Surfaces for pictures: the bodies that collide, with outward normals, arrows, and cuts at a box."""

from typing import Literal

import numpy as np
import pytest
import trimesh
from mesh_oracle import to_cone
from scipy.spatial.transform import Rotation

from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.render.triangle_soup import (
    FAR,
    NEAR,
    PIECES,
    SKIN,
    arrow_surface,
    clipped,
    hand_surface,
    mesh_surface,
    near_hands,
    piece_poses,
    piece_surfaces,
)
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


TICKS = 40


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    orientation = random.normal(size=(TICKS, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    flexion = random.uniform(-0.5, 1.7, (TICKS, 5, 3))
    return random.normal(size=(TICKS, 3)), orientation, flexion, random.uniform(-0.6, 0.8, (TICKS, 5))


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_pieces_are_where_the_kinematics_put_them(side: Literal["right", "left"]) -> None:
    hand = HandModel.default(side)
    position, orientation, flexion, abduction = motion()
    poses = piece_poses(hand, position, orientation, flexion, abduction)
    placed = forward_kinematics(hand, position, orientation, flexion, abduction)
    np.testing.assert_allclose(poses.translation[:, :15].reshape(TICKS, 5, 3, 3), placed.joints[:, :, :3], atol=1e-14)
    np.testing.assert_array_equal(poses.translation[:, 15], position)
    np.testing.assert_allclose(np.linalg.norm(poses.quaternion, axis=2), 1.0, atol=1e-14)
    rotation = Rotation.from_quat(poses.quaternion.reshape(-1, 4), scalar_first=True)
    along = rotation.apply([0.0, 1.0, 0.0]).reshape(TICKS, 16, 3)
    lengths = hand.length.reshape(15, 1)
    ends = placed.joints[:, :, 1:].reshape(TICKS, 15, 3)
    np.testing.assert_allclose(poses.translation[:, :15] + lengths * along[:, :15], ends, atol=1e-14)
    # Out of the back at zero angles is the model's own direction.
    rest = piece_poses(hand, np.zeros((1, 3)), [[1.0, 0.0, 0.0, 0.0]], np.zeros((1, 5, 3)), np.zeros((1, 5)))
    back = Rotation.from_quat(rest.quaternion[0], scalar_first=True).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(back[:15], np.repeat(hand.dorsal, 3, axis=0), atol=1e-14)


def test_the_pieces_together_are_the_hand() -> None:
    hand = HandModel.default()
    position, orientation, *angles = (values[7] for values in motion(3))
    joints = hand.joints(position, orientation, *angles)
    surfaces = piece_surfaces(hand)
    assert (len(surfaces), PIECES[0], PIECES[15]) == (len(PIECES), "thumb/proximal", "palm")
    whole = hand_surface(hand, (position, orientation, *angles), surfaces)
    ends = np.cumsum([len(surface.points) for surface in surfaces])
    np.testing.assert_allclose(np.linalg.norm(whole.normals, axis=1), 1.0, atol=1e-12)
    for k, points in enumerate(np.split(whole.points, ends[:-1])[:15]):
        f, phalanx = divmod(k, 3)
        radius = hand.radius[f, phalanx : phalanx + 2].tolist()
        distance = round_cone_distance(points, joints[f, phalanx], joints[f, phalanx + 1], *radius)
        assert np.abs(distance).max() < 1e-12
    palm = Rotation.from_quat(orientation, scalar_first=True).apply(surfaces[15].points) + position
    np.testing.assert_allclose(whole.points[ends[14] :], palm, atol=1e-14)
