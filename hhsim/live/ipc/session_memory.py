"""The shared memory of one live session: the status block, the rings, two pages of facts, and what wakes whom.

Made by the supervisor; every other process attaches to it by the descriptors that it inherits and is told on its
command line::

    --setup FD --status FD --ticks FD --samples FD --events FD --words FD --facts FD --device FD --wake FD
    --sampled FD [--free]
"""

import argparse
import json
import os
import time
import weakref
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.live.device import GLOVE_SAMPLE
from hhsim.live.ipc.status import LIVE_STATUS
from hhsim.live.real_time import name_process
from hhsim.live.shared_memory import Setup, SharedBlock, SharedRing, read_setup
from hhsim.result.schema import OBJECT_FIELDS, TICK_FIELDS, TickField

TICK_CAPACITY = 16_384
FREE_TICK_CAPACITY = 4_096
"""Of ticks with a free object, which are five times as long: 36 MB, and 4 s at 1 kHz."""
SAMPLE_CAPACITY = 16_384
EVENT_CAPACITY = 1_024
WORD_CAPACITY = 64
FACT_BYTES = 65_520


def _record(*fields: TickField) -> np.dtype[Any]:
    return np.dtype([(field.name, field.type, field.shape) for field in fields], align=True)


LIVE_TICK = _record(*TICK_FIELDS)
"""One tick of the loop; `hhsim.result.schema.LIVE_TICK_COLUMNS` says what the fields are that only a session has.

Periods that were missed leave gaps in `tick`; `input_seq` is the `seq` of the sample in use, -1 before the first.
"""
# What the object adds comes first, so that this is not a longer form of the other: numba warns of those.
FREE_TICK = _record(*OBJECT_FIELDS, *TICK_FIELDS)
"""The same where the object is free: the shown hand and its forces are then as the object sees them."""

EVENT = np.dtype([("time_ns", np.int64), ("level", np.int64), ("text", "S240")], align=True)
"""A line of the session's log: CLOCK_MONOTONIC [ns]; level 0 for information, 1 a warning, 2 a fault; UTF-8."""

FACTS = np.dtype([("version", np.int64), ("size", np.int64), ("text", np.uint8, (FACT_BYTES,))], align=True)
"""A JSON document; `version` is odd while it is being written, 0 before the first."""

EVENT_BYTES = EVENT["text"].itemsize
NOT_KNOWN_YET = ("battery", "sample_ns")
"""Fields of the status that are -1 until the loop knows better."""

REASON = 3
"""Of the driver's words alone: why the glove is gone, for when the loop tells of it."""


class Descriptors(NamedTuple):
    """Of the memory, in the order of the command line's options."""

    status: int
    ticks: int
    samples: int
    events: int
    words: int
    facts: int
    device: int
    wake: int
    sampled: int


def _close(descriptors: Descriptors) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


class FactPage:
    """A page of plain values, as JSON: one writer, any number of readers.

    Args:
        block: Of `FACTS`.
    """

    def __init__(self, block: SharedBlock) -> None:
        """Take over memory that is mapped."""
        self._block = block
        self._page = block.array[0]

    def write(self, facts: Mapping[str, Any]) -> None:
        """Replace what the page says.

        Raises:
            ValueError: More than fits.
        """
        encoded = json.dumps(facts).encode("utf-8")
        if len(encoded) > FACT_BYTES:
            raise ValueError(f"{len(encoded):,} bytes of facts; {FACT_BYTES:,} fit")
        page = self._page
        page["version"] += 1
        page["text"][: len(encoded)] = np.frombuffer(encoded, np.uint8)
        page["size"] = len(encoded)
        page["version"] += 1

    def read(self) -> dict[str, Any]:
        """What the page says, empty before it has said anything."""
        page = self._page
        while True:
            version = int(page["version"])
            if version == 0:
                return {}
            if version % 2 == 0:
                encoded = page["text"][: int(page["size"])].tobytes()
                if int(page["version"]) == version:
                    facts: dict[str, Any] = json.loads(encoded)
                    return facts
            time.sleep(1e-4)


