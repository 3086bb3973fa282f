"""Why a loop missed a period: the four causes that a session's file holds, the words for them, and how one is named."""

from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple


class MissCause(IntEnum):
    """Who took the time of a period that was missed; 0: none was."""

    NONE = 0
    COMPUTED = 1
    WOKEN_LATE = 2
    HOST = 3
    DEVICE = 4


WORDS = {
    MissCause.COMPUTED: "computed too long",
    MissCause.WOKEN_LATE: "woken late",
    MissCause.HOST: "taken by the host",
    MissCause.DEVICE: "device late",
}


CAUSES = tuple(WORDS)
"""The four, in the order of counts by cause."""


def by_name(counts: Iterable[int]) -> dict[str, int]:
    """Counts in the order of `CAUSES`, by names as files and JSON have them."""
    return {cause.name.lower(): int(count) for cause, count in zip(CAUSES, counts, strict=True)}


class TimeTaken(NamedTuple):
    """Where the time went between the deadlines of two ticks, beyond the sleep that was asked for; all in ns.

    Attributes:
        computed: CPU time of the loop's own thread.
        kept: Wall time in which the thread neither ran nor slept as it had asked to: its work's wall time less its CPU
            time, how late it had woken for it, and how late it woke then.
        run_delay: Of `kept`, how long the thread could have run and was not let.
        steal: How long the host of a virtual machine had the processor; counted in steps of 10 ms on most systems.
        device: Wall time of the calls to the glove and to the source of the palm's pose.
    """

    computed: int
    kept: int
    run_delay: int
    steal: int
    device: int

    def cause(self) -> MissCause:
        """The cause that took most.

        What is measured best is taken out of `kept` first: the run delay, which is exact; then the steal, which is
        coarse, so that less than one step of it may go unseen; then the device. What no account explains is woken late
        too: the system had the thread and did not let it run, as where a process is stopped, or a page is fetched.
        """
        from hhsim.kernels.live.accounts import cause_of

        return MissCause(int(cause_of(*self)))
