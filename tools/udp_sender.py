"""A fake glove that speaks the open packet: `python -m tools.udp_sender --log FILE`.

Its orders are those of `tools.fake_peer`; `back` begins another session. In its log, a frame is the five
bends, its seq, and which session it is, from 1; a command is five bends, five values of stiffness, its session, its seq
and what it answers.
"""

import argparse
import os
import socket
import time

import numpy as np
from numpy.typing import NDArray

from hhsim.live.open_packet import NONE_YET, Kind, PacketError, decode_packet, encode_packet
from hhsim.recordings.dexmo_regression import DexmoRegression
from tools.fake_peer import BENDS, FakePeer, PeerLog, peer_parser

KINDS = {"bends": Kind.BENDS, "channels": Kind.CHANNELS, "joints": Kind.JOINTS}


class FakeUdpGlove(FakePeer):
    """The glove and its bridge, which is its own line."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__(options, PeerLog(options.log), self)
        self._kind = KINDS[options.kind]
        self._target = (options.host, options.port)
        self._pose_port = options.pose_port
        self._lose, self._swap = options.lose, options.swap
        self._random = np.random.default_rng(options.seed)
        self._regression = DexmoRegression.default()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((options.host, options.port + 1))
        self._socket.setblocking(False)
        self._sessions = 0
        self._answers = NONE_YET
        self.open()

    @property
    def where(self) -> str:
        """See `Line.where`."""
        return str(self._target[1])

    def open(self) -> None:
        """See `Line.open`; a new session, as of a bridge that was started."""
        self._session = int.from_bytes(os.urandom(4), "little")
        self._seq = 0
        self._sessions += 1
        self._kept: tuple[bytes, list[float]] | None = None

    def close(self) -> None:
        """See `Line.close`; it only falls silent."""

    def ends(self) -> list[int]:
        """See `Line.ends`."""
        return [self._socket.fileno()]

    def send(self, number: int, channels: NDArray[np.float64]) -> None:
        """See `FakePeer.send`."""
        bends = channels[list(BENDS)]
        if self._kind is Kind.BENDS:
            values = bends
        elif self._kind is Kind.CHANNELS:
            values = channels
        else:
            flexion, abduction = self._regression.angles(channels)
            values = np.concatenate([flexion.ravel(), abduction])
        now = time.monotonic_ns()
        data = self._packet(self._kind, values, now)
        row = [*bends, self._seq, self._sessions]
        self._seq += 1
        if self._random.random() < self._lose and not self.faulty:
            self.log.note(f"lost {row[5]}")
            return
        if self._kept is None and self._random.random() < self._swap and not self.faulty:
            self._kept = data, row
            return
        for packet, numbers in ((data, row), *([self._kept] if self._kept else [])):
            # As it is sent: what the glove hears later than this was made from it.
            self.log.sent(numbers, time.monotonic_ns())
            self._socket.sendto(packet, self._target)
        self._kept = None
        if self._pose_port:
            turn = 0.2 * np.sin(0.001 * number)
            pose = [0.1 * np.sin(0.002 * number), 0.0, 0.3, np.cos(turn), 0.0, 0.0, np.sin(turn)]
            self._socket.sendto(self._packet(Kind.POSE, pose, now), (self._target[0], self._pose_port))

    def _packet(self, kind: Kind, values: "np.typing.ArrayLike", now: int) -> bytes:
        return encode_packet(
            kind, values, session=self._session, seq=self._seq, t_ns=now, answers=self._answers, battery=80
        )

    def receive(self, end: int) -> None:
        """See `FakePeer.receive`."""
        while True:
            try:
                data = self._socket.recv(512)
            except BlockingIOError:
                return
            except OSError:
                continue
            now = time.monotonic_ns()
            try:
                packet = decode_packet(data)
            except PacketError as error:
                self.log.note(f"not a command: {error}")
                continue
            self._answers = packet.seq
            self.log.command([*packet.values.tolist(), packet.session, packet.seq, packet.answers], now)


def main() -> None:
    """Run a fake glove."""
    parser = peer_parser("udp_sender", str(__doc__), rate=1000.0)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=24170, help="where samples go; commands come to the next one")
    parser.add_argument("--pose-port", type=int, default=0, help="also send a palm there")
    parser.add_argument("--kind", choices=sorted(KINDS), default="joints")
    parser.add_argument("--lose", type=float, default=0.0, help="share of samples that are never sent")
    parser.add_argument("--swap", type=float, default=0.0, help="share of samples that are sent behind the next one")
    FakeUdpGlove(parser.parse_args()).run()


if __name__ == "__main__":
    main()
