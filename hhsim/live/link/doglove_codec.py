"""What a DOGlove says: frames of its main board on a serial line, and the datagrams of its published scripts.

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
"""Of the converter [V/count]."""
_DATAGRAM = np.dtype("<f4")


class FrameError(PacketError):
    """Bytes that are none of a DOGlove; the message says why."""


class Encoders(NamedTuple):
    """A reading of the main board.

    Attributes:
        degrees: Of the encoders in the board's order [deg], shape (16,).
        milliseconds: The board's clock, modulo 65,536; -1 where a datagram brought it.
    """

    degrees: FloatArray
    milliseconds: int = -1


def decode_frame(frame: bytes) -> Encoders:
    """Read a frame of the main board.

    Args:
        frame: `FRAME_BYTES`, the header first.

    Raises:
        FrameError: No header, a wrong sum, or no reference voltage.
    """
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
    """Read a datagram of the encoders' angles.

    Raises:
        FrameError: Another length.
    """
    return Encoders(_floats(data, ENCODERS))


def decode_servos(data: bytes) -> FloatArray:
    """Read a datagram of the servos' angles [deg], shape (5,), thumb to little finger.

    Raises:
        FrameError: Another length.
    """
    return _floats(data, SERVOS)


def _floats(data: bytes, count: int) -> FloatArray:
    if len(data) != 4 * count:
        raise FrameError(f"{len(data)} bytes; expected {4 * count}, {count} numbers")
    numbers: FloatArray = np.frombuffer(data, _DATAGRAM).astype(np.float64)
    return numbers


class FrameStream:
    """Finds frames in the bytes of a serial line, which may begin and break off anywhere.

    Attributes:
        malformed: Frames whose sum is wrong.
        skipped: Bytes that belong to no frame, counted once for each run of them.
    """

    def __init__(self) -> None:
        """Nothing came yet."""
        self.malformed = self.skipped = 0
        self.begin()

    def begin(self) -> None:
        """The line is another one: what came by half is of no use."""
        self._bytes = b""
        self._lost = False

    def feed(self, data: bytes) -> list[Encoders]:
        """Take what arrived; returns the frames that are whole now, oldest first."""
        self._bytes += data
        found = []
        while len(self._bytes) >= FRAME_BYTES:
            if not self._bytes.startswith(HEADER):
                self._skip()
                continue
            try:
                found.append(decode_frame(self._bytes[:FRAME_BYTES]))
            except FrameError:
                # The header may have stood among the readings: what is behind it is looked through again.
                self.malformed += 1
                self._bytes = self._bytes[1:]
                self._lost = True
                continue
            self._bytes, self._lost = self._bytes[FRAME_BYTES:], False
        return found

    def _skip(self) -> None:
        if not self._lost:
            self.skipped += 1
            self._lost = True
        place = self._bytes.find(HEADER)
        # The header may have come by half.
        self._bytes = self._bytes[place:] if place >= 0 else self._bytes[1 - len(HEADER) :]
