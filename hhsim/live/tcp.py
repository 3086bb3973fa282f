"""TCP connection for a real-time loop: only `connect` waits, and nothing is sent by halves."""

import contextlib
import errno
import fcntl
import select
import socket
import sys
import termios
import time
from typing import Any

from hhsim.live.device import DeviceError

MOST_READ = 16_384
"""Bytes read at once, so that a peer that floods cannot delay a tick."""
MOST_UNSENT = 1024
"""Unacknowledged bytes beyond which only urgent data are sent."""
RETRY = 0.05
"""Time between two attempts to reconnect [s]."""
GIVE_UP = 2.0
"""Longest duration of an attempt without an answer, and of a connection that is given up [s]."""
LINGER = 0.05
"""Longest wait for the peer to read everything before closing [s]."""
MOST_DRAINED = 4
ACKNOWLEDGED = 5000
"""Time without an acknowledgement after which the peer is gone [ms]."""


class TcpLink:
    """Connection to a server, on which bytes are sent whole or not at all.

    `name` is that of the device in messages, "dexmo at 127.0.0.1:55555"; `connection` counts the connections.
    """

    def __init__(self, host: str, port: int, name: str) -> None:
        self.name = name
        self.host, self.port = host, port
        self.connection = 0
        self._rest = b""
        self._socket: socket.socket | None = None
        self._begun: socket.socket | None = None
        self._begun_at = -RETRY
        self._retired: socket.socket | None = None
        self._retired_at = 0.0
        self._address: tuple[int, Any] | None = None

    def descriptors(self) -> tuple[int, ...]:
        """Return the file descriptor of the connection, () if there is none, as far as is known."""
        return () if self._socket is None else (self._socket.fileno(),)

    def connect(self, timeout: float) -> None:
        """Connect within `timeout` [s]; raises DeviceError with the reason if that is not possible."""
        self.close()
        try:
            link = _connected(self.host, self.port, timeout)
            self._address = link.family, link.getpeername()
        except (socket.gaierror, UnicodeError) as error:
            raise DeviceError(f"{self.name}: no such host ({getattr(error, 'strerror', 'not a name')})") from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise DeviceError(
                f"{self.name}: cannot connect ({reason}): is its server running, and the port right?"
            ) from None
        self._attach(link)

    def reconnect(self) -> bool:
        """Try again without waiting; True if there is a connection."""
        if self._socket is not None:
            return True
        now = time.monotonic()
        if self._begun is None:
            if self._address is None or now - self._begun_at < RETRY:
                return False
            family, address = self._address
            self._begun, self._begun_at = socket.socket(family, socket.SOCK_STREAM), now
            self._begun.setblocking(False)
            # Its outcome is read from the socket, now or later.
            self._begun.connect_ex(address)
        begun = self._begun
        if ready(begun.fileno(), select.POLLOUT, 0.0):
            self._begun = None
            if not begun.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) and not is_itself(begun):
                self._attach(begun)
                return True
            begun.close()
        elif now - self._begun_at > GIVE_UP:
            self._abandon()
        return False

    def drain(self) -> None:
        """Discard what has arrived, at most `MOST_DRAINED` reads; DeviceError if the peer is gone."""
        for _ in range(MOST_DRAINED):
            if self.receive() is None:
                return

    def retire(self) -> None:
        """End the connection without waiting; it stays open for `GIVE_UP`, so that the peer reads what it was sent."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_WR)
            self._bury()
            self._retired, self._retired_at = self._socket, time.monotonic()
        self._socket, self._rest = None, b""

    def _bury(self) -> None:
        if self._retired is not None:
            self._retired.close()
            self._retired = None

    def close(self, linger: float = LINGER) -> None:
        """Close when the peer has read what it was sent, at most `linger` [s] later; never raises."""
        self._abandon()
        self.retire()
        link, self._retired = self._retired, None
        if link is not None:
            deadline = time.monotonic() + linger
            with link, contextlib.suppress(OSError):
                # A socket closed over unread bytes resets the connection, and the peer may lose the last command.
                while (left := deadline - time.monotonic()) > 0.0:
                    if not ready(link.fileno(), select.POLLIN, left) or not link.recv(MOST_READ):
                        break

    def _let_go(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._rest = None, b""

    def _attach(self, link: socket.socket) -> None:
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, ACKNOWLEDGED)
        self._socket, self._rest = link, b""
        self.connection += 1

    def _abandon(self) -> None:
        if self._begun is not None:
            self._begun.close()
            self._begun = None

    def receive(self) -> bytes | None:
        """Return what has arrived, None if nothing has; raises DeviceError if the peer is gone."""
        link = self._open_socket()
        if self._retired is not None and time.monotonic() - self._retired_at > GIVE_UP:
            self._bury()
        try:
            data = link.recv(MOST_READ)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        if not data:
            raise self._gone("its server closed the connection")
        return data

    def send(self, data: bytes, *, urgent: bool = False) -> bool:
        """Send all of it or nothing, without waiting; False if the peer takes no more now, DeviceError if it is gone.

        Urgent data are sent to a peer with more than `MOST_UNSENT` bytes too.
        """
        link = self._open_socket()
        try:
            if self._rest:
                # A command that was sent by half has to be completed first.
                self._rest = self._rest[link.send(self._rest) :]
                if self._rest:
                    return False
            if not urgent:
                unsent = fcntl.ioctl(link, termios.TIOCOUTQ, bytes(4))
                if int.from_bytes(unsent, sys.byteorder) > MOST_UNSENT:
                    return False
            self._rest = data[link.send(data) :]
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        return True

    def send_within(self, data: bytes, timeout: float) -> bool:
        """Send data within `timeout` [s] on this connection, else on a new one; never raises, True if it was sent."""
        deadline = time.monotonic() + timeout
        # Half of the time is kept for the new connection.
        if self._send_until(data, deadline - timeout / 2.0):
            return True
        if self._address is None:
            return False
        host, port, *_ = self._address[1]
        try:
            fresh = _connected(host, port, deadline - time.monotonic())
        except OSError:
            return False
        self._let_go()
        self._abandon()
        self._attach(fresh)
        return self._send_until(data, deadline)

    def _send_until(self, data: bytes, deadline: float) -> bool:
        try:
            sent = self.send(data, urgent=True)
            while not sent or self._rest:
                left = deadline - time.monotonic()
                if left <= 0.0:
                    return False
                ready(self._open_socket().fileno(), select.POLLOUT, left)
                # Empty data complete a message that was sent by half.
                sent = self.send(b"" if sent else data, urgent=True) or sent
        except (DeviceError, OSError):
            return False
        return True

    def wait(self, timeout: float) -> None:
        """Wait until something has arrived, at most `timeout` [s]."""
        if self._socket is not None:
            ready(self._socket.fileno(), select.POLLIN, timeout)

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise DeviceError(f"{self.name}: not connected")
        return self._socket

    def _gone(self, reason: str) -> DeviceError:
        self._let_go()
        return DeviceError(f"{self.name}: gone: {reason}")


def _connected(host: str, port: int, timeout: float) -> socket.socket:
    link = socket.create_connection((host, port), max(timeout, 1e-3))
    if is_itself(link):
        link.close()
        raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
    return link


def is_itself(link: socket.socket) -> bool:
    """Return True if a socket is connected to itself, or to nothing.

    The ports of gloves lie in the range for clients: if nothing listens on one, the system may give that very port to a
    client on the same machine, which then reads its own commands.
    """
    try:
        return bool(link.getsockname() == link.getpeername())
    except OSError:
        return True


def ready(descriptor: int, event: int, timeout: float) -> bool:
    """Wait at most `timeout` [s] for an event of `select.poll` or the end of the line; True if there is one."""
    poll = select.poll()
    poll.register(descriptor, event)
    return bool(poll.poll(max(0.0, 1e3 * timeout)))
