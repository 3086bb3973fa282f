"""Shared memory of one live session: one block of each hand.

The supervisor makes it; every other process gets it pickled with its setup, and attaches by inherited descriptors.
"""

import json
import os
import threading
import time
import weakref
from collections.abc import Mapping
from functools import partial
from typing import Any, Self

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.live.device import GLOVE_SAMPLE
from hhsim.live.processes import LIVE_STATUS, RingReader, SharedBlock, SharedRing, ring_type
from hhsim.result.schema import TICK_FIELDS, bodies_row, record_dtype

TICK_CAPACITY = 16_384
FREE_TICK_CAPACITY = 4_096
"""Capacity for ticks with free bodies, which are five times as long: 36 MB, and 4 s at 1 kHz."""
SAMPLE_CAPACITY = 16_384
EVENT_CAPACITY = 1_024
FACT_BYTES = 65_520

LIVE_TICK = record_dtype(*TICK_FIELDS)
"""One tick of the loop; `hhsim.result.schema.LIVE_TICK_COLUMNS` explains the fields that only a session has.

Missed periods leave gaps in `tick`; `input_seq` is the `seq` of the sample in use, -1 before the first.
"""

EVENT = np.dtype([("time_ns", np.int64), ("level", np.int64), ("text", "S240")], align=True)
"""A line of the session's log: CLOCK_MONOTONIC [ns]; level 0 for information, 1 a warning, 2 a fault; UTF-8."""
EVENT_BYTES = EVENT["text"].itemsize

FACTS = np.dtype([("version", np.int64), ("size", np.int64), ("text", np.uint8, (FACT_BYTES,))], align=True)
"""A JSON document; `version` is odd while it is being written, 0 before the first."""


class FactPage:
    """Page of plain values as JSON in memory of `FACTS`, shape (1,): one writer, any number of readers."""

    def __init__(self, memory: AnyArray) -> None:
        self._page = memory[0]

    def write(self, facts: Mapping[str, Any]) -> None:
        """Replace the content of the page; raises ValueError if it does not fit."""
        encoded = json.dumps(facts).encode("utf-8")
        if len(encoded) > FACT_BYTES:
            raise ValueError(f"{len(encoded):,} bytes of facts; {FACT_BYTES:,} fit")
        page = self._page
        page["version"] += 1
        page["text"][: len(encoded)] = np.frombuffer(encoded, np.uint8)
        page["size"] = len(encoded)
        page["version"] += 1

    def read(self) -> dict[str, Any]:
        """Return the content of the page, empty before the first write."""
        page = self._page
        while version := int(page["version"]):
            if version % 2 == 0:
                encoded = page["text"][: int(page["size"])].tobytes()
                if int(page["version"]) == version:
                    facts: dict[str, Any] = json.loads(encoded)
                    return facts
            time.sleep(1e-4)
        return {}


def memory_type(bodies: int) -> np.dtype[Any]:
    """Return the type of the memory of a hand, of a session that records the motion of some bodies."""
    capacity = FREE_TICK_CAPACITY if bodies else TICK_CAPACITY
    return np.dtype(
        [
            ("status", LIVE_STATUS),
            ("ticks", ring_type(LIVE_TICK, capacity)),
            ("bodies", ring_type(bodies_row(bodies), capacity)),
            ("samples", ring_type(GLOVE_SAMPLE, SAMPLE_CAPACITY)),
            ("events", ring_type(EVENT, EVENT_CAPACITY)),
            ("facts", FACTS),
        ],
        align=True,
    )


