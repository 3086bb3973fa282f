"""A fake glove that speaks the letter format.

It is run as `python -m tools.opengloves_board --link GLOVE --log FILE`.

On a pseudo-terminal, which looks like a serial line and has no baud rate, or as a TCP server for any number of clients.
Its orders are those of `tools.fake_peer`, and `garbage`: a line that is none. `leave` takes the line away,
or the server with its connections. In its log, a frame is the five curls from 0 to 1 and the sample's number; a command
is the five limits from 0, free, to 1.
"""

import argparse
import contextlib
import math
import os
import pty
import time
import tty
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.live.link.opengloves_codec import FINGER_KEYS, FULL_LIMIT, GloveLine, LineError, LineStream, parse_line
from tools.fake_peer import BENDS, FakePeer, FakeServer, PeerLog, peer_parser

NONE = (math.nan,) * 5


def format_line(line: GloveLine) -> bytes:
    """The bytes of a sample, with its end; numbers that are not known are left out. What a fake glove sends."""
    words = [f"{key}{value:.0f}" for key, value in zip(FINGER_KEYS, line.curl) if math.isfinite(value)]
    words += [f"({key}B){value:.0f}" for key, value in zip(FINGER_KEYS, line.splay) if math.isfinite(value)]
    words += [
        f"({key}A{bone}){value:.0f}"
        for key, bones in zip(FINGER_KEYS, line.joints)
        for bone, value in zip("ABCD", bones)
        if math.isfinite(value)
    ]
    return ("".join(words) + "\n").encode()


def parse_limits(line: bytes) -> tuple[int, ...]:
    """Read a command, as a glove does; negative where it leaves a finger as it is.

    Raises:
        LineError: Not of the format, or only some of the fingers.
    """
    found = parse_line(line)
    if found is None:
        raise LineError(f"{line[:40]!r}: no fingers")
    return tuple(int(value) for value in found.curl)


class FakeLine:
    """The glove's end of a pseudo-terminal; `link` always leads to the line that hhsim is to open."""

    def __init__(self, link: Path) -> None:
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

    def client(self, end: int) -> int:
        """The number of whoever is at the other end; there is one."""
        return 0

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


class FakeOpenGloves(FakePeer):
    """The glove."""

    def __init__(self, options: argparse.Namespace) -> None:
        log = PeerLog(options.log)
        self._line: FakeLine | FakeServer = FakeLine(options.link) if options.link else FakeServer(options.port, log)
        super().__init__(options, log, self._line, {"garbage": lambda number: self._line.send(b"\xff\x00A12?\n")})
        self._format, self._scale = options.format, options.full_scale
        self._streams: dict[int, LineStream] = {}

    def send(self, number: int, channels: NDArray[np.float64]) -> None:
        """See `FakePeer.send`."""
        bends = channels[list(BENDS)]
        # What this format has instead of NaN: a number far out of range.
        counts = np.where(np.isfinite(bends), np.round(bends * self._scale), 99_999.0)
        curl = tuple(counts.tolist())
        half = (round(0.5 * self._scale),) * 5
        joints = tuple((value,) * 4 for value in curl) if self._format == "joints" else (NONE[:4],) * 5
        line = format_line(GloveLine(curl, NONE if self._format == "curls" else half, joints))
        now = time.monotonic_ns()
        if self._line.send(line):
            self.log.sent([*(counts / self._scale).tolist(), number], now)

    def receive(self, end: int) -> None:
        """See `FakePeer.receive`."""
        data = self._line.receive(end)
        now = time.monotonic_ns()
        if not data:
            return
        for line in self._streams.setdefault(self._line.client(end), LineStream(whole=True)).feed(data):
            try:
                limits = parse_limits(line)
            except LineError as error:
                self.log.note(f"not a command: {error}")
                continue
            self.log.command([limit / FULL_LIMIT for limit in limits], now)


def main() -> None:
    """Run a fake glove."""
    parser = peer_parser("opengloves_board", str(__doc__))
    parser.add_argument("--link", type=Path, help="path that leads to its serial line; without it, a TCP server")
    parser.add_argument("--port", type=int, default=0, help="of the TCP server on 127.0.0.1; 0 for any that is free")
    parser.add_argument("--format", choices=("curls", "splay", "joints"), default="curls")
    parser.add_argument("--full-scale", type=float, default=4095.0, help="largest reading")
    FakeOpenGloves(parser.parse_args()).run()


if __name__ == "__main__":
    main()
