"""Frames of a DOGlove's main board on a serial line, and the datagrams of its published scripts.

Facts of `Core/Src/main.c` of DOGlove_Firmware and of `glove_mcu.py` and `servo.py` of DOGlove, both MIT.
"""

import struct
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.live.link.udp_codec import PacketError

HEADER = b"\xaa\x55\x00\x00"
FRAME_BYTES = 76
ENCODERS = 16
SERVOS = 5
_WORDS = struct.Struct("<I16iI")
_FULL_SCALE = 5.0 / 0x7FFFFF
"""Resolution of the converter [V/count]."""
_DATAGRAM = np.dtype("<f4")


class FrameError(PacketError):
    """Bytes that are no frame or datagram of a DOGlove."""


class Encoders(NamedTuple):
    """Angles of the encoders in the board's order [deg], (16,), and its clock modulo 65,536 [ms], -1 in a datagram."""

    degrees: FloatArray
    milliseconds: int = -1


def decode_frame(frame: bytes) -> Encoders:
    """Decode a frame of the main board; raises FrameError for no header, a wrong sum, or no reference voltage."""
    if len(frame) != FRAME_BYTES or not frame.startswith(HEADER):
        raise FrameError("no frame of a DOGlove's board")
    reference, *readings, last = _WORDS.unpack_from(frame, len(HEADER))
    if (reference + sum(readings)) & 0xFFFF != last >> 16:
        raise FrameError("the sum of the frame is wrong")
    if reference == 0:
        raise FrameError("the board states no reference voltage")
    volts = np.array(readings, np.float64) * _FULL_SCALE
    return Encoders(volts / (1e-6 * reference) * 360.0, last & 0xFFFF)


def decode_encoders(data: bytes) -> Encoders:
    """Decode a datagram of the encoders' angles; raises FrameError for another length."""
    return Encoders(_floats(data, ENCODERS))


def decode_servos(data: bytes) -> FloatArray:
    """Decode a datagram of the servos' angles [deg], shape (5,), thumb to little finger; FrameError as above."""
    return _floats(data, SERVOS)


def _floats(data: bytes, count: int) -> FloatArray:
    if len(data) != 4 * count:
        raise FrameError(f"{len(data)} bytes; expected {4 * count}, {count} numbers")
    return np.frombuffer(data, _DATAGRAM).astype(np.float64)


class FrameStream:
    """Finds frames in the bytes of a serial line, which may begin and end anywhere.

    It counts frames with a wrong sum (`malformed`), and runs of bytes that belong to none (`skipped`).
    """

    def __init__(self) -> None:
        self.malformed = self.skipped = 0
        self.begin()

    def begin(self) -> None:
        """Discard half a frame of an earlier connection."""
        self._bytes = b""
        self._lost = False

    def feed(self, data: bytes) -> list[Encoders]:
        """Append what arrived; returns the frames that are whole now, oldest first."""
        self._bytes += data
        found = []
        while len(self._bytes) >= FRAME_BYTES:
            if not self._bytes.startswith(HEADER):
                self.skipped += not self._lost
                self._lost = True
                place = self._bytes.find(HEADER)
                # The end may be the first bytes of a header.
                self._bytes = self._bytes[place:] if place >= 0 else self._bytes[1 - len(HEADER) :]
                continue
            try:
                found.append(decode_frame(self._bytes[:FRAME_BYTES]))
            except FrameError:
                # The bytes of a header may occur among readings: search again behind it.
                self.malformed += 1
                self._bytes = self._bytes[1:]
                self._lost = True
                continue
            self._bytes, self._lost = self._bytes[FRAME_BYTES:], False
        return found