class SessionMemory:
    """Memory shared by the processes of a session: of a hand, with that of the other one `beside` it.

    `wake` and `sampled` are events of the loop's process alone: by them the loop wakes the driver for a command, and
    the driver the loop for a sample. `why_lost` is the driver's reason why the glove is gone, for the loop's log.
    """

    def __init__(self, descriptor: int, *others: int, bodies: int) -> None:
        self.descriptor, self._bodies = descriptor, bodies
        self.beside = SessionMemory(*others, bodies=bodies) if others else None
        block = SharedBlock(descriptor, memory_type(bodies))
        self.populate = block.populate
        """Prefaults every page that a tick reads or writes."""
        self.status_array = block.part("status")
        # The one record of `LIVE_STATUS`; `status["heartbeat_ns"]` reads and writes in place.
        self.status = self.status_array[0]
        self.ticks = SharedRing(block.part("ticks"))  # written by the loop; the first hand's last
        # Of `bodies_row`, before the tick of the same number is in its ring; the first hand's is used.
        self.bodies = SharedRing(block.part("bodies"))
        self.samples = SharedRing(block.part("samples"))  # written by the driver
        self.events = SharedRing(block.part("events"))  # the session's log, written by the loop's process
        # By the loop, before it runs and when it has ended: `real_time`, the achieved mode; `device`, the fields of
        # `hhsim.live.device.GloveInfo`; `pose`, the source of the palm's pose; `reason` of the end.
        self.facts = FactPage(block.part("facts"))
        self.wake, self.sampled = (os.eventfd(0, os.EFD_NONBLOCK) for _ in range(2))
        for event in (self.wake, self.sampled):
            weakref.finalize(self, os.close, event)
        self.why_lost = ""
        self._logging = threading.Lock()

    @classmethod
    def create(cls, *, bodies: int = 0, hands: int = 1) -> Self:
        """Allocate memory for a session that records the motion of some bodies.

        Its descriptors are for the children (`pass_fds`), and are closed with it.
        """
        kind = memory_type(bodies)
        memory = cls(*(SharedBlock.create("session", kind).descriptor for _ in range(hands)), bodies=bodies)
        for hand in memory.hands:
            hand.status["battery"] = hand.status["sample_ns"] = -1
            weakref.finalize(hand, os.close, hand.descriptor)
        return memory

    @property
    def hands(self) -> "tuple[SessionMemory, ...]":
        """Memory of all hands, this one first."""
        return (self,) if self.beside is None else (self, self.beside)

    @property
    def descriptors(self) -> list[int]:
        """Descriptors of all hands, which a child inherits."""
        return [hand.descriptor for hand in self.hands]

    def tell(self, **values: int) -> None:
        """Set fields of the status of each hand."""
        for hand in self.hands:
            for name, value in values.items():
                hand.status[name] = value

    def __reduce__(self) -> tuple[Any, ...]:
        # A child that has inherited the descriptors maps the same memory.
        return partial(SessionMemory, bodies=self._bodies), tuple(self.descriptors)

    def log(self, level: int, text: str, time_ns: int | None = None) -> None:
        """Add an event (INFORMATION, WARNING, FAULT), by default of now [ns], for the loop's process; cut if long."""
        encoded = text.encode("utf-8", "replace")[:EVENT_BYTES]
        with self._logging:
            slot = self.events.slot()
            slot["time_ns"] = time.monotonic_ns() if time_ns is None else time_ns
            slot["level"] = level
            slot["text"] = encoded.decode("utf-8", "ignore").encode("utf-8")
            self.events.publish()


class TickReader(RingReader):
    """Reader of the ticks of a session: of its hands, with the rows of bodies at each."""

    def __init__(self, memory: SessionMemory) -> None:
        super().__init__(memory.ticks)
        self._bodies = memory.bodies
        self._others = [hand.ticks for hand in memory.hands[1:]]

    def read_hands(self, most: int) -> tuple[int, list[AnyArray]]:
        """Read the ticks of all hands, see `RingReader.read`; fields of bodies follow those of the first hand's."""
        first, ticks = self.read(most)
        at = first + np.arange(len(ticks))
        bodies, *others = (ring.records[at % ring.capacity] for ring in (self._bodies, *self._others))
        parts = [(part, name) for part in (ticks, bodies) for name in part.dtype.names or ()]
        joined = np.empty(len(ticks), [(name, part.dtype[name]) for part, name in parts])
        for part, name in parts:
            joined[name] = part[name]
        return first, [joined, *others]
