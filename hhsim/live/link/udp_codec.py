"""Open packet: datagrams that bring any glove's samples to hhsim, and hhsim's commands to the glove.

docs/live-protocols.md has header, kinds, ports, and what a bridge owes the hand in the glove.
"""

import struct
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAGIC = b"HHGL"
VERSION = 1
HEADER = struct.Struct("<4sBBHIIQIi")
NONE_YET = 2**32 - 1
NUMBERS = np.dtype("<f4")


class Kind(IntEnum):
    """Kind of the numbers of a packet."""

    BENDS = 1
    CHANNELS = 2
    JOINTS = 3
    POSE = 4
    HAND = 5
    COMMAND = 16
    FORCES = 17


COUNT = dict(zip(Kind, (5, 11, 20, 7, 208, 10, 15), strict=True))
"""Number of numbers of each kind."""
LONGEST = HEADER.size + 4 * max(COUNT.values())


class PacketError(ValueError):
    """A datagram that is no open packet; the message names the difference."""


class Packet(NamedTuple):
    """One datagram, with the fields of the module's docstring; its numbers may be anything, NaN too."""

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
    header = HEADER.pack(MAGIC, VERSION, kind, numbers.size, session, seq & NONE_YET, t_ns, answers, battery)
    return header + numbers.tobytes()


def decode_packet(data: bytes) -> Packet:
    """Decode a datagram; raises PacketError for another magic, version, kind or length."""
    if len(data) < HEADER.size:
        raise PacketError(f"{len(data)} bytes; expected at least {HEADER.size}")
    magic, version, kind, count, session, seq, t_ns, answers, battery = HEADER.unpack_from(data)
    if magic != MAGIC or version != VERSION:
        raise PacketError(f"begins with {magic!r}, version {version}, not {MAGIC!r}, {VERSION}")
    if kind not in COUNT:
        raise PacketError(f"kind {kind}; expected one of {', '.join(str(int(known)) for known in COUNT)}")
    if count != COUNT[Kind(kind)]:
        raise PacketError(f"kind {kind} with {count} numbers; expected {COUNT[Kind(kind)]}")
    if len(data) != HEADER.size + 4 * count:
        raise PacketError(f"{len(data)} bytes; expected {HEADER.size + 4 * count} for {count} numbers")
    values = np.frombuffer(data, NUMBERS, count, HEADER.size).astype(np.float32)
    return Packet(Kind(kind), session, seq, t_ns, answers, battery, values)
