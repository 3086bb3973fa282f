"""What a serial line and a TCP connection share: a real-time loop sends over them whole or not at all, and never waits.

A subclass opens and closes the line, and moves bytes; here is what is said of bytes that did not move.
"""

import fcntl
import select
import struct
import termios
from abc import ABC, abstractmethod
from typing import ClassVar

from hhsim.live.device import DeviceError

MOST_READ = 16_384
"""Bytes taken at once, so that a peer that floods cannot hold up a tick; the rest waits its turn."""


class ByteLink(ABC):
    """A line of bytes to a glove or to its server.

    Args:
        name: Of the device in messages, as "dexmo at 127.0.0.1:55555".

    Attributes:
        connection: Counts how often the line was opened.
    """

    MOST_UNSENT: ClassVar[int]
    """Bytes on their way that the peer has not taken; with more, what is not urgent is not sent."""
    NOT_OPEN: ClassVar[str]
    """What is said where nothing is open."""
    ENDED: ClassVar[str]
    """What is said where the peer has ended it."""

    def __init__(self, name: str) -> None:
        """Nothing is open yet."""
        self.name = name
        self.connection = 0
        self._rest = b""

    @abstractmethod
    def descriptor(self) -> int:
        """The file descriptor of the open line, -1 where none is."""

    @abstractmethod
    def _read(self) -> bytes:
        """Take what has arrived, at most `MOST_READ` bytes; raises BlockingIOError where nothing has."""

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Hand as much of it to the system as it takes; returns how much."""

    @abstractmethod
    def _let_go(self) -> None:
        """Close what is open, without waiting; never raises."""

    def close(self) -> None:
        """Let go of the line; never raises."""
        self._let_go()

    @property
    def connected(self) -> bool:
        """Whether the line is open, as far as is known."""
        return self.descriptor() >= 0

    def receive(self) -> bytes | None:
        """What has arrived; None where nothing has.

        Raises:
            DeviceError: The peer is gone.
        """
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
        """Send all of it or nothing, without waiting.

        Args:
            urgent: Also to a peer that is slow to take what it was sent.

        Returns:
            False where the peer takes no more now.

        Raises:
            DeviceError: The peer is gone.
        """
        self._require_open()
        try:
            if self._rest:
                # What was sent by half must be ended, or the peer would take the next for the rest of it.
                self._rest = self._rest[self._write(self._rest) :]
                if self._rest:
                    return False
            if not urgent and self._unsent() > self.MOST_UNSENT:
                return False
            self._rest = data[self._write(data) :]
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        return True

    def wait(self, timeout: float) -> None:
        """Wait until something has arrived, or for so long [s]."""
        if self.connected:
            ready(self.descriptor(), select.POLLIN, timeout)

    def _require_open(self) -> None:
        if not self.connected:
            raise DeviceError(f"{self.name}: {self.NOT_OPEN}")

    def _gone(self, reason: str) -> DeviceError:
        self._let_go()
        return DeviceError(f"{self.name}: gone: {reason}")

    def _unsent(self) -> int:
        answer = fcntl.ioctl(self.descriptor(), termios.TIOCOUTQ, bytes(4))
        return int(struct.unpack("i", answer)[0])


def ready(descriptor: int, event: int, timeout: float) -> bool:
    """Wait for an event of `select.poll`, or for the end of the line, so long [s]; True where there is one."""
    poll = select.poll()
    poll.register(descriptor, event)
    return bool(poll.poll(max(0.0, 1e3 * timeout)))
