"""The rigid pieces of a hand: against the kinematics of the kernels, and against the hand's surface in one piece."""

from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.render.hand_meshes import PIECES, piece_poses, piece_surfaces
from hhsim.render.triangle_soup import hand_surface

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
    configuration = [values[7] for values in motion(3)]
    poses = piece_poses(hand, *(values[None] for values in configuration))
    rotation = Rotation.from_quat(poses.quaternion[0], scalar_first=True)
    joints = hand.joints(*configuration)
    surfaces = piece_surfaces(hand)
    assert len(surfaces) == len(PIECES) == 16
    assert PIECES[0] == "thumb/proximal"
    assert PIECES[15] == "palm"
    moved = [rotation[k].apply(surface.points) + poses.translation[0, k] for k, surface in enumerate(surfaces)]
    for k, points in enumerate(moved[:15]):
        f, phalanx = divmod(k, 3)
        ends = joints[f, phalanx], joints[f, phalanx + 1]
        radius = hand.radius[f, phalanx : phalanx + 2].tolist()
        assert np.abs(round_cone_distance(points, *ends, *radius)).max() < 1e-12
        np.testing.assert_allclose(np.linalg.norm(surfaces[k].normals, axis=1), 1.0, atol=1e-12)
    whole = hand_surface(hand, *configuration)
    np.testing.assert_allclose(moved[15], whole.points[: len(moved[15])], atol=1e-14)
