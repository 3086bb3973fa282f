"""Common part of a serial line and a TCP connection: bytes are sent whole or not at all, and nothing waits."""

import fcntl
import select
import sys
import termios
import time
from abc import ABC, abstractmethod
from typing import ClassVar

from hhsim.live.device import DeviceError

MOST_READ = 16_384
"""Bytes read at once, so that a peer that floods cannot delay a tick."""


class ByteLink(ABC):
    """A byte stream to a glove or to its server; a subclass opens, closes, reads and writes it.

    `name` is that of the device in messages, "dexmo at 127.0.0.1:55555"; `connection` counts the openings of the line.
    """

    MOST_UNSENT: ClassVar[int]
    """Unacknowledged bytes beyond which only urgent data are sent."""
    NOT_OPEN: ClassVar[str]
    """Message of an error if nothing is open."""
    ENDED: ClassVar[str]
    """Message of an error if the peer has ended it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.connection = 0
        self._rest = b""

    @abstractmethod
    def descriptor(self) -> int:
        """Return the file descriptor of the open line, -1 if none is."""

    @abstractmethod
    def connect(self, timeout: float) -> None:
        """Open the line within `timeout` [s]; raises DeviceError with the reason if that is not possible."""

    @abstractmethod
    def reconnect(self) -> bool:
        """Try again without waiting; True if the line is open."""

    @abstractmethod
    def drain(self) -> None:
        """Discard what has arrived for this line alone, without waiting; raises DeviceError if the peer is gone."""

    @abstractmethod
    def _read(self) -> bytes:
        """Read at most `MOST_READ` bytes; raises BlockingIOError if nothing has arrived."""

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Hand as many bytes to the system as it takes; returns their number."""

    @abstractmethod
    def _reopen(self, timeout: float) -> None:
        """Open the line anew within `timeout` [s] and close the old one; raises OSError or termios.error."""

    def _discard_unsent(self) -> None:
        """Discard what the system has not sent yet, if it can do that; by default nothing."""
        return

    @abstractmethod
    def _let_go(self) -> None:
        """Close the line if it is open, without waiting; never raises."""

    def close(self) -> None:
        """Close the line; never raises."""
        self._let_go()

    @property
    def connected(self) -> bool:
        """True if the line is open, as far as is known."""
        return self.descriptor() >= 0

    def receive(self) -> bytes | None:
        """Return what has arrived, None if nothing has; raises DeviceError if the peer is gone."""
        self._require_open()
        try:
            data = self._read()
        except (BlockingIOError, InterruptedError):
            return None
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        if not data:
            raise self._gone(self.ENDED)
        return data

    def send(self, data: bytes, *, urgent: bool = False) -> bool:
        """Send all of it or nothing, without waiting; False if the peer takes no more now, DeviceError if it is gone.

        Urgent data are sent to a peer with more than `MOST_UNSENT` bytes too.
        """
        self._require_open()
        try:
            if self._rest:
                # A command that was sent by half has to be completed first.
                self._rest = self._rest[self._write(self._rest) :]
                if self._rest:
                    return False
            if not urgent:
                unsent = fcntl.ioctl(self.descriptor(), termios.TIOCOUTQ, bytes(4))
                if int.from_bytes(unsent, sys.byteorder) > self.MOST_UNSENT:
                    return False
            self._rest = data[self._write(data) :]
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        return True

    def send_within(self, data: bytes, timeout: float) -> bool:
        """Send data within `timeout` [s] on this line, else on one opened anew; never raises, True if it was sent."""
        deadline = time.monotonic() + timeout
        # Half of the time is kept for the new line.
        if self._send_until(data, deadline - timeout / 2.0):
            return True
        try:
            self._reopen(max(0.0, deadline - time.monotonic()))
        except (OSError, termios.error):
            return False
        return self._send_until(data, deadline)

    def _send_until(self, data: bytes, deadline: float) -> bool:
        try:
            self._discard_unsent()
            sent = self.send(data, urgent=True)
            while not sent or self._rest:
                left = deadline - time.monotonic()
                if left <= 0.0:
                    return False
                ready(self.descriptor(), select.POLLOUT, left)
                # Empty data complete a message that was sent by half.
                sent = self.send(b"" if sent else data, urgent=True) or sent
        except (DeviceError, OSError, termios.error):
            return False
        return True

    def wait(self, timeout: float) -> None:
        """Wait until something has arrived, at most `timeout` [s]."""
        if self.connected:
            ready(self.descriptor(), select.POLLIN, timeout)

    def _require_open(self) -> None:
        if not self.connected:
            raise DeviceError(f"{self.name}: {self.NOT_OPEN}")

    def _gone(self, reason: str) -> DeviceError:
        self._let_go()
        return DeviceError(f"{self.name}: gone: {reason}")


def ready(descriptor: int, event: int, timeout: float) -> bool:
    """Wait at most `timeout` [s] for an event of `select.poll` or the end of the line; True if there is one."""
    poll = select.poll()
    poll.register(descriptor, event)
    return bool(poll.poll(max(0.0, 1e3 * timeout)))
