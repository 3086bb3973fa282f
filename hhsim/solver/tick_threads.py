"""Threads that help with a solver's ticks."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.parallel.thread_team import dismiss, post
from hhsim.kernels.qp.active_set import QpWork, new_work
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.progressive import help_out
from hhsim.system.posix import thread_clock

HELPER = "hhsim-helper"
"""Start of the helpers' names."""


class ThreadTeam:
    """Helpers of one solver: threads that live while a block of ticks runs, and wait for work in compiled code.

    Starting them takes about 0.1 ms a block, outside of the timed ticks. `threads` counts the caller's own; 1 starts
    none. `works` are the helpers' workspaces: none writes what another thread writes.
    """

    def __init__(self, states: NDArray[np.void], threads: int) -> None:
        self.states = states
        self.works = [new_work(DOF, ROW_CAPACITY) for _ in range(threads - 1)]

    @contextmanager
    def at_work(self, options: TickOptions) -> Iterator[None]:
        """Run the helpers during a block, and raise what one of them raised; however it ends, none of them is left."""
        if not self.works:
            yield
            return
        shared = self.states[0].thread_team
        word = shared.word[:]
        dismiss(word)
        # Compiled before there are helpers: a block of ticks would begin without them.
        help_out(options, self.states, self.works[0])
        clocks: SimpleQueue[int] = SimpleQueue()

        def help_with(work: QpWork) -> None:
            clocks.put(thread_clock())
            help_out(options, self.states, work)

        with ThreadPoolExecutor(len(self.works), HELPER) as pool:
            try:
                post(word, 0)
                helpers = [pool.submit(help_with, work) for work in self.works]
                shared.clock[: len(helpers)] = [clocks.get() for _ in helpers]
                shared.clocks = len(helpers)
                shared.members = 1 + len(helpers)
                yield
            finally:
                dismiss(word)
                shared.members = 1
                shared.clocks = 0
        for helper in helpers:
            helper.result()
