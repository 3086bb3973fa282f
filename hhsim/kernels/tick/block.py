"""Blocks of ticks, many in one compiled call, of a method that the type of its options names.

`coupled` and `progressive` are ticks of hands and bodies, `kernels.world.tick`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import SurfaceCode
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import farthest_joint, is_finite_configuration, update_kinematics
from hhsim.kernels.jit import Array, Indices, Record, generic, jit, jit_inline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parallel.thread_team import thread_team_cpu_ns
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_INPUT_INVALID

OVERFLOW = -1
"""Status of a linearisation whose contacts do not fit into the arrays; the others are those of `qp.active_set`."""


@generic
def tick(method: Any, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Bring the graphic hand towards the haptic hand (`set_haptic`); returns status bits."""


@by_reference
class HapticBlock(NamedTuple):
    """Haptic hand at each tick of a block, world: [m] (B, 3), (w, x, y, z) (B, 4), [rad] (B, 5, 3) and (B, 5)."""

    position: Array
    orientation: Array
    flexion: Array
    abduction: Array


@by_reference
class TickRecord(NamedTuple):
    """Results of a block of ticks; names, units and shapes as in the result file, first axis the tick."""

    status: Indices
    position: Array
    orientation: Array
    flexion: Array
    abduction: Array
    joints: Array
    phalanx: Array
    fingertip_normal: Array
    palm_wrench: Array
    total: Array
    duration: Indices
    duration_total: Indices
    duration_cpu: Indices
    work: Indices
    lag: Array


@jit_inline
def set_haptic(hand: HandArrays, haptic: HapticBlock, i: Any, state: Record) -> int:
    """Take row i, or (hand, i), of the input and return 0; STATUS_INPUT_INVALID if not finite: the old one stays."""
    position, orientation = haptic.position[i], haptic.orientation[i]
    flexion, abduction = haptic.flexion[i], haptic.abduction[i]
    pose, sample = state.haptic, state.input
    sample.previous_motion = sample.motion
    sample.motion = 0.0
    sample.is_valid = is_finite_configuration(position, orientation, flexion, abduction)
    if not sample.is_valid:
        return STATUS_INPUT_INVALID
    square = 0.0
    for j in range(4):
        square += orientation[j] * orientation[j]
    scale = 1.0 / math.sqrt(square)
    for j in range(3):
        pose.position[j] = position[j]
    for j in range(4):
        pose.orientation[j] = orientation[j] * scale
    for f in range(FINGER_COUNT):
        pose.abduction[f] = abduction[f]
        for k in range(PHALANX_COUNT):
            pose.flexion[f, k] = flexion[f, k]
    # Not by `copy_values`: its one loop over three axes takes 4 µs beside the arrays of a mesh, a third of a tick.
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            for j in range(3):
                sample.joints[f, k, j] = pose.joints[f, k, j]
    update_kinematics(hand, pose)
    sample.motion = farthest_joint(sample.joints, pose.joints)
    return 0


@jit_inline
def record_tick(state: Record, status: int, wall: int, cpu: int, i: Any, record: TickRecord) -> None:
    """Copy the outcome of the last tick to row i, or (hand, i), of the record; wall and CPU time in ns."""
    pose, forces = state.pose, state.forces
    record.status[i] = status
    copy_values(pose.position[:], record.position[i])
    copy_values(pose.orientation[:], record.orientation[i])
    copy_values(pose.flexion[:], record.flexion[i])
    copy_values(pose.abduction[:], record.abduction[i])
    copy_values(pose.joints[:], record.joints[i])
    copy_values(forces.phalanx[:], record.phalanx[i])
    copy_values(forces.fingertip_normal[:], record.fingertip_normal[i])
    copy_values(forces.palm_wrench[:], record.palm_wrench[i])
    copy_values(forces.total[:], record.total[i])
    copy_values(state.step.duration[:], record.duration[i])
    record.duration_total[i] = wall
    record.duration_cpu[i] = cpu
    copy_values(state.work[:], record.work[i])
    record.lag[i] = state.progress.lag


@jit
def run_block(
    method: Any,
    hand: HandArrays,
    surface: SurfaceCode,
    states: NDArray[np.void],
    qp: QpWork,
    haptic: HapticBlock,
    record: TickRecord,
) -> int:
    """Run one tick of a method for each row of the haptic input; returns the ticks done.

    Fewer than all only where the pairs did not fit (STATUS_CAPACITY_EXCEEDED in the last row). All that a haptic loop
    would do with a sample is timed: input, detection, programs and forces, without the copy to the record. The CPU time
    is that of all threads that the tick keeps busy, with what they spend on waiting for work.
    """
    state = states[0]
    for i in range(haptic.position.shape[0]):
        cpu = thread_team_cpu_ns(state.thread_team)
        wall = monotonic_ns()
        status = set_haptic(hand, haptic, i, state)
        status |= tick(method, hand, surface, state, qp)
        wall = monotonic_ns() - wall
        cpu = thread_team_cpu_ns(state.thread_team) - cpu
        record_tick(state, status, wall, cpu, i, record)
        if status & STATUS_CAPACITY_EXCEEDED:
            # Not by leaving the loop for something behind it: compiled, that costs every tick 0.4 µs.
            return i + 1
    return haptic.position.shape[0]
