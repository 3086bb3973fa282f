"""TCP server of a fake glove, for any number of clients."""

import socket
import sys
from dataclasses import dataclass, field

from hhsim.live.simulators.peer import PeerLog

MOST_UNSENT = 1 << 18
"""Unsent bytes from which on a client gets no further frames."""


@dataclass
class _Client:
    link: socket.socket
    number: int
    unsent: bytearray = field(default_factory=bytearray)


class FakeServer:
    """Server whose clients are numbered from 0; bytes that a client does not take at once go with the next frame.

    Args:
        port: TCP port on 127.0.0.1; 0 for any that is free.
        log: Log of clients that connect and leave.

    Attributes:
        at_once: Most bytes of one send.
    """

    def __init__(self, port: int, log: PeerLog) -> None:
        self._port, self._log = port, log
        self._clients: dict[int, _Client] = {}
        self._joined = 0
        self.at_once = sys.maxsize
        self.open()

    @property
    def where(self) -> str:
        """Its port."""
        return str(self._port)

    def open(self) -> None:
        """Listen, at the same port as before."""
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._listener.setblocking(False)
        self._port = int(self._listener.getsockname()[1])

    def close(self) -> None:
        """Close the server and all connections."""
        self._listener.close()
        for end in list(self._clients):
            self._drop(end)

    def ends(self) -> list[int]:
        """File descriptors of the listener and the clients."""
        return [self._listener.fileno(), *self._clients]

    def client(self, end: int) -> int:
        """Number of the client at one of `ends`."""
        return self._clients[end].number

    def send(self, data: bytes) -> list[int]:
        """Send to all clients and return the numbers of those that take it."""
        taken = []
        for end, client in list(self._clients.items()):
            if len(client.unsent) > MOST_UNSENT:
                self._log.note(f"skipped {client.number}")
                continue
            taken.append(client.number)
            client.unsent += data
            try:
                while client.unsent:
                    del client.unsent[: client.link.send(client.unsent[: self.at_once])]
            except BlockingIOError:
                continue
            except OSError:
                self._drop(end)
        return taken

    def receive(self, end: int) -> bytes:
        """Read from one of `ends`; empty where a client came or left."""
        if end == self._listener.fileno():
            link, _ = self._listener.accept()
            link.setblocking(False)
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients[link.fileno()] = _Client(link, self._joined)
            self._log.note(f"connected {self._joined}")
            self._joined += 1
            return b""
        if end not in self._clients:
            return b""
        try:
            data = self._clients[end].link.recv(65_536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop(end)
        return data

    def drop(self, end: int) -> None:
        """End the connection of a client that sent no valid command."""
        self._log.note(f"not a command from {self._clients[end].number}")
        self._drop(end)

    def _drop(self, end: int) -> None:
        client = self._clients.pop(end)
        client.link.close()
        self._log.note(f"gone {client.number}")
