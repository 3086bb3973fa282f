"""Threads that help with a solver's ticks."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
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

Given = tuple[HandArrays, Any, TickOptions, NDArray[np.void]]


class ThreadTeam:
    """Helpers of one solver: threads that live while a block of ticks runs, and wait for work in compiled code.

    Starting them takes about 0.1 ms a block, outside of the timed ticks. `threads` counts the caller's own; 1 starts
    none. `worth` is the number of distances outside of the largest part from which on detection is shared, see
    `hhsim.kernels.contact.parallel_detection.worth_sharing`.
    """

    def __init__(self, states: NDArray[np.void], threads: int) -> None:
        self.states = states
        self.worth = WORTH_SHARING
        self.works = [_HelperWork(states) for _ in range(threads - 1)]
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
            self.works[0].help_out(given)
            self._compiled = True
        arrived = threading.Semaphore(0)
        helpers = [_Helper(work, given, arrived) for work in self.works]
        try:
            assemble(word)
            for helper in helpers:
                helper.start()
            deadline = time.monotonic() + ARRIVAL
            for _ in helpers:
                arrived.acquire(timeout=max(0.0, deadline - time.monotonic()))
            clocks = [helper.clock for helper in helpers if helper.clock is not None]
            shared.clock[: len(clocks)] = clocks
            shared.clocks = len(clocks)
            shared.worth = self.worth
            shared.members = 1 + len(helpers)
            yield
        finally:
            dismiss(word)
            shared.members = 1
            shared.clocks = 0
            for helper in helpers:
                if helper.ident is not None:
                    helper.join()
        for helper in helpers:
            if helper.failure is not None:
                raise helper.failure


class _HelperWork:
    """Workspace of a helper, which writes nothing that another thread writes."""

    def __init__(self, states: NDArray[np.void]) -> None:
        self.qp: QpWork = new_work(DOF, ROW_CAPACITY)
        candidates = states[0].candidates
        self.walk = Walk(np.zeros_like(candidates.stack), np.zeros_like(candidates.scratch))

    def help_out(self, given: Given) -> None:
        help_out(*given, self.qp, self.walk)


class _Helper(threading.Thread):
    def __init__(
        self,
        work: _HelperWork,
        given: Given,
        arrived: threading.Semaphore,
    ) -> None:
        super().__init__(name="hhsim-helper", daemon=True)
        self.work = work
        self.given = given
        self.arrived = arrived
        self.clock: int | None = None
        self.failure: BaseException | None = None

    def run(self) -> None:
        try:
            self.clock = thread_clock()
            self.arrived.release()
            self.work.help_out(self.given)
        except BaseException as error:  # handed to the thread that asked for help
            self.failure = error
            self.arrived.release()
