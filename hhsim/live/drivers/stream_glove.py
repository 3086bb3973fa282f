"""Base class of gloves at the other end of a byte stream: a TCP connection or a serial line."""

import time
from abc import abstractmethod
from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import DeviceCounters, DeviceError, GloveDevice
from hhsim.live.link.byte_stream import ByteLink

MOST_MESSAGES = 256
"""Most messages read in one call, so that a flood cannot delay the driver."""
MOST_MALFORMED = 20
"""Malformed messages in a row that count as lost framing."""


class StreamGlove(GloveDevice):
    """Glove whose samples are messages of a byte stream, which begin anew with each connection."""

    def __init__(self, link: ByteLink) -> None:
        self._link = link
        self._connection = 0
        # Whole messages that were not read yet, each with CLOCK_MONOTONIC of its last byte [ns].
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._lost: DeviceError | None = None  # reason why the glove is gone; None while it is there
        self._malformed_run = 0
        self.counters = DeviceCounters()

    @abstractmethod
    def _begin_stream(self) -> None:
        """Reset what belongs to a connection: a new one begins with a new message."""

    @abstractmethod
    def _cut(self, data: bytes) -> Iterable[bytes]:
        """Append what has arrived; returns the messages that are whole now."""

    @abstractmethod
    def _store(self, message: bytes, now: int, row: np.void) -> int:
        """Count a message that came at `now` [ns], write its sample and return 1; 0 for a message without one."""

    @abstractmethod
    def _release_message(self) -> bytes:
        """Return the bytes that free all fingers, whatever was sent before them."""

    def drain(self) -> None:
        """See `GloveDevice.drain`."""
        self._link.drain()

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        if self._lost is None:
            try:
                self._receive()
            except DeviceError as error:
                # Messages received before the end are still read.
                self._lost = error
        count = 0
        for _ in range(MOST_MESSAGES):
            if not self._waiting or count == len(samples_out):
                break
            count += self._store(*self._waiting.popleft(), samples_out[count])
        if count == 0 and self._lost is not None and not self._waiting:
            raise self._lost
        return count

    def descriptors(self) -> tuple[int, ...]:
        """See `GloveDevice.descriptors`."""
        return (self._link.descriptor(),) if self._link.connected else ()

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`; opens a fresh connection where this one takes nothing."""
        sent = self._link.send_within(self._release_message(), timeout)
        self._renew()
        self.counters.commands += sent
        return sent

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; does not wait for a sample."""
        if not self._link.reconnect():
            return False
        self._lost = None
        self._renew()
        return True

    def close(self) -> None:
        """See `GloveDevice.close`."""
        self._link.close()

    def _connect(self, timeout: float) -> None:
        """Connect within `timeout` [s], and forget what came before; raises DeviceError if there is no glove."""
        self._link.connect(timeout)
        self._connection = self._link.connection
        self._waiting.clear()
        self._lost, self._malformed_run = None, 0
        self._begin_stream()

    def _renew(self) -> None:
        """Begin the stream anew if the link has a new connection."""
        if self._link.connection != self._connection:
            self._connection = self._link.connection
            self._lost, self._malformed_run = None, 0
            self._begin_stream()
            self.counters.resyncs += 1

    def _receive(self) -> bytes:
        """Cut what has arrived into `_waiting`; returns it."""
        data = self._link.receive() or b""
        now = time.monotonic_ns()
        self._waiting.extend((message, now) for message in self._cut(data))
        return data

    def _send(self, data: bytes) -> bool:
        """Send a command, and count it."""
        if self._link.send(data):
            self.counters.commands += 1
            return True
        self.counters.commands_refused += 1
        return False
