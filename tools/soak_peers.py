"""The fake gloves of a long run: what each of them sent to the loop and heard from it, in one form."""

import os
import socket
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.live.devices.registry import GloveConfig, configure
from hhsim.result.reader import Result
from tools.fake_gloves import FakeDexmo, FakeGlove

Times = NDArray[np.int64]

LEFT_OUT = 64
"""So many rows may be missing in one place."""
LINE_HOLDS = 4096 // 11
"""Commands in the line's buffer of 4 kB; the shortest has 11 bytes."""
PRIORITY = 20
"""Of a glove's process under SCHED_FIFO: below the loop and its watchdog."""


@dataclass(frozen=True, eq=False)
class PeerSeen:
    """A session as its glove saw it; times are CLOCK_MONOTONIC [ns].

    Attributes:
        sent: When each frame was sent to the loop.
        of_sample: The frame of each recorded sample, by its number since the glove was opened; -1: of none.
        received: When each command came, ascending.
        before: Frames that were sent before the loop had opened the glove, and that it threw away.
        taken_back: Most commands that were on their way when the fingers were freed, and that this took back.
    """

    sent: Times
    of_sample: Times
    received: Times
    before: int = 0
    taken_back: int = 0


class SoakPeer(ABC):
    """A fake glove in a process of its own, while the block runs.

    Args:
        folder: For its log.
        rate: Frames a second [Hz].
        seed: Of its motion.
    """

    name: str
    usual_rate: float

    def __init__(self, folder: Path, rate: float, seed: int) -> None:
        """Nothing runs yet."""
        self.log = folder / f"{self.name}.log"
        # Gloves go on with a log that is there.
        self.log.unlink(missing_ok=True)
        self.rate = rate
        self.seed = seed

    @abstractmethod
    def __enter__(self) -> Self:
        """Start it."""

    @abstractmethod
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End it."""

    @property
    @abstractmethod
    def pid(self) -> int:
        """Its process."""

    @property
    @abstractmethod
    def config(self) -> GloveConfig:
        """How the loop reaches it."""

    @abstractmethod
    def seen(self, result: Result) -> PeerSeen:
        """What it wrote down of the session that this is the recording of."""


class DexmoPeer(SoakPeer):
    """A TCP server of Dexmo frames."""

    name = "dexmo"
    usual_rate = 200.0

    def __enter__(self) -> Self:
        self._server = FakeDexmo(self.log, "--rate", str(self.rate), "--seed", str(self.seed))
        self._server.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._server.__exit__(kind, error, at)

    @property
    def pid(self) -> int:
        """See `SoakPeer.pid`."""
        return self._server.pid

    @property
    def config(self) -> GloveConfig:
        """See `SoakPeer.config`."""
        return configure("dexmo", port=self._server.port)

    def seen(self, result: Result) -> PeerSeen:
        """See `SoakPeer.seen`; the loop's connection is the one that tells most."""
        frames, commands = self._server.frames, self._server.commands
        if not commands.size:
            raise HhsimError("the glove heard no command")
        loop = np.bincount(commands["client"]).argmax()
        frames = frames[frames["client"] == loop]["time_ns"]
        received = commands[commands["client"] == loop]["time_ns"]
        # A connection brings every frame once and in order.
        return PeerSeen(frames, np.arange(len(frames)), np.sort(received))


