"""A Dexmo server without gloves, as another process: `python -m hhsim.live.simulators.dexmo_server`.

It speaks the published format to any number of clients, at a steady rate on absolute deadlines, and writes down with
CLOCK_MONOTONIC every frame that it sent and every command that it got, so that a test or a long run can hold a driver
against it (`hhsim.live.simulators.dexmo_process`). Motion follows from the seed and the frame's number alone. On its
standard input it takes orders that make it misbehave, a line each; every one is answered by "ok" on the standard
output, after "listening PORT" at the start. It ends when the standard input does.

| order | what happens |
|---|---|
| stall, go | nothing is sent or read any more; again |
| down, up | connections and the port are gone; the port is back |
| unplug, plug | frames without gloves; with them again |
| bytes, frames | every byte is sent on its own; frame by frame again |
| hold, move | the fingers stand still; they move |
| jump | all fingers bend or stretch by 0.9 of a fist from one frame to the next, and stay there until `move` |
| nan N | the next N frames have a channel that is NaN |
| garbage N | N messages that are no frames, in one go |
| length N | a length of N, then nothing that belongs to it |
"""

import argparse
import contextlib
import os
import select
import socket
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.live.link.dexmo_codec import (
    CHANNELS,
    LENGTH,
    GloveMessage,
    MessageStream,
    decode_impedances,
    encode_frame,
    framed,
)
from hhsim.live.simulators.dexmo_process import PACKED, Kind

BENDS = tuple(k for k, name in enumerate(CHANNELS) if name.endswith("_bend"))
JUMP = 0.9
"""Change of a normalised bend that turns the fingers' second joints by 90°."""
COUNT_LOW, COUNT_SPAN = 700.0, 2400.0
"""Raw counts at 0, and from 0 to 1."""
MOST_UNSENT = 1 << 18
"""A client that has not taken so many bytes gets no more frames until it has."""


def fake_channels(seed: int, time: float) -> NDArray[np.float64]:
    """Channels of the made-up motion, 0 to 1.

    Args:
        seed: Of the pace of each finger.
        time: Since the beginning [s].

    Returns:
        In the order of `CHANNELS`, shape (11,).
    """
    random = np.random.default_rng(seed)
    rate, phase = random.uniform(0.2, 0.7, len(CHANNELS)), random.uniform(0.0, 2.0 * np.pi, len(CHANNELS))
    size = np.where(np.isin(np.arange(len(CHANNELS)), BENDS), 0.45, 0.1)
    return np.asarray(0.5 - size * np.cos(2.0 * np.pi * rate * time + phase))


@dataclass
class _Client:
    link: socket.socket
    number: int
    stream: MessageStream = field(default_factory=MessageStream)
    unsent: bytearray = field(default_factory=bytearray)


