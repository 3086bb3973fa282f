"""Dexmo server without gloves, as another process: `python -m tools.dexmo_server`.

It speaks the published format to any number of clients, numbered from 0, at a steady rate, for tests, soak runs and
trials. It prints `ready` and its port, then takes orders from its standard input, a line each, and answers `ok` or `no
such order`. It ends with its standard input.

| order | effect |
|---|---|
| stall, go | sends nothing and reads nothing; goes on |
| leave, back | closes its connections, as when unplugged; listens again |
| hold, move | the fingers stand still; they move |
| jump | all fingers bend or stretch by 0.9 of a fist from one sample to the next, and stay there until `move` |
| nan N | the next N samples hold a NaN |
| unplug, plug | frames without gloves; with them again |
| swap | every glove says that it is the other hand's |
| bytes, frames | every byte is sent on its own; frame by frame again |
| garbage N | N messages that are no frames, in one go |
| length N | a length of N, then nothing that belongs to it |

Its log has a line for each frame sent and command received: CLOCK_MONOTONIC [ns], `sent` or `command`, and the values;
`note` lines hold the rest. A frame is the number of the client and of the sample; a command is the number of the client
and of the glove, 1 where it must be kept, five values of stiffness and five set points. Each line is written at once,
so that a log is whole up to a kill.
"""

import argparse
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.live.drivers.dexmo import (
    CHANNELS,
    FINGER_FIELDS,
    LENGTH,
    GloveMessage,
    framed,
    message_classes,
    next_message,
    parse_message,
)

BENDS = tuple(k for k, name in enumerate(CHANNELS) if name.endswith("_bend"))
JUMP = 0.9
"""Change of a normalised bend [-], 90° at the fingers' second joints."""
COUNT_LOW, COUNT_SPAN = 700.0, 2400.0
"""Raw counts at 0, and from 0 to 1."""
MOST_UNSENT = 1 << 18
"""Unsent bytes from which on a client gets no further frames."""


def encode_frame(gloves: Iterable[GloveMessage]) -> bytes:
    """Encode a frame as the server sends it, without its length."""
    messages = []
    for glove in gloves:
        message: dict[str, Any] = {"id": glove.device_id}
        if glove.channels is not None:
            message["hand"] = dict(zip(CHANNELS, glove.channels, strict=True))
        if glove.right is not None:
            message["device"] = {"is_right": glove.right, "battery_percent": glove.battery or 0}
        messages.append(message)
    data: bytes = message_classes()["Frame"](messages=messages).SerializeToString()
    return data


def fake_channels(seed: int, time: float) -> FloatArray:
    """Compute the channels (`CHANNELS`, 0 to 1) of a made-up motion at a time [s]; `seed` sets each finger's pace."""
    random = np.random.default_rng(seed)
    rate, phase = random.uniform(0.2, 0.7, len(CHANNELS)), random.uniform(0.0, 2.0 * np.pi, len(CHANNELS))
    size = np.where(np.isin(np.arange(len(CHANNELS)), BENDS), 0.45, 0.1)
    return np.asarray(0.5 - size * np.cos(2.0 * np.pi * rate * time + phase))


@dataclass
class _Client:
    link: socket.socket
    number: int
    unsent: bytearray = field(default_factory=bytearray)
    waiting: bytearray = field(default_factory=bytearray)


