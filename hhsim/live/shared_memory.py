"""Memory that several processes of a session see: a block, a ring with one writer and any number of readers, a setup.

The memory has no name (memfd), so that nothing is left behind however the processes end; children inherit the
descriptor. Words of eight bytes are written whole; on the processors that hhsim runs on, stores become visible in their
order, which is what a reader relies on.
"""

import contextlib
import mmap
import os
import pickle
import sys
from typing import Any, Self, TypeVar

import numpy as np

from hhsim.arrays import AnyArray, IntArray
from hhsim.errors import HhsimError

Setup = TypeVar("Setup")

MADV_POPULATE_WRITE = 23
"""As if every page were written, which changes none (madvise(2), Linux 5.14)."""


class SharedBlock:
    """An array of one element in shared memory.

    Args:
        dtype: Of its one element; every process must agree.
    """

    def __init__(self, descriptor: int, dtype: np.dtype[Any]) -> None:
        """Map the memory of a descriptor."""
        self.descriptor = descriptor
        self._map = mmap.mmap(descriptor, dtype.itemsize)
        self.array: AnyArray = np.frombuffer(self._map, dtype, 1)

    def populate(self) -> None:
        """Have all of its pages there for this process, where the system can do that at once."""
        with contextlib.suppress(OSError):
            self._map.madvise(MADV_POPULATE_WRITE)

    @classmethod
    def create(cls, name: str, dtype: np.dtype[Any]) -> Self:
        """Fresh memory, all zeros; `name` is for people who look into /proc. The descriptor can be inherited.

        Raises:
            HhsimError: The system has no memory of this kind.
        """
        if not hasattr(os, "memfd_create"):
            raise HhsimError(f"live sessions need Linux, whose memory needs no file (memfd); this is {sys.platform}")
        descriptor = os.memfd_create(f"hhsim-{name}", 0)
        os.ftruncate(descriptor, dtype.itemsize)
        os.set_inheritable(descriptor, True)
        return cls(descriptor, dtype)


class SharedRing:
    """Records in shared memory: the writer never waits, a reader that falls behind loses the oldest and knows it.

    Args:
        capacity: How many records the ring holds.
    """

    def __init__(self, descriptor: int, dtype: np.dtype[Any], capacity: int) -> None:
        """Map the memory of a descriptor."""
        whole = np.dtype([("written", np.int64), ("record", dtype, (capacity,))], align=True)
        self._block = SharedBlock(descriptor, whole)
        self.descriptor = descriptor
        self.capacity = capacity
        self.counter: IntArray = self._block.array["written"]
        """Records written since the beginning, shape (1,)."""
        self.records = self._block.array["record"][0]

    @classmethod
    def create(cls, name: str, dtype: np.dtype[Any], capacity: int) -> Self:
        """A fresh, empty ring."""
        whole = np.dtype([("written", np.int64), ("record", dtype, (capacity,))], align=True)
        block = SharedBlock.create(name, whole)
        return cls(block.descriptor, dtype, capacity)

    def populate(self) -> None:
        """See `SharedBlock.populate`."""
        self._block.populate()

    @property
    def written(self) -> int:
        """Records written since the beginning."""
        return int(self.counter[0])

    def slot(self) -> Any:
        """The record to fill next, in place; nobody sees it before `publish`."""
        return self.records[int(self.counter[0]) % self.capacity]

    def publish(self) -> None:
        """The record that `slot` gave is complete."""
        self.counter[0] += 1


class RingReader:
    """One reader's place in a ring.

    Args:
        ring: Which; read from the oldest record that is there.
    """

    lost: int
    """Records that were overwritten before they were read."""

    def __init__(self, ring: SharedRing) -> None:
        """Nothing is read yet."""
        self._ring = ring
        self.next = 0
        self.lost = 0

    def read(self, most: int) -> tuple[int, AnyArray]:
        """The oldest records not yet read.

        Returns:
            The number of the first one, counted from the ring's beginning, and copies of the records; numbers that
            are passed over were lost.
        """
        ring = self._ring
        self._skip_lost(ring.written)
        first = self.next
        count = min(most, ring.written - first)
        place = np.arange(first, first + count) % ring.capacity
        copies = ring.records[place]
        # The slot after the newest record may be in the making, so one record fewer than the capacity is safe.
        overwritten = max(0, ring.written - (ring.capacity - 1) - first)
        if overwritten:
            gone = min(overwritten, count)
            self.lost += gone
            first, copies = first + gone, copies[gone:]
        self.next = first + len(copies)
        return first, copies

    def _skip_lost(self, written: int) -> None:
        oldest = max(0, written - (self._ring.capacity - 1))
        if self.next < oldest:
            self.lost += oldest - self.next
            self.next = oldest


def write_setup(setup: object) -> int:
    """Put what a process has to know into memory that children can inherit; returns the descriptor."""
    descriptor = os.memfd_create("hhsim-setup", 0)
    os.set_inheritable(descriptor, True)
    with open(descriptor, "wb", closefd=False) as stream:
        pickle.dump(setup, stream, pickle.HIGHEST_PROTOCOL)
    return descriptor


def read_setup(descriptor: int, kind: type[Setup]) -> Setup:
    """What `write_setup` put there; every process may read it, whatever others have read."""
    # By position: processes that inherit a descriptor share its place in the file.
    size = os.fstat(descriptor).st_size
    setup = pickle.loads(os.pread(descriptor, size, 0))
    if not isinstance(setup, kind):
        raise TypeError(f"the setup is a {type(setup).__name__}")
    return setup
