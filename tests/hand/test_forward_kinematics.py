"""A placed hand agrees with the model, tick by tick."""

import numpy as np
from scipy.spatial.transform import Rotation

from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix


def test_joints_are_those_of_the_model() -> None:
    hand, rng = HandModel.default(), np.random.default_rng(0)
    position = rng.normal(size=(4, 3))
    orientation = Rotation.random(4, rng=1).as_quat(scalar_first=True)
    flexion, abduction = rng.uniform(0.0, 1.0, (4, 5, 3)), rng.uniform(-0.1, 0.1, (4, 5))
    placed = forward_kinematics(hand, position, orientation, flexion, abduction)
    for t in range(4):
        expected = hand.joints(position[t], orientation[t], flexion[t], abduction[t])
        assert np.array_equal(placed.joints[t], expected)
    assert np.array_equal(placed.points[:, 20], position)
    assert np.array_equal(placed.points[2, 7], placed.joints[2, 1, 3])
    assert np.array_equal(placed.ends[1, :5], placed.joints[1, :, 3])
    assert np.array_equal(placed.ends[1, 5], position[1])
    some = placed.at([2, 0])
    assert np.array_equal(some.joints, placed.joints[[2, 0]])
    assert np.array_equal(some.orientation, orientation[[2, 0]])
    np.testing.assert_allclose(
        rotation_matrix(orientation), Rotation.from_quat(orientation, scalar_first=True).as_matrix()
    )


def test_the_shape_is_that_of_the_model() -> None:
    hand = HandModel.default()
    shape = hand_shape(hand)
    assert np.array_equal(shape.phalanx_radius, hand.radius)
    assert np.array_equal(shape.palm_center, hand.palm_tree.leaf_center)
    assert np.array_equal(shape.palm_radius, hand.palm_tree.leaf_radius)
