"""A serial line that a real-time loop can hold: nothing waits but `connect`, and nothing is sent by halves.

By POSIX termios alone: USB serial adapters, Bluetooth serial (rfcomm) and pseudo-terminals. Several processes may have
the same line open, which the guardian needs; only one of them reads.
"""

import contextlib
import errno
import fcntl
import os
import select
import struct
import termios
import time

from hhsim.errors import InputError
from hhsim.live.glove_device import DeviceError

MOST_READ = 16_384
"""Bytes taken at once, so that a glove that floods cannot hold up a tick."""
MOST_UNSENT = 26
"""Bytes on their way [about 2 ms at 115,200 baud]; with more, a command would come late and is not sent."""
RETRY_NS = 50_000_000
"""Between two attempts to open the line again [ns]."""
SPEEDS = {
    int(name[1:]): value for name, value in vars(termios).items() if name[:1] == "B" and name[1:].isdigit() and value
}
"""Baud rates of this system."""


class SerialLink:
    """A serial line, 8 bits, no parity, one stop bit, raw.

    Args:
        path: of the line, such as /dev/ttyUSB0.
        baud: bits per second.
        name: of the device in messages.

    Attributes:
        connection: counts how often the line was opened.

    Raises:
        InputError: a baud rate that this system does not know.
    """

    def __init__(self, path: str, baud: int, name: str) -> None:
        """Nothing is opened yet."""
        if baud not in SPEEDS:
            raise InputError(f"{name}: {baud} baud; expected one of {', '.join(map(str, sorted(SPEEDS)))}")
        self.path, self.name, self.connection = path, name, 0
        self._speed = SPEEDS[baud]
        self._file = -1
        self._rest = b""
        self._last_try = -RETRY_NS

    @property
    def connected(self) -> bool:
        """Whether the line is open, as far as is known."""
        return self._file >= 0

    def connect(self, timeout: float) -> None:
        """Open the line.

        Raises:
            DeviceError: no such line, no permission, or no serial line.
        """
        self.close()
        try:
            self._open()
        except OSError as error:
            hint = {
                errno.ENOENT: "is the glove plugged in?",
                errno.EACCES: "may your user use serial lines (group dialout)?",
                errno.EBUSY: "does another program have it?",
            }.get(error.errno or 0, "")
            raise DeviceError(
                f"{self.name}: cannot open: {error.strerror or error}{'; ' if hint else ''}{hint}"
            ) from None
        except termios.error:
            self.close()
            raise DeviceError(f"{self.name}: not a serial line; expected one such as /dev/ttyUSB0") from None

    def reconnect(self) -> bool:
        """Try again without waiting; True where the line is open."""
        if self.connected:
            return True
        now = time.monotonic_ns()
        if now - self._last_try < RETRY_NS:
            return False
        self._last_try = now
        try:
            self._open()
        except (OSError, termios.error):
            self.close()
            return False
        return True

    def receive(self) -> bytes | None:
        """What has arrived; None where nothing has.

        Raises:
            DeviceError: the line is gone.
        """
        if self._file < 0:
            raise DeviceError(f"{self.name}: not open")
        try:
            data = os.read(self._file, MOST_READ)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        if not data:
            raise self._gone("the line was closed")
        return data

    def send(self, data: bytes, *, urgent: bool = False) -> bool:
        """Send all of it or nothing, without waiting.

        Args:
            data: to send.
            urgent: also to a glove that is slow to take what it was sent.

        Returns:
            False where the glove takes no more now.

        Raises:
            DeviceError: the line is gone.
        """
        if self._file < 0:
            raise DeviceError(f"{self.name}: not open")
        try:
            if self._rest:
                # What was sent by half must be ended, or the glove would take the next for the rest of it.
                self._rest = self._rest[os.write(self._file, self._rest) :]
                if self._rest:
                    return False
            if not urgent and self._unsent() > MOST_UNSENT:
                return False
            self._rest = data[os.write(self._file, data) :]
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        return True

    def check(self) -> None:
        """Look whether the line is still there, without reading from it.

        Raises:
            DeviceError: the line is gone.
        """
        if self._file < 0:
            raise DeviceError(f"{self.name}: not open")
        if self._ready(0, 0.0):
            raise self._gone("the line was closed")

    def send_within(self, data: bytes, timeout: float) -> bool:
        """Send all of it before anything that still waits, on this line or one opened anew; never raises.

        Args:
            data: to send; begins with an end of line, since what waited may have been cut off.
            timeout: longest wait [s].

        Returns:
            Whether it was handed to the system.
        """
        deadline = time.monotonic() + timeout
        # A line that was unplugged and is back needs a descriptor of its own.
        for _ in range(2):
            try:
                if self._file < 0:
                    self._open()
                return self._send_until(data, deadline)
            except (OSError, termios.error):
                self.close()
        return False

    def _send_until(self, data: bytes, deadline: float) -> bool:
        # What the glove has not been told yet is out of date.
        termios.tcflush(self._file, termios.TCOFLUSH)
        self._rest = b""
        while data:
            try:
                data = data[os.write(self._file, data) :]
            except BlockingIOError:
                left = deadline - time.monotonic()
                if left <= 0.0:
                    return False
                self._ready(select.POLLOUT, left)
        return True

    def wait(self, timeout: float) -> None:
        """Wait until something has arrived, or for so long [s]."""
        if self._file >= 0:
            self._ready(select.POLLIN, timeout)

    def close(self) -> None:
        """Let go of the line; never raises."""
        if self._file >= 0:
            with contextlib.suppress(OSError):
                os.close(self._file)
        self._file, self._rest = -1, b""

    def _open(self) -> None:
        self._file = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        mode = termios.tcgetattr(self._file)
        mode[0] = mode[1] = mode[3] = 0
        # Without HUPCL: closing one of several descriptors must not reset the board.
        mode[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
        mode[4] = mode[5] = self._speed
        # With VMIN 0, a line that is silent could not be told from one that is gone.
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._file, termios.TCSANOW, mode)
        self._rest = b""
        self.connection += 1

    def _gone(self, reason: str) -> DeviceError:
        self.close()
        return DeviceError(f"{self.name}: gone: {reason}")

    def _unsent(self) -> int:
        answer = fcntl.ioctl(self._file, termios.TIOCOUTQ, bytes(4))
        return int(struct.unpack("i", answer)[0])

    def _ready(self, event: int, timeout: float) -> bool:
        """Wait for an event, or the end of the line, for so long [s]; True where there is one."""
        poll = select.poll()
        poll.register(self._file, event)
        return bool(poll.poll(max(0.0, 1e3 * timeout)))
