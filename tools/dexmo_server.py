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
from collections.abc import Callable

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.live.link.dexmo_codec import LENGTH, GloveMessage, MessageStream, decode_impedances, encode_frame, framed
from tools.fake_peer import FakePeer, FakeServer, PeerLog, peer_parser

COUNT_LOW, COUNT_SPAN = 700.0, 2400.0
"""Raw counts at 0, and from 0 to 1."""


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
        self._streams: dict[int, MessageStream] = {}

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
        stream = self._streams.setdefault(client, MessageStream())
        stream.feed(data)
        try:
            while (payload := stream.next()) is not None:
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