class LinePeer(SoakPeer):
    """A pseudo-terminal that speaks the letter format."""

    name = "opengloves"
    usual_rate = 200.0

    def __enter__(self) -> Self:
        link = self.log.with_suffix(".line")
        options = ("--link", link, "--rate", self.rate, "--seed", self.seed)
        self._peer = FakeGlove("tools.opengloves_board", self.log, *options)
        self._peer.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._peer.end()

    @property
    def pid(self) -> int:
        """See `SoakPeer.pid`."""
        return self._peer.pid

    @property
    def config(self) -> GloveConfig:
        """See `SoakPeer.config`."""
        return configure("opengloves", path=self._peer.where)

    def seen(self, result: Result) -> PeerSeen:
        """See `SoakPeer.seen`; a line begins anywhere, and its readings tell where."""
        record = self._peer.record()
        counts = np.round(4095.0 * record.sent[:, :5]).astype(np.int64)
        read = np.round(result["live/sample/channel"][:, :5]).astype(np.int64)
        places = places_of(counts, read)
        numbers = result["live/sample/seq"]
        frames = np.full(int(numbers.max()) + 1, -1, np.int64)
        frames[numbers] = places
        return PeerSeen(record.sent_ns, frames, np.sort(record.command_ns), int(places[0]), LINE_HOLDS)


class UdpPeer(SoakPeer):
    """A bridge that speaks the open packet."""

    name = "udp"
    usual_rate = 1000.0

    def __enter__(self) -> Self:
        self._port = free_port_pair()
        options = ("--port", self._port, "--rate", self.rate, "--seed", self.seed)
        self._peer = FakeGlove("tools.udp_sender", self.log, *options)
        self._peer.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._peer.end()

    @property
    def pid(self) -> int:
        """See `SoakPeer.pid`."""
        return self._peer.pid

    @property
    def config(self) -> GloveConfig:
        """See `SoakPeer.config`."""
        return configure("udp", port=self._port)

    def seen(self, result: Result) -> PeerSeen:
        """See `SoakPeer.seen`; packets are numbered."""
        record = self._peer.record()
        of_packet = {int(number): place for place, number in enumerate(record.sent[:, 5])}
        numbers, packets = result["live/sample/seq"], result["live/sample/device_seq"]
        frames = np.full(int(numbers.max()) + 1, -1, np.int64)
        frames[numbers] = [of_packet.get(int(packet), -1) for packet in packets]
        # Nobody listens before the loop does; packets to no port are lost.
        return PeerSeen(record.sent_ns, frames, np.sort(record.command_ns), of_packet[int(packets[0])])


PEERS: dict[str, type[SoakPeer]] = {peer.name: peer for peer in (DexmoPeer, LinePeer, UdpPeer)}


def measure_in_time(peer: SoakPeer) -> bool:
    """Let the glove's process look at its clock when it should: SCHED_FIFO, below the loop.

    What the scheduler would keep it waiting for is no part of what it measures. Whether the system granted it.
    """
    try:
        os.sched_setscheduler(peer.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return True


def places_of(sent: NDArray[Any], read: NDArray[Any]) -> Times:
    """Where in the rows that were sent each row that was read stands; both are in order, and rows may be left out.

    A line that nobody reads fills up, and what then does not fit of a row spoils the next one.

    Raises:
        HhsimError: A row was read that is not among the next ones that were sent.
    """
    reached = -1
    for first in np.flatnonzero((sent == read[0]).all(axis=1)):
        found = _followed(sent, read, int(first))
        if len(found) == len(read):
            return found
        reached = max(reached, len(found))
    raise HhsimError(f"what the loop read is not what the glove sent: from sample {max(reached, 0):,} on")


def _followed(sent: NDArray[Any], read: NDArray[Any], first: int) -> Times:
    """Places of the rows that were read, the first of which is `first`, as far as they are found."""
    found = [first]
    for row in read[1:]:
        begin = found[-1] + 1
        same = np.flatnonzero((sent[begin : begin + LEFT_OUT] == row).all(axis=1))
        if not same.size:
            break
        found.append(begin + int(same[0]))
    return np.array(found, np.int64)


def free_port_pair() -> int:
    """A UDP port of 127.0.0.1 that is free, and so is the next one."""
    while True:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
        ):
            first.bind(("127.0.0.1", 0))
            port = int(first.getsockname()[1])
            try:
                second.bind(("127.0.0.1", port + 1))
            except (OSError, OverflowError):
                continue
            return port
