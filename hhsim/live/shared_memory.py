"""Memory shared by the processes of a session: a block, a ring with one writer and any number of readers, a setup.

It has no name (memfd): children inherit the descriptor, and nothing is left behind however the processes end. Readers
rely on words of eight bytes being written whole, and on stores becoming visible in order, as on x86-64.
"""

import argparse
import contextlib
import mmap
import os
import pickle
import sys
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from hhsim.arrays import AnyArray, IntArray
from hhsim.errors import HhsimError
from hhsim.live.real_time import name_process

MADV_POPULATE_WRITE = 23
"""Advice to prefault every page for writing (madvise(2), Linux 5.14)."""


class SharedBlock:
    """An array of one element of `dtype` in the memory of a descriptor; every process must use the same `dtype`."""

    def __init__(self, descriptor: int, dtype: np.dtype[Any]) -> None:
        self.descriptor = descriptor
        self._map = mmap.mmap(descriptor, dtype.itemsize)
        self.array: AnyArray = np.frombuffer(self._map, dtype, 1)

    def populate(self) -> None:
        """Prefault all pages for this process, if the system can do that at once."""
        with contextlib.suppress(OSError):
            self._map.madvise(MADV_POPULATE_WRITE)

    @classmethod
    def create(cls, name: str, dtype: np.dtype[Any]) -> Self:
        """Allocate memory of zeros with an inheritable descriptor; HhsimError if the system has none of this kind."""
        if not hasattr(os, "memfd_create"):
            raise HhsimError(f"live sessions need Linux, whose memory needs no file (memfd); this is {sys.platform}")
        descriptor = os.memfd_create(f"hhsim-{name}", 0)
        os.ftruncate(descriptor, dtype.itemsize)
        os.set_inheritable(descriptor, True)
        return cls(descriptor, dtype)


class SharedRing:
    """Ring of `capacity` records: the writer never waits, a slow reader loses the oldest ones and counts them."""

    def __init__(self, descriptor: int, dtype: np.dtype[Any], capacity: int) -> None:
        self._block = SharedBlock(descriptor, _ring_type(dtype, capacity))
        self.descriptor = descriptor
        self.capacity = capacity
        self.populate = self._block.populate
        self.counter: IntArray = self._block.array["written"]
        """Number of records written since the beginning, shape (1,)."""
        self.records = self._block.array["record"][0]

    @classmethod
    def create(cls, name: str, dtype: np.dtype[Any], capacity: int) -> Self:
        """Allocate an empty ring."""
        return cls(SharedBlock.create(name, _ring_type(dtype, capacity)).descriptor, dtype, capacity)

    @property
    def written(self) -> int:
        """Number of records written since the beginning."""
        return int(self.counter[0])

    def slot(self) -> Any:
        """Return the record to fill next; readers see it after `publish`."""
        return self.records[self.written % self.capacity]

    def publish(self) -> None:
        """Publish the record that `slot` returned."""
        self.counter[0] += 1


def _ring_type(dtype: np.dtype[Any], capacity: int) -> np.dtype[Any]:
    return np.dtype([("written", np.int64), ("record", dtype, (capacity,))], align=True)


class RingReader:
    """Position of one reader in a ring: its next record, at first the oldest, and how many were overwritten unread."""

    def __init__(self, ring: SharedRing) -> None:
        self._ring = ring
        self.next = 0
        self.lost = 0

    def read(self, most: int) -> tuple[int, AnyArray]:
        """Read the oldest unread records, at most `most`.

        Returns the number of the first one, from the ring's beginning, and copies; numbers that are skipped were lost.
        """
        ring = self._ring
        written = ring.written
        first = max(self.next, written - (ring.capacity - 1))
        self.lost += first - self.next
        records = ring.records[np.arange(first, min(first + most, written)) % ring.capacity]
        self.next = first + len(records)
        # The slot after the newest record may be in the making, so one record fewer than the capacity is valid.
        overwritten = min(max(0, ring.written - (ring.capacity - 1) - first), len(records))
        self.lost += overwritten
        return first + overwritten, records[overwritten:]


def write_setup(*parts: object) -> int:
    """Pickle the parts of a process's setup into inheritable memory; returns the descriptor."""
    descriptor = os.memfd_create("hhsim-setup", 0)
    os.set_inheritable(descriptor, True)
    with open(descriptor, "wb", closefd=False) as stream:
        pickle.dump(parts, stream, pickle.HIGHEST_PROTOCOL)
    return descriptor


def process_setup(name: str, arguments: Sequence[str] | None) -> tuple[Any, ...]:
    """Name this process of a session, and return the parts that `write_setup` wrote for it."""
    name_process(name)
    parser = argparse.ArgumentParser(prog=f"hhsim-{name}")
    parser.add_argument("--setup", type=int, required=True, metavar="FD")
    descriptor = parser.parse_args(arguments).setup
    # By position: processes that inherit a descriptor share its offset in the file.
    parts: tuple[Any, ...] = pickle.loads(os.pread(descriptor, os.fstat(descriptor).st_size, 0))
    return parts
