"""TCP connection for a real-time loop: only `connect` waits, and nothing is sent by halves."""

import contextlib
import errno
import select
import socket
import time
from typing import Any

from hhsim.live.device import DeviceError
from hhsim.live.link.byte_stream import MOST_READ, ByteLink, ready

RETRY = 0.05
"""Time between two attempts to reconnect [s]."""
GIVE_UP = 2.0
"""Longest duration of an attempt without an answer [s]."""
LINGER = 0.05
"""Longest wait for the peer to read everything before closing [s]."""
ACKNOWLEDGED = 5000
"""Time without an acknowledgement after which the peer is gone [ms]."""

WAITING = (errno.EINPROGRESS, errno.EAGAIN, errno.EWOULDBLOCK, errno.EALREADY, errno.EINTR)


class TcpLink(ByteLink):
    """Connection to a server; `name` is that of the device in messages."""

    MOST_UNSENT = 1024
    NOT_OPEN, ENDED = "not connected", "its server closed the connection"

    def __init__(self, host: str, port: int, name: str) -> None:
        super().__init__(name)
        self.host, self.port = host, port
        self._socket: socket.socket | None = None
        self._begun: socket.socket | None = None
        self._retired: socket.socket | None = None
        self._retired_at = 0.0
        self._begun_at = self._last_try = -GIVE_UP
        self._address: tuple[int, Any] | None = None

    def descriptor(self) -> int:
        """Return the file descriptor of the connection, -1 if there is none."""
        return -1 if self._socket is None else self._socket.fileno()

    def connect(self, timeout: float) -> None:
        """Connect within `timeout` [s]; raises DeviceError if there is no such host, or nothing that answers."""
        self.close()
        deadline = time.monotonic() + timeout
        try:
            found = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)
        except OSError as error:
            raise DeviceError(f"{self.name}: no such host ({error.strerror or error})") from None
        except UnicodeError:
            raise DeviceError(f"{self.name}: no such host (not a name)") from None
        reason = "no address"
        for family, _, _, _, address in found:
            self._address = (family, address)
            try:
                self._attach(_connected(family, address, max(0.0, deadline - time.monotonic())))
                return
            except OSError as error:
                reason = error.strerror or str(error)
        raise DeviceError(f"{self.name}: cannot connect ({reason}): is its server running, and the port right?")

    def reconnect(self) -> bool:
        """Try again without waiting; True if there is a connection."""
        self._drain_retired()
        if self._socket is not None:
            return True
        now = time.monotonic()
        if self._begun is None:
            if self._address is None or now - self._last_try < RETRY:
                return False
            self._last_try = self._begun_at = now
            family, address = self._address
            try:
                self._begun = socket.socket(family, socket.SOCK_STREAM)
                self._begun.setblocking(False)
                failed = self._begun.connect_ex(address) not in (0, *WAITING)
            except OSError:
                failed = True
            if failed:
                self._abandon()
                return False
        begun = self._begun
        assert begun is not None
        if not ready(begun.fileno(), select.POLLOUT, 0.0):
            if now - self._begun_at > GIVE_UP:
                self._abandon()
            return False
        if begun.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) or _is_itself(begun):
            self._abandon()
            return False
        self._begun = None
        self._attach(begun)
        return True

    def receive(self) -> bytes | None:
        """Return what has arrived, None if nothing has; raises DeviceError if the peer is gone."""
        self._drain_retired()
        return super().receive()

    def send_within(self, data: bytes, timeout: float) -> bool:
        """Send data within `timeout` [s] on this connection, else on a fresh one; never raises, True if it was sent."""
        deadline = time.monotonic() + timeout
        # Half of the time is kept for the fresh connection.
        if self._send_until(data, time.monotonic() + timeout / 2.0):
            return True
        if self._address is None:
            return False
        family, address = self._address
        try:
            fresh = _connected(family, address, max(0.0, deadline - time.monotonic()))
        except OSError:
            return False
        self._let_go()
        self._abandon()
        self._attach(fresh)
        return self._send_until(data, deadline)

    def retire(self) -> None:
        """Close without waiting; `reconnect` and `receive` let the peer read what it was sent."""
        self._drop_retired()
        self._retired, self._socket, self._rest = self._socket, None, b""
        self._retired_at = time.monotonic()
        if self._retired is not None:
            with contextlib.suppress(OSError):
                self._retired.shutdown(socket.SHUT_WR)

    def close(self, linger: float = LINGER) -> None:
        """Close when the peer has read what it was sent, at most `linger` [s] later; never raises."""
        self._abandon()
        self._drop_retired()
        if self._socket is None:
            return
        link, self._socket, self._rest = self._socket, None, b""
        deadline = time.monotonic() + linger
        with contextlib.suppress(OSError):
            # A socket closed over unread bytes resets the connection, and the peer may lose the last command.
            link.shutdown(socket.SHUT_WR)
            while (left := deadline - time.monotonic()) > 0.0:
                if not ready(link.fileno(), select.POLLIN, left) or not link.recv(MOST_READ):
                    break
        link.close()

    def _send_until(self, data: bytes, deadline: float) -> bool:
        try:
            while not self.send(data, urgent=True):
                left = deadline - time.monotonic()
                if left <= 0.0 or self._socket is None:
                    return False
                ready(self._socket.fileno(), select.POLLOUT, left)
            while self._rest and self._socket is not None:
                left = deadline - time.monotonic()
                if left <= 0.0:
                    return False
                ready(self._socket.fileno(), select.POLLOUT, left)
                self._rest = self._rest[self._socket.send(self._rest) :]
        except (DeviceError, OSError):
            return False
        return True

    def _read(self) -> bytes:
        assert self._socket is not None
        return self._socket.recv(MOST_READ)

    def _write(self, data: bytes) -> int:
        assert self._socket is not None
        return self._socket.send(data)

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

    def _drain_retired(self) -> None:
        if self._retired is None:
            return
        try:
            over = time.monotonic() - self._retired_at > GIVE_UP or not self._retired.recv(MOST_READ)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            over = True
        if over:
            self._drop_retired()

    def _drop_retired(self) -> None:
        if self._retired is not None:
            self._retired.close()
            self._retired = None


def _connected(family: int, address: Any, timeout: float) -> socket.socket:
    link = socket.socket(family, socket.SOCK_STREAM)
    try:
        link.settimeout(max(timeout, 1e-3))
        link.connect(address)
        if _is_itself(link):
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
    except BaseException:
        link.close()
        raise
    return link


def _is_itself(link: socket.socket) -> bool:
    """Return True if a socket is connected to itself.

    The ports of gloves lie in the range for clients: if nothing listens on one, the system may give that very port to a
    client on the same machine, which then reads its own commands.
    """
    try:
        return bool(link.getsockname() == link.getpeername())
    except OSError:
        return True
