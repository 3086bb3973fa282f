"""Threads that help with a solver's ticks."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.contact.surface import Walk
from hhsim.kernels.hand.kinematics import DOF, HandArrays
from hhsim.kernels.parallel.thread_team import assemble, dismiss
from hhsim.kernels.qp.active_set import QpWork, new_work
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.thread_team_worker import help_out
from hhsim.system.posix import thread_clock

ARRIVAL = 1.0
"""A block begins without the helpers that have not arrived after this [s]: they can join at any tick."""

WORTH_SHARING = 2500
"""Number of distances outside of the largest part from which on sharing saves time: some two microseconds."""

HelperWork = tuple[QpWork, Walk]


class ThreadTeam:
    """Helpers of one solver: threads that live while a block of ticks runs, and wait for work in compiled code.

    Starting them takes about 0.1 ms a block, outside of the timed ticks. `threads` counts the caller's own; 1 starts
    none. `worth` is the number of distances outside of the largest part from which on detection is shared, see
    `hhsim.kernels.contact.parallel_detection.worth_sharing`.
    """

    def __init__(self, states: NDArray[np.void], threads: int) -> None:
        self.states = states
        self.worth = WORTH_SHARING
        self.works = [_helper_work(states) for _ in range(threads - 1)]
        self._compiled = False

    @contextmanager
    def at_work(self, hand: HandArrays, surface: Any, options: TickOptions) -> Iterator[None]:
        """Run the helpers during a block, and raise what one of them raised; however it ends, none of them is left."""
        if not self.works:
            yield
            return
        shared = self.states[0].thread_team
        word = shared.word[:]
        given = (hand, surface, options, self.states)
        dismiss(word)
        if not self._compiled:
            # Here and not in a helper: a block of ticks would begin without it.
            help_out(*given, *self.works[0])
            self._compiled = True
        clocks: SimpleQueue[int] = SimpleQueue()

        def help_with(work: HelperWork) -> None:
            clocks.put(thread_clock())
            help_out(*given, *work)

        with ThreadPoolExecutor(len(self.works), "hhsim-helper") as pool:
            try:
                assemble(word)
                helpers = [pool.submit(help_with, work) for work in self.works]
                deadline = time.monotonic() + ARRIVAL
                with suppress(Empty):
                    for place in range(len(helpers)):
                        shared.clock[place] = clocks.get(timeout=max(0.0, deadline - time.monotonic()))
                        shared.clocks = place + 1
                shared.worth = self.worth
                shared.members = 1 + len(helpers)
                yield
            finally:
                dismiss(word)
                shared.members = 1
                shared.clocks = 0
        for helper in helpers:
            helper.result()


def _helper_work(states: NDArray[np.void]) -> HelperWork:
    """Allocate the workspace of a helper, which writes nothing that another thread writes."""
    candidates = states[0].candidates
    return new_work(DOF, ROW_CAPACITY), Walk(np.zeros_like(candidates.stack), np.zeros_like(candidates.scratch))
