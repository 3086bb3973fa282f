"""Many hands placed in one compiled call."""

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays, forward_kinematics
from hhsim.kernels.jit import Array, jit_allocating


@jit_allocating
def place_hands(
    hand: HandArrays, position: Array, rotation: Array, flexion: Array, abduction: Array, joints: Array
) -> None:
    """Joint and tip positions [m], world, of every configuration.

    Args:
        hand: The hand.
        position: Palm origin [m], shape (T, 3).
        rotation: Palm to world, shape (T, 3, 3).
        flexion: [rad], shape (T, 5, 3).
        abduction: [rad], shape (T, 5).
        joints: Written, shape (T, 5, 4, 3).
    """
    direction = np.empty((FINGER_COUNT, PHALANX_COUNT, 3))
    flexion_axis, abduction_axis = np.empty((FINGER_COUNT, 3)), np.empty((FINGER_COUNT, 3))
    for t in range(position.shape[0]):
        forward_kinematics(
            hand, position[t], rotation[t], flexion[t], abduction[t], joints[t], direction, flexion_axis, abduction_axis
        )
