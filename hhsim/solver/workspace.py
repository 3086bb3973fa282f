"""Allocation of the arrays that the tick's kernels work in."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.paper import PAPER_STATE
from hhsim.kernels.tick.penalty import PENALTY_STATE
from hhsim.kernels.tick.state import TICK_STATE, WORK_COUNTERS


def tick_state(stiffness: NDArray[np.float64], modelled: NDArray[np.bool_] | None = None) -> Any:
    """A fresh state, a record array of shape (1,): all modelled bodies still to be gathered.

    Args:
        stiffness: The coupling's G, shape (21,).
        modelled: Which bodies the scene uses, shape (16,); all where it is not given.
    """
    # Written, and not only asked for: the system would else hand out the pages one by one, in the ticks that are timed.
    memory = np.empty(1, TICK_STATE)
    memory.view(np.uint8)[:] = 0
    states = memory.view(np.recarray)
    state = states[0]
    for pose in (state.pose, state.safe, state.haptic):
        pose.orientation[0] = 1.0
        pose.rotation[:] = np.eye(3)
    state.modelled[:] = True if modelled is None else modelled
    state.candidates.slack[:] = np.where(state.modelled == 1, -np.inf, np.inf)
    state.candidates.nearest[:] = np.inf
    state.problem.inverse_root[:] = 1.0 / np.sqrt(stiffness)
    state.stiffness[:] = stiffness
    return states


def paper_state(closed: bool) -> Any:
    """What method `paper` keeps besides the tick's state, a record array of shape (1,)."""
    memory = np.empty(1, PAPER_STATE)
    memory.view(np.uint8)[:] = 0
    states = memory.view(np.recarray)
    states[0].closed = closed
    return states


def penalty_state() -> Any:
    """A fresh state of the method `penalty`, at rest, a record array of shape (1,)."""
    memory = np.empty(1, PENALTY_STATE)
    memory.view(np.uint8)[:] = 0
    return memory.view(np.recarray)


def tick_record(ticks: int) -> TickRecord:
    """Room for the results of a block of ticks."""
    zeros = np.zeros
    return TickRecord(
        status=zeros(ticks, np.int64),
        position=zeros((ticks, 3)),
        orientation=zeros((ticks, 4)),
        flexion=zeros((ticks, 5, 3)),
        abduction=zeros((ticks, 5)),
        joints=zeros((ticks, 5, 4, 3)),
        phalanx=zeros((ticks, 5, 3, 3)),
        fingertip_normal=zeros((ticks, 5, 3)),
        palm_wrench=zeros((ticks, 6)),
        total=zeros((ticks, 3)),
        duration=zeros((ticks, 4), np.int64),
        duration_total=zeros(ticks, np.int64),
        duration_cpu=zeros(ticks, np.int64),
        work=zeros((ticks, WORK_COUNTERS), np.int64),
        lag=zeros(ticks),
    )
