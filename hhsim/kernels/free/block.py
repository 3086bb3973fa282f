"""Blocks of ticks with a free object, each timed and recorded as those of `kernels.tick.block`."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.record import ObjectRecord, record_object
from hhsim.kernels.free.tick import Free
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import jit
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.tick import converge


class FreeBlock(NamedTuple):
    """Arguments of `run_free_block`, in its order, for a loop that calls its machine code."""

    method: Free
    hand: HandArrays
    surface: Any
    states: NDArray[np.void]
    qp: QpWork
    haptic: HapticBlock
    record: TickRecord
    object_record: ObjectRecord


@jit
def run_free_block(
    method: Free,
    hand: HandArrays,
    surface: Any,
    states: NDArray[np.void],
    qp: QpWork,
    haptic: HapticBlock,
    record: TickRecord,
    object_record: ObjectRecord,
) -> int:
    """Run one tick for each row of the haptic input, which is the world's; returns the ticks done.

    The hand is recorded as the object sees it at the end of the tick.
    """
    state = states[0]
    for i in range(haptic.position.shape[0]):
        cpu = thread_cpu_ns()
        wall = monotonic_ns()
        status = set_haptic(
            hand, haptic.position[i], haptic.orientation[i], haptic.flexion[i], haptic.abduction[i], state
        )
        if status == 0:
            copy_values(state.haptic.position[:], state.palm_position[:])
            copy_values(state.haptic.orientation[:], state.palm_orientation[:])
        status |= converge(method, hand, surface, state, qp)
        wall = monotonic_ns() - wall
        cpu = thread_cpu_ns() - cpu
        record_tick(state, status, wall, cpu, i, record)
        record_object(state.body, state.borne, state.table_distance, i, object_record)
        if status & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return haptic.position.shape[0]
