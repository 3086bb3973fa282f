"""Dexmo server without gloves, as another process: `python -m tools.dexmo_server`.

It speaks the published format to any number of clients at a steady rate. A frame in its log is the number of the client
and of the sample; a command is the number of the client and of the glove, 1 where it must be kept, five values of
stiffness and five set points. It takes the orders of `tools.fake_peer`, and these:

| order | effect |
|---|---|
| unplug, plug | frames without gloves; with them again |
| swap | every glove says that it is the other hand's |
| bytes, frames | every byte is sent on its own; frame by frame again |
| garbage N | N messages that are no frames, in one go |
| length N | a length of N, then nothing that belongs to it |
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

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
from tools.fake_peer import FakePeer, FakeServer, PeerLog, peer_parser

COUNT_LOW, COUNT_SPAN = 700.0, 2400.0
"""Raw counts at 0, and from 0 to 1."""


class Impedance(NamedTuple):
    """Command to the fingers of one glove.

    Attributes:
        stiffness: Stiffness of thumb to little finger, 0 (free) to 1.
        set_point: Bend at which a force begins, 0 to 1; positive against closing, negative against opening.
        kept: True if the server may not drop the command for a newer one (has_index).
    """

    device_id: int
    stiffness: tuple[float, ...]
    set_point: tuple[float, ...]
    kept: bool


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


def decode_impedances(payload: bytes) -> list[Impedance]:
    """Return the impedances of a command, 0 for fingers that it does not name; raises WireError if it is none."""
    command = parse_message("Command", payload)
    found = []
    for impedance in command.impedance:
        fingers = [getattr(impedance, name) for name in FINGER_FIELDS]
        stiffness = tuple(finger.stiffness for finger in fingers)
        set_point = tuple(finger.set_point for finger in fingers)
        found.append(Impedance(command.id, stiffness, set_point, impedance.has_index))
    return found


class FakeDexmoServer(FakePeer):
    """Server that listens from the beginning."""

    def __init__(self, options: argparse.Namespace) -> None:
        log = PeerLog(options.log)
        self._server = FakeServer(options.port, log)
        orders: dict[str, Callable[[int], object]] = {
            "unplug": lambda number: setattr(self, "_plugged", False),
            "plug": lambda number: setattr(self, "_plugged", True),
            "swap": lambda number: self._swap(),
            "bytes": lambda number: setattr(self._server, "at_once", 1),
            "frames": lambda number: setattr(self._server, "at_once", sys.maxsize),
            "garbage": lambda number: self._server.send(framed(b"\xff" * 24) * number),
            "length": lambda number: self._server.send(LENGTH.pack(number)),
        }
        super().__init__(options, log, self._server, orders)
        parts = (part.partition(":") for part in options.gloves.split(","))
        self._gloves = [(int(number), hand == "right") for number, _, hand in parts]
        self._counts, self._battery = options.counts, options.battery
        self._plugged = True
        self._streams: dict[int, bytearray] = {}

    def send(self, number: int, channels: FloatArray) -> None:
        """See `FakePeer.send`."""
        if self._counts:
            channels = np.round(COUNT_LOW + COUNT_SPAN * channels)
        values = tuple(channels.tolist())
        gloves = [GloveMessage(glove, values, right, self._battery) for glove, right in self._gloves]
        now = time.monotonic_ns()
        for client in self._server.send(framed(encode_frame(gloves if self._plugged else []))):
            self.log.sent([client, number], now)

    def receive(self, end: int) -> None:
        """See `FakePeer.receive`."""
        data = self._server.receive(end)
        now = time.monotonic_ns()
        if not data:
            return
        client = self._server.client(end)
        stream = self._streams.setdefault(client, bytearray())
        stream += data
        try:
            while (payload := next_message(stream)) is not None:
                for impedance in decode_impedances(payload):
                    self.log.command(
                        [client, impedance.device_id, impedance.kept, *impedance.stiffness, *impedance.set_point], now
                    )
        except HhsimError:
            self._server.drop(end)

    def _swap(self) -> None:
        self._gloves = [(number, not right) for number, right in self._gloves]


def main() -> None:
    """Run the server of the command line."""
    parser = peer_parser("dexmo_server", str(__doc__))
    parser.add_argument("--port", type=int, default=0, help="TCP port on 127.0.0.1; 0 for any that is free")
    parser.add_argument("--gloves", default="337785601:right", help="numbers and hands, NUMBER:right,NUMBER:left")
    parser.add_argument("--counts", action="store_true", help="send raw counts instead of 0 to 1")
    parser.add_argument("--battery", type=int, default=87, help="charge [%%]")
    FakeDexmoServer(parser.parse_args()).run()


if __name__ == "__main__":
    main()
