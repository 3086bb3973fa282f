"""A fake glove that speaks the letter format.

It is run as `python -m hhsim.live.simulators.opengloves_board --link GLOVE --log FILE`.

On a pseudo-terminal, which looks like a serial line and has no baud rate, or as a TCP server for any number of clients.
Its orders are those of `hhsim.live.simulators.peer`, and `garbage`: a line that is none. `leave` takes the line away,
or the server with its connections. In its log, a frame is the five curls from 0 to 1 and the sample's number; a command
is the five limits from 0, free, to 1.
"""

import argparse
import contextlib
import math
import os
import pty
import socket
import time
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hhsim.live.link.opengloves_codec import (
    FULL_LIMIT,
    GloveLine,
    LineError,
    LineStream,
    format_line,
    parse_limits,
)
from hhsim.live.simulators.peer import FakePeer, PeerLog

NONE = (math.nan,) * 5


class FakeLine:
    """The glove's end of a pseudo-terminal.

    Args:
        link: Path that always leads to the line that hhsim is to open.
    """

    def __init__(self, link: Path) -> None:
        """Make the line."""
        self._link = link
        self._main = -1
        self.open()
        self.where = str(link)

    def open(self) -> None:
        """Make the line anew."""
        self._main, other = pty.openpty()
        tty.setraw(other)
        os.set_blocking(self._main, False)
        fresh = self._link.with_name(f"{self._link.name}.new")
        fresh.symlink_to(os.ttyname(other))
        fresh.replace(self._link)
        # Kept open, or the line would be gone whenever nobody else has it.
        self._other = other

    def close(self) -> None:
        """Take the line away, as when the glove is unplugged."""
        self._link.unlink(missing_ok=True)
        os.close(self._main)
        os.close(self._other)
        self._main = -1

    def ends(self) -> list[int]:
        """Where commands come from."""
        return [self._main]

    def send(self, data: bytes) -> bool:
        """Whether it fitted."""
        try:
            return os.write(self._main, data) == len(data)
        except OSError:
            return False

    def receive(self, end: int) -> bytes:
        """What came."""
        with contextlib.suppress(OSError):
            return os.read(end, 4096)
        return b""


class FakeServer:
    """The glove as a TCP server.

    Args:
        port: 0 for any that is free.
    """

    def __init__(self, port: int) -> None:
        """Listen."""
        self._port = port
        self._clients: dict[int, socket.socket] = {}
        self.open()
        self.where = str(self._port)

    def open(self) -> None:
        """Listen, at the same port as before."""
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._listener.setblocking(False)
        self._port = int(self._listener.getsockname()[1])

    def close(self) -> None:
        """Be gone."""
        self._listener.close()
        for client in self._clients.values():
            client.close()
        self._clients.clear()

    def ends(self) -> list[int]:
        """Where commands and clients come from."""
        return [self._listener.fileno(), *self._clients]

    def send(self, data: bytes) -> bool:
        """Whether anybody took it."""
        taken = False
        for end, client in list(self._clients.items()):
            try:
                taken = client.send(data) == len(data) or taken
            except BlockingIOError:
                continue
            except OSError:
                self._drop(end)
        return taken

    def receive(self, end: int) -> bytes:
        """What came."""
        if end == self._listener.fileno():
            client, _ = self._listener.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients[client.fileno()] = client
            return b""
        with contextlib.suppress(OSError):
            data = self._clients[end].recv(4096)
            if data:
                return data
        self._drop(end)
        return b""

    def _drop(self, end: int) -> None:
        self._clients.pop(end).close()


class FakeOpenGloves:
    """The glove.

    Args:
        options: Of the command line.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        """Make its line or its server."""
        self._log = PeerLog(options.log)
        self._peer = FakePeer(options.rate, options.seed, self._log, {"garbage": self._garbage})
        self._line: FakeLine | FakeServer = FakeLine(options.link) if options.link else FakeServer(options.port)
        self._format, self._scale = options.format, options.full_scale
        self._streams: dict[int, LineStream] = {}

    def run(self) -> None:
        """Go on until the standard input ends."""
        print(f"ready {self._line.where}", flush=True)
        try:
            self._peer.run(self._send, self._sources, self._line.close, self._line.open)
        finally:
            self._line.close()

    def _send(self, number: int) -> None:
        bends = self._peer.hand.bends(number)
        # What this format has instead of NaN: a number far out of range.
        counts = np.where(np.isfinite(bends), np.round(bends * self._scale), 99_999.0)
        curl = tuple(counts.tolist())
        half = (round(0.5 * self._scale),) * 5
        joints = tuple((value,) * 4 for value in curl) if self._format == "joints" else (NONE[:4],) * 5
        line = format_line(GloveLine(curl, NONE if self._format == "curls" else half, joints))
        now = time.monotonic_ns()
        if self._line.send(line):
            self._log.sent([*(counts / self._scale).tolist(), number], now)

    def _sources(self) -> dict[int, Callable[[], None]]:
        return {end: lambda end=end: self._commands(end) for end in self._line.ends()}  # type: ignore[misc]

    def _commands(self, end: int) -> None:
        data = self._line.receive(end)
        now = time.monotonic_ns()
        if not data:
            self._streams.pop(end, None)
            return
        for line in self._streams.setdefault(end, LineStream(whole=True)).feed(data):
            try:
                limits = parse_limits(line)
            except LineError as error:
                self._log.note(f"not a command: {error}")
                continue
            self._log.command([limit / FULL_LIMIT for limit in limits], now)

    def _garbage(self, rest: str) -> None:
        self._line.send(b"\xff\x00A12?\n")


def main() -> None:
    """Run a fake glove."""
    parser = argparse.ArgumentParser(
        prog="python -m hhsim.live.simulators.opengloves_board", description="A fake glove, letter format."
    )
    parser.add_argument("--link", type=Path, help="path that leads to its serial line; without it, a TCP server")
    parser.add_argument("--port", type=int, default=0, help="of the TCP server on 127.0.0.1; 0 for any that is free")
    parser.add_argument("--rate", type=float, default=200.0, help="samples a second [Hz]")
    parser.add_argument("--format", choices=("curls", "splay", "joints"), default="curls")
    parser.add_argument("--full-scale", type=float, default=4095.0, help="largest reading")
    parser.add_argument("--seed", type=int, default=0, help="of the motion")
    parser.add_argument("--log", type=Path, help="file of what was sent and received")
    FakeOpenGloves(parser.parse_args()).run()


if __name__ == "__main__":
    main()
