"""Open packet: datagrams that bring any glove's samples to hhsim, and hhsim's commands to the glove.

A bridge is a program that speaks a glove's own protocol and this one. It sends every sample as a datagram to the port
where hhsim listens (24170), and listens for commands on the next port (24171); a tracker of the palm sends its poses to
24172. Both directions have the same header of 32 bytes, little-endian, followed by n numbers (float32):

| offset | type | field | meaning |
|---|---|---|---|
| 0 | char[4] | magic | "HHGL" |
| 4 | u8 | version | 1 |
| 5 | u8 | kind | kind of the numbers, below |
| 6 | u16 | n | number of numbers; the datagram is 32 + 4·n bytes long |
| 8 | u32 | session | any number that is new whenever the sender starts |
| 12 | u32 | seq | 0, 1, 2, … for the datagrams of this kind in this session, and around after 2³² |
| 16 | u64 | t_ns | time of the measurement on the sender's own clock [ns] |
| 24 | u32 | answers | seq of the newest datagram from the other side, 2³² − 1 before the first |
| 28 | i32 | battery | charge [%], −1 if unknown |

| kind | n | numbers |
|---|---|---|
| 1 bends | 5 | bend of thumb, index, middle, ring, little finger: 0 flat, 1 fist |
| 2 channels | 11 | thumb rotate, then split and bend of each finger: 0 to 1, or counts with a calibration file |
| 3 joints | 20 | flexion of thumb to little finger, proximal to distal (15), then abduction (5) [rad] |
| 4 pose | 7 | position of the palm [m], its orientation as unit quaternion (w, x, y, z); world |
| 5 hand | 208 | OpenXR's 26 joints, each orientation (x, y, z, w), position [m], radius [m]; NaN where not valid |
| 16 command | 10 | bend at which each finger is stopped (5), stiffness there, 0 free to 1 (5) |
| 17 forces | 15 | force on each fingertip, x, y, z [N], thumb to little finger, in the frame of the palm |

For the safety of the hand, a bridge obeys the newest command alone, and frees every finger when the numbers are not
finite or no command came for 100 ms. Commands come from more than one sender (the watchdog has its own session), so the
newest is the one that arrived last. Samples that arrive after a newer one are counted and not used. Another session, or
another sender, is accepted when the present one has been silent for 100 ms.
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
