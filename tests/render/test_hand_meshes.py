"""The rigid pieces of a hand: against the kinematics of the kernels, and all of them as its surface."""

from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.render.triangle_soup import PIECES, hand_surface, piece_poses, piece_surfaces

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
