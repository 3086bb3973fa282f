"""TCP connection for a real-time loop: only `connect` waits, and nothing is sent by halves."""

import contextlib
import errno
import select
import socket
import threading
import time
from typing import Any

from hhsim.live.device import DeviceError
from hhsim.live.link.byte_stream import MOST_READ, ByteLink, ready

RETRY = 0.05
"""Time between two attempts to reconnect [s]."""
GIVE_UP = 2.0
"""Longest duration of an attempt without an answer, and of a connection that is given up [s]."""
LINGER = 0.05
"""Longest wait for the peer to read everything before closing [s]."""
MOST_DRAINED = 4
ACKNOWLEDGED = 5000
"""Time without an acknowledgement after which the peer is gone [ms]."""


class TcpLink(ByteLink):
    """Connection to a server; `name` is that of the device in messages."""

    MOST_UNSENT = 1024
    NOT_OPEN, ENDED = "not connected", "its server closed the connection"

    def __init__(self, host: str, port: int, name: str) -> None:
        super().__init__(name)
        self.host, self.port = host, port
        self._socket: socket.socket | None = None
        self._begun: socket.socket | None = None
        self._begun_at = -RETRY
        self._address: tuple[int, Any] | None = None

    def descriptor(self) -> int:
        """Return the file descriptor of the connection, -1 if there is none."""
        return -1 if self._socket is None else self._socket.fileno()

    def connect(self, timeout: float) -> None:
        """See `ByteLink.connect`: there is such a host, and something answers."""
        self.close()
        try:
            link = _connected(self.host, self.port, timeout)
            self._address = link.family, link.getpeername()
        except socket.gaierror as error:
            raise DeviceError(f"{self.name}: no such host ({error.strerror})") from None
        except UnicodeError:
            raise DeviceError(f"{self.name}: no such host (not a name)") from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise DeviceError(
                f"{self.name}: cannot connect ({reason}): is its server running, and the port right?"
            ) from None
        self._attach(link)

    def reconnect(self) -> bool:
        """See `ByteLink.reconnect`."""
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
            if not begun.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) and not _is_itself(begun):
                self._attach(begun)
                return True
            begun.close()
        elif now - self._begun_at > GIVE_UP:
            self._abandon()
        return False

    def drain(self) -> None:
        """See `ByteLink.drain`; at most `MOST_DRAINED` times what is read at once."""
        for _ in range(MOST_DRAINED):
            if self.receive() is None:
                return

    def retire(self) -> None:
        """Close without waiting: another thread lets the peer read what it was sent, for `GIVE_UP`."""
        if self._socket is not None:
            threading.Thread(target=_close, args=(self._socket, GIVE_UP), daemon=True).start()
        self._socket, self._rest = None, b""

    def close(self, linger: float = LINGER) -> None:
        """Close when the peer has read what it was sent, at most `linger` [s] later; never raises."""
        self._abandon()
        if self._socket is not None:
            _close(self._socket, linger)
        self._socket, self._rest = None, b""

    def _reopen(self, timeout: float) -> None:
        if self._address is None:
            raise OSError(errno.ENOTCONN, "never connected")
        host, port, *_ = self._address[1]
        fresh = _connected(host, port, timeout)
        self._let_go()
        self._abandon()
        self._attach(fresh)

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


def _close(link: socket.socket, linger: float) -> None:
    """Close a socket when its peer has closed it too, at most `linger` [s] later; never raises."""
    deadline = time.monotonic() + linger
    with link, contextlib.suppress(OSError):
        # A socket closed over unread bytes resets the connection, and the peer may lose the last command.
        link.shutdown(socket.SHUT_WR)
        while (left := deadline - time.monotonic()) > 0.0:
            if not ready(link.fileno(), select.POLLIN, left) or not link.recv(MOST_READ):
                break


def _connected(host: str, port: int, timeout: float) -> socket.socket:
    link = socket.create_connection((host, port), max(timeout, 1e-3))
    if _is_itself(link):
        link.close()
        raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
    return link


def _is_itself(link: socket.socket) -> bool:
    """Return True if a socket is connected to itself, or to nothing.

    The ports of gloves lie in the range for clients: if nothing listens on one, the system may give that very port to a
    client on the same machine, which then reads its own commands.
    """
    try:
        return bool(link.getsockname() == link.getpeername())
    except OSError:
        return True
