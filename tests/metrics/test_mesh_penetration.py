"""The hand against the true mesh: against the hand's own surface, point by point, and against trimesh."""

import numpy as np
import pytest
import trimesh
from sphere_scenes import bumpy_ball

from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.kernels.mesh.winding_number import winding_numbers
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.mesh_penetration import contact_error, mesh_clearance
from hhsim.render.triangle_soup import hand_surface


def over(hand: HandModel, height: float, ticks: int = 1) -> PlacedHand:
    """An open hand, palm down, over the origin."""
    return forward_kinematics(
        hand,
        np.tile([0.0, -0.06, height], (ticks, 1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (ticks, 1)),
        np.full((ticks, 5, 3), 0.2),
        np.zeros((ticks, 5)),
    )


@pytest.mark.parametrize("name", ["bunny", "teapot"])
def test_depth_is_that_of_the_deepest_point_of_the_surface(name: str) -> None:
    hand, mesh = HandModel.default(), load_object(name).mesh
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    top = float(mesh.bounds[1, 2])
    depths = []
    for height in np.linspace(top, top + 0.05, 26):
        placed = over(hand, float(height))
        depth = -mesh_clearance(bvh, hand_shape(hand), placed)[0]
        if not 0.0 < depth < 0.003:
            continue
        surface = hand_surface(
            hand, placed.position[0], placed.orientation[0], np.full((5, 3), 0.2), np.zeros(5), hybrid=True
        )
        points = surface.points.copy()
        deepest = float(-mesh_signed_distance(bvh, points).min())
        # The surface is sampled about 1 mm apart on radii of 5 mm and more: 0.05 mm flatter at worst.
        assert deepest <= depth + 1e-6
        assert depth - deepest < 1e-4
        winding = np.empty(1)
        row = points[mesh_signed_distance(bvh, points).argmin()]
        winding_numbers(mesh.triangles, row[None].copy(), winding)
        assert winding[0] == pytest.approx(1.0 if deepest > 0.0 else 0.0, abs=1e-6)
        depths.append(depth)
    assert len(depths) >= 1


def test_a_pose_that_is_not_finite_has_no_depth() -> None:
    hand = HandModel.default()
    mesh = load_object("cube").mesh
    placed = over(hand, 0.08, 3)
    placed.position[1, 2] = np.nan
    found = mesh_clearance(build_mesh_bvh(mesh.vertices, mesh.faces), hand_shape(hand), placed)
    assert np.isnan(found).tolist() == [False, True, False]
    assert found[0] == found[2]


def test_contact_points_lie_on_the_hand_and_on_the_spheres() -> None:
    hand, tree = HandModel.default(), bumpy_ball(2000)
    shape = hand_shape(hand)
    arrays = tree.arrays()
    low, high = 0.0, 0.2
    for _ in range(60):
        middle = 0.5 * (low + high)
        near = find_contact_points(arrays, shape, over(hand, middle), 0.0).point
        low, high = (middle, high) if len(near) else (low, middle)
    placed = over(hand, high, 2)
    placed.position[1] += 1.0
    placed.joints[1] += 1.0
    found = find_contact_points(arrays, shape, placed, 1e-5)
    touching, away = (found.point[found.tick == tick] for tick in range(2))
    assert len(touching) >= 1
    assert len(away) == 0
    gap = np.linalg.norm(touching[:, None] - tree.leaf_center, axis=2) - tree.leaf_radius
    assert np.abs(gap.min(axis=1)).max() < 1.1e-5


def test_more_points_than_there_is_room_for_first() -> None:
    hand, tree = HandModel.default(), bumpy_ball(4000)
    points = find_contact_points(tree.arrays(), hand_shape(hand), over(hand, 0.0), 0.02).point
    assert len(points) > 4096


def test_contact_error_is_the_distance_from_the_mesh() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    bvh = build_mesh_bvh(np.array(box.vertices, np.float64), np.array(box.faces, np.int64))
    found = contact_error(bvh, np.array([[0.0, 0.0, 0.051], [0.0, 0.01, 0.048], [0.05, 0.05, 0.05]]))
    assert found == pytest.approx([1e-3, 2e-3, 0.0], abs=1e-12)
    assert contact_error(bvh, np.zeros((0, 3))).shape == (0,)
