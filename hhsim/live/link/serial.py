"""Serial line for a real-time loop: only `connect` waits, and nothing is sent by halves.

It needs POSIX termios alone: USB serial adapters, Bluetooth serial (rfcomm) and pseudo-terminals. Several processes may
have the same line open, as the watchdog needs; only one of them reads.
"""

import contextlib
import errno
import os
import termios

from hhsim.errors import InputError
from hhsim.live.device import DeviceError
from hhsim.live.link.byte_stream import MOST_READ, ByteLink, ready

SPEEDS = {
    int(name[1:]): value for name, value in vars(termios).items() if name[:1] == "B" and name[1:].isdigit() and value
}
"""Baud rates of this system."""


class SerialLink(ByteLink):
    """A serial line such as /dev/ttyUSB0, 8 bits, no parity, one stop bit, raw; InputError for an unknown baud rate."""

    MOST_UNSENT = 26
    """About 2 ms at 115,200 baud."""
    NOT_OPEN, ENDED = "not open", "the line was closed"

    def __init__(self, path: str, baud: int, name: str) -> None:
        if baud not in SPEEDS:
            raise InputError(f"{name}: {baud} baud; expected one of {', '.join(map(str, sorted(SPEEDS)))}")
        super().__init__(name)
        self.path = path
        self._speed = SPEEDS[baud]
        self._file = -1

    def descriptor(self) -> int:
        """Return the file descriptor of the open line, -1 if none is."""
        return self._file

    def connect(self, timeout: float) -> None:
        """See `ByteLink.connect`: there is a line, it is a serial one, and it may be used."""
        self.close()
        try:
            self._open()
        except OSError as error:
            hint = {
                errno.ENOENT: "; is the glove plugged in?",
                errno.EACCES: "; may your user use serial lines (group dialout)?",
                errno.EBUSY: "; does another program have it?",
            }.get(error.errno or 0, "")
            raise DeviceError(f"{self.name}: cannot open: {error.strerror or error}{hint}") from None
        except termios.error:
            raise DeviceError(f"{self.name}: not a serial line; expected one such as /dev/ttyUSB0") from None

    def reconnect(self) -> bool:
        """See `ByteLink.reconnect`."""
        with contextlib.suppress(OSError, termios.error):
            if not self.connected:
                self._open()
        return self.connected

    def drain(self) -> None:
        """See `ByteLink.drain`; bytes are left to the one process that reads the line."""
        self._require_open()
        if ready(self._file, 0, 0.0):
            raise self._gone(self.ENDED)

    def _reopen(self, timeout: float) -> None:
        # A line that was unplugged and is back needs a new descriptor.
        self._let_go()
        self._open()

    def _discard_unsent(self) -> None:
        if self.connected:
            termios.tcflush(self._file, termios.TCOFLUSH)
            self._rest = b""

    def _read(self) -> bytes:
        return os.read(self._file, MOST_READ)

    def _write(self, data: bytes) -> int:
        return os.write(self._file, data)

    def _let_go(self) -> None:
        if self._file >= 0:
            with contextlib.suppress(OSError):
                os.close(self._file)
        self._file, self._rest = -1, b""

    def _open(self) -> None:
        self._file = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            mode = termios.tcgetattr(self._file)
            mode[0] = mode[1] = mode[3] = 0
            # Without HUPCL: closing one of several descriptors must not reset the board.
            mode[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
            mode[4] = mode[5] = self._speed
            # VMIN 1: reading a silent line differs from reading one that is gone.
            mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
            termios.tcsetattr(self._file, termios.TCSANOW, mode)
        except termios.error:
            self._let_go()
            raise
        self._rest = b""
        self.connection += 1