class FakeDexmoServer:
    """The server; `run` serves until the standard input ends.

    Args:
        port: 0 for any that is free.
        rate: Frames per second [Hz].
        seed: Of the motion.
        gloves: Numbers and hands: (337785601, "right").
        log: File of records.
        counts: Channels are raw counts.
        battery: Charge [%].
    """

    def __init__(
        self,
        port: int,
        rate: float,
        seed: int,
        gloves: Sequence[tuple[int, str]],
        log: Path,
        *,
        counts: bool = False,
        battery: int = 87,
    ) -> None:
        """Listen."""
        self.port, self._rate, self._seed, self._gloves = port, rate, seed, gloves
        self._counts, self._battery = counts, battery
        self._log = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        self._listener: socket.socket | None = None
        self._clients: list[_Client] = []
        self._joined = 0
        self._frame = 0
        self._stalled = self._single = False
        self._plugged = True
        self._held: NDArray[np.float64] | None = None
        self._nans = 0
        self._orders = b""
        self._listen()

    def run(self) -> None:
        """Serve."""
        print(f"listening {self.port}", flush=True)
        start = time.monotonic_ns()
        period = 1e9 / self._rate
        tick = 0
        while True:
            deadline = start + round(tick * period)
            left = (deadline - time.monotonic_ns()) / 1e9
            if left > 0.0:
                if not self._serve(left):
                    return
                continue
            if not self._stalled:
                self._send_frame()
            # Late ones are left out, as a glove's own clock would: never two at once.
            tick = max(tick + 1, int((time.monotonic_ns() - start) / period))

    def _serve(self, timeout: float) -> bool:
        readers: list[Any] = [sys.stdin.fileno()]
        if not self._stalled:
            readers += [client.link for client in self._clients] + ([self._listener] if self._listener else [])
        writers = [client.link for client in self._clients if client.unsent and not self._stalled]
        readable, writable, _ = select.select(readers, writers, [], timeout)
        for client in list(self._clients):
            if client.link in writable:
                self._flush(client)
            if client.link in readable:
                self._receive(client)
        if self._listener in readable and self._listener is not None:
            link, _ = self._listener.accept()
            link.setblocking(False)
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(_Client(link, self._joined))
            self._note(Kind.CONNECTED, self._joined)
            self._joined += 1
        if readers[0] in readable:
            data = os.read(readers[0], 65_536)
            if not data:
                return False
            *orders, self._orders = (self._orders + data).split(b"\n")
            for order in orders:
                try:
                    self._obey(order.decode().split())
                except (ValueError, IndexError):
                    print("no such order", flush=True)
                else:
                    print("ok", flush=True)
        return True

    def _obey(self, words: list[str]) -> None:
        order, number = words[0], int(words[1]) if len(words) > 1 else 0
        if order in ("stall", "go"):
            self._stalled = order == "stall"
        elif order == "down":
            for client in list(self._clients):
                self._drop(client)
            if self._listener is not None:
                self._listener.close()
                self._listener = None
        elif order == "up":
            self._listen()
        elif order in ("unplug", "plug"):
            self._plugged = order == "plug"
        elif order in ("bytes", "frames"):
            self._single = order == "bytes"
        elif order == "hold":
            self._held = self._channels()
        elif order == "jump":
            now = self._channels()
            self._held = np.where(np.isin(np.arange(len(now)), BENDS), np.where(now > 0.5, now - JUMP, now + JUMP), now)
        elif order == "move":
            self._held = None
        elif order == "nan":
            self._nans = number
        elif order == "garbage":
            self._send_all(framed(b"\xff" * 24) * number)
        elif order == "length":
            self._send_all(LENGTH.pack(number))
        else:
            raise ValueError(order)

    def _channels(self) -> NDArray[np.float64]:
        if self._held is not None:
            return self._held
        return fake_channels(self._seed, self._frame / self._rate)

    def _send_frame(self) -> None:
        channels = self._channels()
        if self._counts:
            channels = np.round(COUNT_LOW + COUNT_SPAN * channels)
        values = channels.tolist()
        if self._nans:
            self._nans -= 1
            values[BENDS[1]] = float("nan")
        gloves = [GloveMessage(number, tuple(values), hand == "right", self._battery) for number, hand in self._gloves]
        data = framed(encode_frame(gloves if self._plugged else []))
        for client in list(self._clients):
            if len(client.unsent) > MOST_UNSENT:
                self._note(Kind.SKIPPED, client.number, self._frame)
                continue
            self._note(Kind.FRAME, client.number, self._frame)
            client.unsent += data
            self._flush(client)
        self._frame += 1

    def _send_all(self, data: bytes) -> None:
        for client in list(self._clients):
            client.unsent += data
            self._flush(client)

    def _flush(self, client: _Client) -> None:
        with contextlib.suppress(BlockingIOError):
            try:
                while client.unsent:
                    size = 1 if self._single else len(client.unsent)
                    del client.unsent[: client.link.send(client.unsent[:size])]
            except BlockingIOError:
                raise
            except OSError:
                self._drop(client)

    def _receive(self, client: _Client) -> None:
        try:
            data = client.link.recv(65_536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        now = time.monotonic_ns()
        client.stream.feed(data)
        try:
            while (payload := client.stream.next()) is not None:
                for impedance in decode_impedances(payload):
                    self._note(
                        Kind.COMMAND,
                        client.number,
                        impedance.device_id,
                        impedance.kept,
                        impedance.stiffness,
                        impedance.set_point,
                        now,
                    )
        except HhsimError:
            self._note(Kind.BROKEN, client.number)
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            client.link.close()
            self._note(Kind.GONE, client.number)

    def _listen(self) -> None:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", self.port))
        listener.listen()
        listener.setblocking(False)
        self.port = listener.getsockname()[1]
        self._listener = listener

    def _note(
        self,
        kind: Kind,
        client: int,
        number: int = 0,
        kept: bool = False,
        stiffness: Sequence[float] = (0.0,) * 5,
        set_point: Sequence[float] = (0.0,) * 5,
        time_ns: int = 0,
    ) -> None:
        now = time_ns or time.monotonic_ns()
        os.write(self._log, PACKED.pack(now, kind, client, number, kept, *stiffness, *set_point))


def main(arguments: Sequence[str] | None = None) -> None:
    """Serve as the command line says."""
    parser = argparse.ArgumentParser(
        prog="python -m hhsim.live.simulators.dexmo_server",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--port", type=int, default=0, help="TCP port on 127.0.0.1; 0 for any that is free")
    parser.add_argument("--rate", type=float, default=200.0, help="frames per second [Hz]")
    parser.add_argument("--seed", type=int, default=0, help="of the motion")
    parser.add_argument("--gloves", default="337785601:right", help="numbers and hands, NUMBER:right,NUMBER:left")
    parser.add_argument("--log", type=Path, required=True, help="file of what was sent and received")
    parser.add_argument("--counts", action="store_true", help="send raw counts instead of 0 to 1")
    parser.add_argument("--battery", type=int, default=87, help="charge [%%]")
    options = parser.parse_args(arguments)
    gloves = [(int(number), hand) for number, _, hand in (part.partition(":") for part in options.gloves.split(","))]
    FakeDexmoServer(
        options.port,
        options.rate,
        options.seed,
        gloves,
        options.log,
        counts=options.counts,
        battery=options.battery,
    ).run()


if __name__ == "__main__":
    main()
