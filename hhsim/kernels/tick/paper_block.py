"""Blocks of ticks by the paper's method."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import jit
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord, record_tick
from hhsim.kernels.tick.paper import tick_paper
from hhsim.kernels.tick.state import TickOptions
from hhsim.kernels.tick.tick import set_haptic

Array = NDArray[np.float64]


@jit
def run_block_paper(
    hand: HandArrays,
    palm: TreeArrays,
    tree: TreeArrays,
    options: TickOptions,
    states: NDArray[np.void],
    papers: NDArray[np.void],
    qp: QpWork,
    position: Array,
    orientation: Array,
    flexion: Array,
    abduction: Array,
    record: TickRecord,
) -> int:
    """As `kernels.block.run_block`, by the paper's method; `palm` is the palm's sphere tree, palm frame."""
    state, paper = states[0], papers[0]
    for i in range(position.shape[0]):
        cpu = thread_cpu_ns()
        wall = monotonic_ns()
        status = set_haptic(hand, position[i], orientation[i], flexion[i], abduction[i], state)
        status |= tick_paper(hand, palm, tree, options, state, paper, qp)
        wall = monotonic_ns() - wall
        cpu = thread_cpu_ns() - cpu
        record_tick(state, status, wall, cpu, i, record)
    return position.shape[0]
