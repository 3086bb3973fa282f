"""Repair by a penalty: its gradient by central differences, and the depth that it leaves."""

import numpy as np
import pytest
from field_hands import box

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.field.hands import object_bvh
from hhsim.metrics.mesh_penetration import mesh_clearance
from tools.penalty_repair import _objective, penalty_repair

HAND = HandModel.default()
POSTURE = HandConfiguration(
    np.array([[0.0, -0.09, 0.055]]), np.array([[1.0, 0.0, 0.0, 0.0]]), np.full((1, 5, 3), 0.2), np.zeros((1, 5))
)
"""A hand whose fingers are some millimetres inside the top of a box."""


def clearance(posture: HandConfiguration) -> float:
    return float(mesh_clearance(object_bvh(MESH), hand_shape(HAND), forward_kinematics(HAND, *posture))[0])


MESH = box()


def test_the_gradient_is_that_of_central_differences() -> None:
    at = np.concatenate([np.zeros(6), np.full(15, 0.2), np.zeros(5)]) + 1e-3
    target = forward_kinematics(HAND, *POSTURE).points[0]
    given = HAND, POSTURE, target, object_bvh(MESH), 100.0
    steps = 1e-6 * np.eye(26)
    central = [(_objective(at + step, *given)[0] - _objective(at - step, *given)[0]) / 2e-6 for step in steps]
    found = _objective(at, *given)[1]
    assert np.abs(found).max() > 0.1
    assert found == pytest.approx(np.array(central), abs=1e-4 * np.abs(found).max())


def test_a_penalty_leaves_a_depth_that_a_larger_weight_lessens() -> None:
    depths = [-clearance(POSTURE)]
    for weight in (10.0, 1000.0):
        repaired, seconds = penalty_repair(HAND, MESH, POSTURE, weight)
        assert seconds.shape == (1,)
        depths.append(-clearance(repaired))
    assert depths[0] > 0.003
    assert depths[0] > depths[1] > depths[2] > 0.0