class SessionMemory:
    """All that the processes of a session share.

    Args:
        status: Of `LIVE_STATUS`.
        ticks: Of `LIVE_TICK`, or of `FREE_TICK` where the object is free, written by the loop.
        samples: Of `GLOVE_SAMPLE`, written by the driver.
        events: Of `EVENT`, written by the loop.
        words: Of `EVENT`, written by the driver for the loop, which tells them.
        facts: Of `FACTS`, written by the loop.
        device: Of `FACTS`, written by the driver: the fields of `hhsim.live.device.GloveInfo`, and the pose's name.
        wake: Descriptor of the event by which the loop wakes the driver: there is a command.
        sampled: Of the one by which the driver wakes the loop: there is a sample.

    Attributes:
        status: The one record of `LIVE_STATUS`; `status["heartbeat_ns"]` reads and writes in place.
        device: What the driver says of its glove.
    """

    def __init__(
        self,
        status: SharedBlock,
        ticks: SharedRing,
        samples: SharedRing,
        events: SharedRing,
        words: SharedRing,
        facts: SharedBlock,
        device: SharedBlock,
        wake: int,
        sampled: int,
    ) -> None:
        """Take over memory that is mapped."""
        self.status_block = status
        self.status = status.array[0]
        self.ticks, self.samples = ticks, samples
        self.events, self.words = events, words
        self._facts, self.device = FactPage(facts), FactPage(device)
        self.wake, self.sampled = wake, sampled
        mapped = (status, ticks, samples, events, words, facts, device)
        self.descriptors = Descriptors._make([*(memory.descriptor for memory in mapped), wake, sampled])

    @classmethod
    def create(cls, *, free: bool = False) -> Self:
        """Fresh memory for a session; pass `descriptors` on to the children (`subprocess`, `pass_fds`).

        They are closed with the object that this returns.

        Args:
            free: Whether the object is free.
        """
        status = SharedBlock.create("status", LIVE_STATUS)
        for name in NOT_KNOWN_YET:
            status.array[name] = -1
        memory = cls(
            status,
            SharedRing.create("ticks", *_tick_ring(free)),
            SharedRing.create("samples", GLOVE_SAMPLE, SAMPLE_CAPACITY),
            SharedRing.create("events", EVENT, EVENT_CAPACITY),
            SharedRing.create("words", EVENT, WORD_CAPACITY),
            SharedBlock.create("facts", FACTS),
            SharedBlock.create("device", FACTS),
            os.eventfd(0, os.EFD_NONBLOCK),
            os.eventfd(0, os.EFD_NONBLOCK),
        )
        weakref.finalize(memory, _close, memory.descriptors)
        return memory

    @classmethod
    def attach(cls, descriptors: Descriptors, *, free: bool = False) -> Self:
        """Map the memory that another process made; `free` as in `create`."""
        return cls(
            SharedBlock(descriptors.status, LIVE_STATUS),
            SharedRing(descriptors.ticks, *_tick_ring(free)),
            SharedRing(descriptors.samples, GLOVE_SAMPLE, SAMPLE_CAPACITY),
            SharedRing(descriptors.events, EVENT, EVENT_CAPACITY),
            SharedRing(descriptors.words, EVENT, WORD_CAPACITY),
            SharedBlock(descriptors.facts, FACTS),
            SharedBlock(descriptors.device, FACTS),
            descriptors.wake,
            descriptors.sampled,
        )

    def populate(self) -> None:
        """Have every page that a tick reads or writes there before it does."""
        for memory in (self.status_block, self.ticks, self.samples):
            memory.populate()

    def arguments(self) -> list[str]:
        """The command line's options of a child that is to attach."""
        words = [word for name, value in self.descriptors._asdict().items() for word in (f"--{name}", str(value))]
        return [*words, "--free"] if self.ticks.records.dtype == FREE_TICK else words

    def field(self, name: str) -> AnyArray:
        """One field of the status as an array whose first axis has length 1; faster in a tick than by the record."""
        column: AnyArray = self.status_block.array[name]
        return column

    def log(self, level: int, text: str, time_ns: int | None = None) -> None:
        """Add an event; only the loop may. What does not fit is cut off between two letters.

        Args:
            level: INFORMATION, WARNING or FAULT.
            text: One line.
            time_ns: CLOCK_MONOTONIC [ns]; now by default.
        """
        _add_line(self.events, level, text, time.monotonic_ns() if time_ns is None else time_ns)

    def say(self, level: int, text: str) -> None:
        """Have the loop tell something, or know a REASON; only the driver may."""
        _add_line(self.words, level, text, time.monotonic_ns())

    def write_facts(self, facts: Mapping[str, Any]) -> None:
        """Say what is known of the session, as plain values; only the loop may, before it runs and when it has ended.

        Raises:
            ValueError: More than fits.
        """
        self._facts.write(facts)

    def read_facts(self) -> dict[str, Any]:
        """What the loop says of the session, empty before it has said anything.

        | key | meaning |
        |---|---|
        | real_time | the achieved mode, `hhsim.live.real_time` |
        | device | name, hand, channels, unit, capabilities, doubtful |
        | pose | name of the source of the palm's pose |
        | summary | when it has ended: ticks, missed, wakeup and latency with their percentiles [ns], counters, reason |
        """
        return self._facts.read()


def _tick_ring(free: bool) -> tuple[np.dtype[Any], int]:
    return (FREE_TICK, FREE_TICK_CAPACITY) if free else (LIVE_TICK, TICK_CAPACITY)


def _add_line(ring: SharedRing, level: int, text: str, time_ns: int) -> None:
    slot = ring.slot()
    slot["time_ns"] = time_ns
    slot["level"] = level
    encoded = text.encode("utf-8", "replace")[:EVENT_BYTES]
    slot["text"] = encoded.decode("utf-8", "ignore").encode("utf-8")
    ring.publish()


def add_memory_options(parser: argparse.ArgumentParser) -> None:
    """The options of every process of a session: its setup and its memory, by descriptor."""
    for name in ("setup", *Descriptors._fields):
        parser.add_argument(f"--{name}", type=int, required=True, metavar="FD")
    parser.add_argument("--free", action="store_true", help="the object is free")


def attached(options: argparse.Namespace) -> SessionMemory:
    """The memory that the options of `add_memory_options` name."""
    descriptors = Descriptors(*(getattr(options, name) for name in Descriptors._fields))
    return SessionMemory.attach(descriptors, free=options.free)


def session_process(
    name: str, kind: type[Setup], arguments: Sequence[str] | None = None
) -> tuple[Setup, SessionMemory]:
    """Name this process of a session, and return the setup and the memory that its command line hands it."""
    name_process(name)
    parser = argparse.ArgumentParser(prog=f"hhsim-{name}")
    add_memory_options(parser)
    options = parser.parse_args(arguments)
    return read_setup(options.setup, kind), attached(options)
