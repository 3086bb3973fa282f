"""Configuration of a hand with its kinematics, and changes from one configuration to another.

State that lives from tick to tick is one structured array: a kernel gets a single pointer, where a NamedTuple would
pass every array in it on every call.

Changes from hands to others, and hands after changes; numbers of a change as of `hhsim.repair.written_hand`.
"""

import math

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays, forward_kinematics
from hhsim.kernels.jit import Array, Record, jit, jit_inline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import quaternion_to_matrix, rotate_quaternion, rotation_vector_between

HAND_POSE = np.dtype(
    [
        ("position", np.float64, (3,)),  # palm origin [m]
        ("orientation", np.float64, (4,)),  # palm quaternion (w, x, y, z)
        ("flexion", np.float64, (5, 3)),  # joint angles [rad]
        ("abduction", np.float64, (5,)),  # [rad]
        ("rotation", np.float64, (3, 3)),  # palm to world, from orientation
        ("joints", np.float64, (5, 4, 3)),  # joint and tip sphere centres [m]
        ("direction", np.float64, (5, 3, 3)),  # unit axis of each phalanx
        ("axis", np.float64, (5, 3)),  # unit flexion axis of each finger
        ("abduction_axis", np.float64, (5, 3)),  # unit abduction axis of each finger
    ],
    align=True,
)
"""One configuration of the hand, world."""


@jit_inline
def update_kinematics(hand: HandArrays, pose: Record) -> None:
    """Bring the derived fields up to date with position, orientation, flexion and abduction."""
    quaternion_to_matrix(pose.orientation[:], pose.rotation[:])
    given = pose.position[:], pose.rotation[:], pose.flexion[:], pose.abduction[:]
    forward_kinematics(hand, *given, pose.joints[:], pose.direction[:], pose.axis[:], pose.abduction_axis[:])


@jit_inline
def copy_configuration(source: Record, target: Record) -> None:
    """Copy position, orientation, flexion and abduction, not the derived fields."""
    copy_values(source.position[:], target.position[:])
    copy_values(source.orientation[:], target.orientation[:])
    copy_values(source.flexion[:], target.flexion[:])
    copy_values(source.abduction[:], target.abduction[:])


@jit_inline
def step_between(start: Record, end: Record, step_out: Array, abduction_out: Array, scratch: Array) -> None:
    """Compute the step between configurations [m, rad], shape (21,), and that of the abduction, (5,); scratch (3,)."""
    rotation_vector_between(start.orientation, end.orientation, scratch)
    for i in range(3):
        step_out[i] = end.position[i] - start.position[i]
        step_out[3 + i] = scratch[i]
    for f in range(FINGER_COUNT):
        abduction_out[f] = end.abduction[f] - start.abduction[f]
        for k in range(PHALANX_COUNT):
            step_out[6 + PHALANX_COUNT * f + k] = end.flexion[f, k] - start.flexion[f, k]


@jit_inline
def move(pose: Record, step: Array, abduction_step: Array, fraction: float) -> None:
    """Move by `fraction` of a step (δp, δφ, δθ), shape (21,), and of an abduction step [rad], shape (5,)."""
    for i in range(3):
        pose.position[i] += fraction * step[i]
    rotate_quaternion(pose.orientation, fraction * step[3], fraction * step[4], fraction * step[5], pose.orientation)
    for f in range(FINGER_COUNT):
        pose.abduction[f] += fraction * abduction_step[f]
        for k in range(PHALANX_COUNT):
            pose.flexion[f, k] += fraction * step[6 + 3 * f + k]


LARGEST = 1e6
"""Metres and radians beyond this are no reading of a hand, and their squares soon overflow."""


@jit
def is_finite_configuration(position: Array, orientation: Array, flexion: Array, abduction: Array) -> bool:
    """Return True if every number is finite and not absurdly large, and the quaternion is not zero."""
    square = 0.0
    total = 0.0
    for i in range(3):
        total += abs(position[i])
    for i in range(4):
        square += orientation[i] * orientation[i]
    for f in range(FINGER_COUNT):
        total += abs(abduction[f])
        for k in range(PHALANX_COUNT):
            total += abs(flexion[f, k])
    return total < LARGEST and 1e-12 < square < LARGEST


@jit_inline
def farthest_joint(joints: Array, others: Array) -> float:
    """Compute the greatest distance [m] between corresponding joints and tips of two hands, shapes (5, 4, 3)."""
    far = 0.0
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            square = 0.0
            for i in range(3):
                square += (joints[f, k, i] - others[f, k, i]) ** 2
            far = max(far, square)
    return math.sqrt(far)


FINGER_JOINTS, ABDUCTIONS = 15, 5


@jit
def apply_changes(
    orientation: Array, flexion: Array, abduction: Array, change: Array, turned_out: Array, bent_out: Array, out: Array
) -> None:
    """Compute orientations (T, 4), flexions (T, 15) and abductions (T, 5) [rad] after changes, shape (T, 26).

    A turn of exactly zero leaves the quaternion as it is.
    """
    for t in range(change.shape[0]):
        row = change[t]
        if row[3] == 0.0 and row[4] == 0.0 and row[5] == 0.0:
            for i in range(4):
                turned_out[t, i] = orientation[t, i]
        else:
            rotate_quaternion(orientation[t], row[3], row[4], row[5], turned_out[t])
        for i in range(FINGER_JOINTS):
            bent_out[t, i] = flexion[t, i] + row[6 + i]
        for i in range(ABDUCTIONS):
            out[t, i] = abduction[t, i] + row[6 + FINGER_JOINTS + i]


@jit
def turns_between(first: Array, second: Array, turn_out: Array) -> None:
    """Compute the rotation vectors [rad], shape (T, 3), from quaternions to others, (T, 4); of equal ones exactly 0."""
    for t in range(first.shape[0]):
        a, b = first[t], second[t]
        if a[0] == b[0] and a[1] == b[1] and a[2] == b[2] and a[3] == b[3]:
            turn_out[t, 0] = turn_out[t, 1] = turn_out[t, 2] = 0.0
        else:
            rotation_vector_between(a, b, turn_out[t])