class FakeDexmoServer:
    """Server on 127.0.0.1 that listens from the beginning; its settings are the command line's.

    Bytes that a client does not take at once go with the next frame.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options, self._port = options, options.port
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self._log = None if options.log is None else os.open(options.log, flags, 0o644)
        parts = (part.partition(":") for part in options.gloves.split(","))
        self._gloves = [(int(number), hand == "right") for number, _, hand in parts]
        self._clients: dict[int, _Client] = {}
        self._joined = self._nans = 0
        self._stalled, self._left = False, True
        self._plugged = True
        self._at_once = sys.maxsize
        self._last = fake_channels(options.seed, 0.0)
        self._held: FloatArray | None = None
        self._unread = b""
        self._orders: dict[str, Callable[[int], object]] = {
            "stall": lambda number: setattr(self, "_stalled", True),
            "go": lambda number: setattr(self, "_stalled", False),
            "leave": lambda number: self._close(),
            "back": lambda number: self._listen(),
            "hold": lambda number: setattr(self, "_held", self._last),
            "move": lambda number: setattr(self, "_held", None),
            "jump": lambda number: setattr(self, "_held", jumped(self._last)),
            "nan": lambda number: setattr(self, "_nans", number),
            "unplug": lambda number: setattr(self, "_plugged", False),
            "plug": lambda number: setattr(self, "_plugged", True),
            "swap": lambda number: setattr(self, "_gloves", [(glove, not right) for glove, right in self._gloves]),
            "bytes": lambda number: setattr(self, "_at_once", 1),
            "frames": lambda number: setattr(self, "_at_once", sys.maxsize),
            "garbage": lambda number: self._send(framed(b"\xff" * 24) * number),
            "length": lambda number: self._send(LENGTH.pack(number)),
        }
        self._listen()

    def run(self) -> None:
        """Run until the standard input ends."""
        print(f"ready {self._port}", flush=True)
        rate, start = self._options.rate, time.monotonic()
        period = number = 0
        while True:
            now = time.monotonic()
            due = start + period / rate
            resting = self._stalled or self._left
            if now >= due:
                if not resting:
                    self._send_sample(number)
                    number += 1
                # Late samples are left out, as by a glove's own clock.
                period = max(period + 1, int((now - start) * rate))
                continue
            ends = [] if resting else [self._listener.fileno(), *self._clients]
            ready, _, _ = select.select([sys.stdin.fileno(), *ends], [], [], due - now)
            for end in ready:
                if end != sys.stdin.fileno():
                    self._receive(end)
                elif not self._obey():
                    self._close()
                    return

    def _send_sample(self, number: int) -> None:
        options = self._options
        values = fake_channels(options.seed, number / options.rate) if self._held is None else self._held.copy()
        self._last = values.copy()
        if self._nans > 0:
            self._nans -= 1
            values[BENDS[1]] = np.nan
        if options.counts:
            values = np.round(COUNT_LOW + COUNT_SPAN * values)
        channels = tuple(values.tolist())
        gloves = [GloveMessage(glove, channels, right, options.battery) for glove, right in self._gloves]
        now = time.monotonic_ns()
        for client in self._send(framed(encode_frame(gloves if self._plugged else []))):
            self._write("sent", [client, number], now)

    def _obey(self) -> bool:
        """Read the standard input; False where it has ended."""
        data = os.read(sys.stdin.fileno(), 4096)
        *lines, self._unread = (self._unread + data).split(b"\n")
        for line in lines:
            word, _, number = line.decode().partition(" ")
            self._write("note", [line.decode()])
            try:
                self._orders[word](int(number or 1))
            except (KeyError, ValueError):
                print("no such order", flush=True)
            else:
                print("ok", flush=True)
        return bool(data)

    def _listen(self) -> None:
        """Listen, at the same port as before."""
        if not self._left:
            return
        self._left = False
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._listener.setblocking(False)
        self._port = int(self._listener.getsockname()[1])

    def _close(self) -> None:
        """Close the listener and all connections."""
        self._left = True
        self._listener.close()
        for end in list(self._clients):
            self._drop(end)

    def _send(self, data: bytes) -> list[int]:
        """Send to all clients and return the numbers of those that take it."""
        taken = []
        for end, client in list(self._clients.items()):
            if len(client.unsent) > MOST_UNSENT:
                self._write("note", ["skipped", client.number])
                continue
            taken.append(client.number)
            client.unsent += data
            try:
                while client.unsent:
                    del client.unsent[: client.link.send(client.unsent[: self._at_once])]
            except BlockingIOError:
                continue
            except OSError:
                self._drop(end)
        return taken

    def _receive(self, end: int) -> None:
        """Let a client in, or read from one."""
        if end == self._listener.fileno():
            link, _ = self._listener.accept()
            link.setblocking(False)
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients[link.fileno()] = _Client(link, self._joined)
            self._write("note", ["connected", self._joined])
            self._joined += 1
            return
        client = self._clients.get(end)
        if client is None:
            return
        try:
            data = client.link.recv(65_536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        now = time.monotonic_ns()
        if not data:
            self._drop(end)
        client.waiting += data
        try:
            while (payload := next_message(client.waiting)) is not None:
                command = parse_message("Command", payload)
                for impedance in command.impedance:
                    # 0 for fingers that it does not name.
                    fingers = [getattr(impedance, name) for name in FINGER_FIELDS]
                    told = [getattr(finger, name) for name in ("stiffness", "set_point") for finger in fingers]
                    self._write("command", [client.number, command.id, impedance.has_index, *told], now)
        except HhsimError:
            self._write("note", ["not a command from", client.number])
            self._drop(end)

    def _drop(self, end: int) -> None:
        client = self._clients.pop(end)
        client.link.close()
        self._write("note", ["gone", client.number])

    def _write(self, kind: str, values: Sequence[object], now_ns: int | None = None) -> None:
        if self._log is not None:
            words = (f"{value:.9g}" if isinstance(value, float | int) else str(value) for value in values)
            stamp = time.monotonic_ns() if now_ns is None else now_ns
            os.write(self._log, f"{stamp} {kind} {' '.join(words)}\n".encode())


def jumped(channels: FloatArray) -> FloatArray:
    """Return the channels with all fingers bent or stretched by `JUMP`."""
    beyond = np.where(channels > 0.5, channels - JUMP, channels + JUMP)
    return np.where(np.isin(np.arange(len(channels)), BENDS), beyond, channels)


def main() -> None:
    """Run the server of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.dexmo_server", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rate", type=float, default=200.0, help="samples a second [Hz]")
    parser.add_argument("--seed", type=int, default=0, help="of the motion")
    parser.add_argument("--log", type=Path, help="file of what was sent and received")
    parser.add_argument("--port", type=int, default=0, help="TCP port on 127.0.0.1; 0 for any that is free")
    parser.add_argument("--gloves", default="337785601:right", help="numbers and hands, NUMBER:right,NUMBER:left")
    parser.add_argument("--counts", action="store_true", help="send raw counts instead of 0 to 1")
    parser.add_argument("--battery", type=int, default=87, help="charge [%%]")
    FakeDexmoServer(parser.parse_args()).run()


if __name__ == "__main__":
    main()
