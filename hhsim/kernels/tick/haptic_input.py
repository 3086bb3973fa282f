"""Input of a tick: the haptic hand."""

import math

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import farthest_joint, is_finite_configuration, update_kinematics
from hhsim.kernels.jit import Array, Record, jit_inline
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID


@jit_inline
def set_haptic(
    hand: HandArrays, position: Array, orientation: Array, flexion: Array, abduction: Array, state: Record
) -> int:
    """Take the new haptic configuration and return 0, or keep the old one: STATUS_INPUT_INVALID if it is not finite."""
    haptic, sample = state.haptic, state.input
    sample.previous_motion = sample.motion
    sample.motion = 0.0
    sample.is_valid = is_finite_configuration(position, orientation, flexion, abduction)
    if not sample.is_valid:
        return STATUS_INPUT_INVALID
    square = 0.0
    for i in range(4):
        square += orientation[i] * orientation[i]
    scale = 1.0 / math.sqrt(square)
    for i in range(3):
        haptic.position[i] = position[i]
    for i in range(4):
        haptic.orientation[i] = orientation[i] * scale
    for f in range(FINGER_COUNT):
        haptic.abduction[f] = abduction[f]
        for k in range(PHALANX_COUNT):
            haptic.flexion[f, k] = flexion[f, k]
    # Not by `copy_values`: its one loop over three axes takes 4 µs beside the arrays of a mesh, a third of a tick.
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            for i in range(3):
                sample.joints[f, k, i] = haptic.joints[f, k, i]
    update_kinematics(hand, haptic)
    sample.motion = farthest_joint(sample.joints, haptic.joints)
    return 0
