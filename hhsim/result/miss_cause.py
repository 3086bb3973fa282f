"""Causes of a session's missed periods."""

from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple


class MissCause(IntEnum):
    """Cause of a missed period."""

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
"""Causes in the order of counts by cause."""


def by_name(counts: Iterable[int]) -> dict[str, int]:
    """Counts, in the order of `CAUSES`, by their names in files and JSON."""
    return {cause.name.lower(): int(count) for cause, count in zip(CAUSES, counts, strict=True)}


class TimeTaken(NamedTuple):
    """Time between the deadlines of two ticks, beyond the sleep that was asked for [ns].

    The cause is what took most: the most exact is taken out of `kept` first, the run delay, then the coarse steal, then
    the device. The rest is woken late too: the system did not let the thread run, as for a stopped process.
    """

    computed: int  # CPU time of the loop's own thread
    # wall time in which the thread neither ran nor slept as asked: wall less CPU time of its work, and both delays of
    # its wake-ups
    kept: int
    run_delay: int  # part of `kept` in which the thread was ready and did not run
    steal: int  # time that the host of a virtual machine had the processor, mostly in steps of 10 ms
    device: int  # wall time of the calls to the glove and to the source of the palm's pose
