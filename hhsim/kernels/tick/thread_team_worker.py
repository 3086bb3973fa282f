"""Work of the helpers of a thread team while a block of ticks runs in another thread."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.parallel_detection import evaluate_items
from hhsim.kernels.contact.surface import Walk
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import as_int64, jit
from hhsim.kernels.parallel.thread_team import NOTHING, TASK_DISTANCES, TASK_STOP, rest, waiting_task
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.progressive import solve_items


@jit
def help_out(
    hand: HandArrays,
    surface: Any,
    options: TickOptions,
    states: NDArray[np.void],
    qp: QpWork,
    walk: Walk,
) -> None:
    """Do items of the tick's tasks until the thread team is dismissed.

    Args:
        hand, surface, options, states: Those of the block that runs in the thread team's first thread.
        qp: A workspace of this thread's own.
        walk: This thread's own.
    """
    state = states[0]
    word = state.thread_team.word[:]
    looks = as_int64(0)
    while True:
        task = waiting_task(word)
        if task == NOTHING:
            rest(looks)
            looks += 1
            continue
        if task == TASK_STOP:
            return
        looks = as_int64(0)
        if task == TASK_DISTANCES:
            evaluate_items(hand, surface, options.margin, options.skin, state, walk)
        else:
            solve_items(options, state, qp)
