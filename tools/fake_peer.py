"""Base of the fake gloves: a hand that moves, samples at a steady rate, faults on request, a log of every frame.

A fake glove is a process of its own, for tests, soak runs and trials. It prints `ready` and its address, then takes
orders from its standard input, a line each, and answers `ok` or `no such order`. It ends with its standard input.

| order | effect |
|---|---|
| stall, go | sends nothing and reads nothing; goes on |
| leave, back | closes its connection, as when unplugged; opens it again |
| hold, move | the fingers stand still; they move |
| jump | all fingers bend or stretch by 0.9 of a fist from one sample to the next, and stay there until `move` |
| nan N | the next N samples hold a NaN, or what the format has for it |

Its log has a line for each frame sent and command received: CLOCK_MONOTONIC [ns], `sent` or `command`, and the values;
`note` lines hold the rest. Each line is written at once, so that a log is whole up to a kill.
"""

import argparse
import os
import select
import socket
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.live.drivers.dexmo import CHANNELS

BENDS = tuple(k for k, name in enumerate(CHANNELS) if name.endswith("_bend"))
JUMP = 0.9
"""Change of a normalised bend [-], 90° at the fingers' second joints."""
MOST_UNSENT = 1 << 18
"""Unsent bytes from which on a client gets no further frames."""


class PeerLog:
    """Log of a fake glove, appended to the file at `path`; None keeps none."""

    def __init__(self, path: Path | None) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self._file = None if path is None else os.open(path, flags, 0o644)

    def sent(self, values: Sequence[float], now_ns: int) -> None:
        """Log a frame sent at `now_ns`."""
        self._write(now_ns, "sent", " ".join(f"{value:.9g}" for value in values))

    def command(self, values: Sequence[float], now_ns: int) -> None:
        """Log a command received at `now_ns`."""
        self._write(now_ns, "command", " ".join(f"{value:.9g}" for value in values))

    def note(self, text: str) -> None:
        """Log another event of the present."""
        self._write(time.monotonic_ns(), "note", text)

    def _write(self, now_ns: int, kind: str, text: str) -> None:
        if self._file is not None:
            os.write(self._file, f"{now_ns} {kind} {text}\n".encode())


def fake_channels(seed: int, time: float) -> FloatArray:
    """Compute the channels (`CHANNELS`, 0 to 1) of a made-up motion at a time [s]; `seed` sets each finger's pace."""
    random = np.random.default_rng(seed)
    rate, phase = random.uniform(0.2, 0.7, len(CHANNELS)), random.uniform(0.0, 2.0 * np.pi, len(CHANNELS))
    size = np.where(np.isin(np.arange(len(CHANNELS)), BENDS), 0.45, 0.1)
    return np.asarray(0.5 - size * np.cos(2.0 * np.pi * rate * time + phase))


class Line(Protocol):
    """Connection that a fake glove is reached by."""

    @property
    def where(self) -> str:
        """Its port."""

    def open(self) -> None:
        """Open the connection again."""

    def close(self) -> None:
        """Close the connection."""

    def ends(self) -> Iterable[int]:
        """File descriptors from which commands and clients come."""


class FakePeer(ABC):
    """Fake glove: sends samples at a steady rate, reads commands, and makes faults on request.

    Args:
        options: Command line of `peer_parser`.
        line: Open connection.
        orders: Further orders of this glove, called with the number after the word, or 1.
    """

    def __init__(
        self,
        options: argparse.Namespace,
        log: PeerLog,
        line: Line,
        orders: Mapping[str, Callable[[int], object]] | None = None,
    ) -> None:
        self.log = log
        self.faulty = False
        """True if the last sample holds a NaN."""
        self._line = line
        self._rate, self._seed = options.rate, options.seed
        self._last = fake_channels(self._seed, 0.0)
        self._held: FloatArray | None = None
        self._nans = 0
        self._stalled = self._left = False
        self._unread = b""
        self._orders: dict[str, Callable[[int], object]] = {
            "stall": lambda number: setattr(self, "_stalled", True),
            "go": lambda number: setattr(self, "_stalled", False),
            "leave": lambda number: self._leave(True),
            "back": lambda number: self._leave(False),
            "hold": lambda number: setattr(self, "_held", self._last),
            "move": lambda number: setattr(self, "_held", None),
            "jump": lambda number: setattr(self, "_held", jumped(self._last)),
            "nan": lambda number: setattr(self, "_nans", number),
            **(orders or {}),
        }

    @abstractmethod
    def send(self, number: int, channels: FloatArray) -> None:
        """Send sample `number`, from 0, with channels of shape (11,)."""

    @abstractmethod
    def receive(self, end: int) -> None:
        """Read from one of the line's ends."""

    def run(self) -> None:
        """Run until the standard input ends."""
        print(f"ready {self._line.where}", flush=True)
        start = time.monotonic()
        period = number = 0
        while True:
            now = time.monotonic()
            due = start + period / self._rate
            if now >= due:
                if not (self._stalled or self._left):
                    self.send(number, self._channels(number))
                    number += 1
                # Late samples are left out, as by a glove's own clock.
                period = max(period + 1, int((now - start) * self._rate))
                continue
            ends = [] if self._stalled or self._left else list(self._line.ends())
            ready, _, _ = select.select([sys.stdin.fileno(), *ends], [], [], due - now)
            for end in ready:
                if end in ends:
                    self.receive(end)
                elif not self._obey():
                    if not self._left:
                        self._line.close()
                    return

    def _channels(self, number: int) -> FloatArray:
        values = fake_channels(self._seed, number / self._rate) if self._held is None else self._held.copy()
        self._last = values.copy()
        self.faulty = self._nans > 0
        if self.faulty:
            self._nans -= 1
            values[BENDS[1]] = np.nan
        return values

    def _obey(self) -> bool:
        """Read the standard input; False where it has ended."""
        data = os.read(sys.stdin.fileno(), 4096)
        *lines, self._unread = (self._unread + data).split(b"\n")
        for line in lines:
            word, _, number = line.decode().partition(" ")
            self.log.note(line.decode())
            try:
                self._orders[word](int(number or 1))
            except (KeyError, ValueError):
                print("no such order", flush=True)
            else:
                print("ok", flush=True)
        return bool(data)

    def _leave(self, left: bool) -> None:
        if left != self._left:
            self._left = left
            (self._line.close if left else self._line.open)()


def jumped(channels: FloatArray) -> FloatArray:
    """Return the channels with all fingers bent or stretched by `JUMP`."""
    beyond = np.where(channels > 0.5, channels - JUMP, channels + JUMP)
    return np.where(np.isin(np.arange(len(channels)), BENDS), beyond, channels)


def peer_parser(module: str, description: str, rate: float = 200.0) -> argparse.ArgumentParser:
    """Make the command line of a fake glove: of its `module`, description and default `rate` [Hz]."""
    parser = argparse.ArgumentParser(
        prog=f"python -m tools.{module}",
        description=f"{description}\n{__doc__}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--rate", type=float, default=rate, help="samples a second [Hz]")
    parser.add_argument("--seed", type=int, default=0, help="of the motion")
    parser.add_argument("--log", type=Path, help="file of what was sent and received")
    return parser


@dataclass
class _Client:
    link: socket.socket
    number: int
    unsent: bytearray = field(default_factory=bytearray)


class FakeServer:
    """TCP server on 127.0.0.1 whose clients are numbered from 0; port 0 is any that is free.

    Bytes that a client does not take at once go with the next frame, at most `at_once` bytes in one send.
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
