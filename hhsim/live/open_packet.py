"""Open packet: datagrams that bring any glove's samples to hhsim, and hhsim's commands to the glove.

docs/live-protocols.md has header, kinds, ports, and what a bridge owes the hand in the glove.
"""

import select
import socket
import struct
import time
from collections.abc import Collection
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.live.device import DeviceCounters, DeviceError
from hhsim.live.tcp import ready

MAGIC = b"HHGL"
VERSION = 1
HEADER = struct.Struct("<4sBBHIIQIi")
NONE_YET = 2**32 - 1
MODULUS = 2**32
NUMBERS = np.dtype("<f4")


class Kind(IntEnum):
    """Kind of the numbers of a packet."""

    BENDS = 1
    JOINTS = 3
    POSE = 4
    HAND = 5
    COMMAND = 16
    FORCES = 17


COUNT = dict(zip(Kind, (5, 20, 7, 208, 10, 15), strict=True))
"""Number of numbers of each kind."""
LONGEST = HEADER.size + 4 * max(COUNT.values())

BUFFER = 1 << 20
"""Receive buffer of the system [bytes]; some seconds at 1 kHz."""
MOST_LOOKED_AT = 64
"""Datagrams read at once, so that a flood cannot delay the reader."""
SESSION_SILENCE_NS = 100_000_000
"""Silence of a session after which another one is accepted [ns]."""


class PacketError(ValueError):
    """A datagram that is no open packet; the message names the difference."""


class Packet(NamedTuple):
    """One datagram, with the fields of the header; its numbers may be anything, NaN too."""

    kind: Kind
    session: int
    seq: int
    t_ns: int
    answers: int
    battery: int
    values: NDArray[np.float32]


def encode_packet(
    kind: Kind, values: ArrayLike, *, session: int, seq: int, t_ns: int, answers: int = NONE_YET, battery: int = -1
) -> bytes:
    """Encode a packet; `seq` is taken modulo 2³². Raises PacketError if `kind` does not have as many values."""
    numbers = np.asarray(values, dtype=NUMBERS).ravel()
    if numbers.size != COUNT[kind]:
        raise PacketError(f"{numbers.size} numbers of kind {kind}; expected {COUNT[kind]}")
    header = HEADER.pack(MAGIC, VERSION, kind, numbers.size, session, seq % MODULUS, t_ns, answers, battery)
    return header + numbers.tobytes()


def decode_packet(data: bytes) -> Packet:
    """Decode a datagram; raises PacketError for another magic, version, kind or length."""
    if len(data) < HEADER.size:
        raise PacketError(f"{len(data)} bytes; expected at least {HEADER.size}")
    magic, version, kind, count, session, seq, t_ns, answers, battery = HEADER.unpack_from(data)
    if magic != MAGIC or version != VERSION:
        raise PacketError(f"begins with {magic!r}, version {version}, not {MAGIC!r}, {VERSION}")
    if count != COUNT.get(kind):
        known = ", ".join(f"{int(one)} with {size}" for one, size in COUNT.items())
        raise PacketError(f"kind {kind} with {count} numbers; expected one of {known}")
    if len(data) != HEADER.size + 4 * count:
        raise PacketError(f"{len(data)} bytes; expected {HEADER.size + 4 * count} for {count} numbers")
    values = np.frombuffer(data, NUMBERS, count, HEADER.size).astype(np.float32)
    return Packet(Kind(kind), session, seq, t_ns, answers, battery, values)


def resolve(host: str) -> str:
    """Return the IPv4 address of a host; raises DeviceError if there is none."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise DeviceError(f"udp: no host {host}: {error.strerror or error}") from None


class PacketOrder:
    """Order of datagrams by `seq`, per session; `lost` counts those that came late, or never."""

    def __init__(self) -> None:
        self.lost = self.sessions = 0
        self._session = self._newest = -1
        self._newest_ns = 0

    def take(self, session: int, seq: int, now_ns: int) -> bool:
        """Count a datagram that came at `now_ns`; True if it is newer than all before it."""
        if session != self._session:
            if self._session >= 0 and now_ns - self._newest_ns < SESSION_SILENCE_NS:
                return False
            self.sessions += 1
            self._session = session
        else:
            ahead = (seq - self._newest) % MODULUS
            if not 0 < ahead < MODULUS // 2:
                return False
            self.lost += ahead - 1
        self._newest, self._newest_ns = seq, now_ns
        return True


class UdpPort:
    """Reads the datagrams of one host without waiting; DeviceError for no such host, or a port that is taken.

    `counters` count each datagram of that host; `hint` describes the last unusable one since a usable one, or is "".
    """

    def __init__(self, host: str, port: int, counters: DeviceCounters | None = None) -> None:
        self.address = resolve(host)
        self.counters = counters or DeviceCounters()
        self.hint = ""
        self._order = PacketOrder()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # Packets of this machine are expected on its own address only.
        own = self.address if self.address.startswith("127.") else ""
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self._socket.bind((own, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(f"udp port {port} from {host}: cannot listen: {error.strerror or error}") from None

    def read(self, most: int, kinds: Collection[Kind]) -> list[tuple[Packet, int]]:
        """Return the next packets of these kinds, at most `most`, newer than all before them; all others are counted.

        Each has CLOCK_MONOTONIC when it was read [ns]. No more than `MOST_LOOKED_AT` datagrams are read.
        """
        found: list[tuple[Packet, int]] = []
        counters = self.counters
        for _ in range(MOST_LOOKED_AT if most > 0 else 0):
            try:
                data, sender = self._socket.recvfrom(LONGEST + 1)
            except BlockingIOError:
                break
            except OSError:
                # An error of an earlier send, which does not concern what arrives.
                continue
            now = time.monotonic_ns()
            if sender[0] != self.address:
                self.hint = f"packets come from {sender[0]} instead"
                continue
            counters.frames += 1
            try:
                packet = decode_packet(data)
            except PacketError as error:
                counters.malformed += 1
                self.hint = f"what came is no open packet: {error}"
                continue
            if packet.kind not in kinds:
                counters.other += 1
                wanted = ", ".join(str(int(kind)) for kind in kinds)
                self.hint = f"packets of kind {int(packet.kind)} come; expected kind {wanted}"
            elif self._order.take(packet.session, packet.seq, now):
                found.append((packet, now))
                self.hint = ""
                if len(found) == most:
                    break
            else:
                counters.other += 1
        counters.dropped, counters.resyncs = self._order.lost, max(0, self._order.sessions - 1)
        return found

    @property
    def descriptor(self) -> int:
        """File descriptor to poll for incoming datagrams."""
        return self._socket.fileno()

    def wait(self, timeout: float) -> bool:
        """Wait until something has arrived, at most `timeout` [s]; True if it has."""
        return ready(self._socket.fileno(), select.POLLIN, timeout)

    def close(self) -> None:
        """Close the port; never raises."""
        self._socket.close()
