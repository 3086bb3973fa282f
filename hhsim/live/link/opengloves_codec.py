"""Letter format of OpenGloves and LucidGloves: a line of ASCII for a sample, and one for a command.

A sample, as the firmware writes it (github.com/LucidVR/lucidgloves, Encoding.ino; github.com/senseshift/opengloves-lib,
alpha.hpp; facts only)::

    A1023B2047C0D0E4095F2047G2047P0JK(AB)2047(BB)2047(CB)2047(DB)2047(EB)2047

docs/lab/gloves.md has the keys. F, G and P are stick and trigger, H to O buttons without a number, all ignored;
(ZV), (ZG) and (ZH), firmware, kind and hand, are in lines without fingers. Keys may come in any order, each once. A
command is `A%dB%dC%dD%dE%d` from 0, free, to 1000, blocked fully extended; negative leaves a finger as it is.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

FINGER_KEYS = ("A", "B", "C", "D", "E")
LONGEST_LINE = 512
"""Bytes of a line; a glove's are shorter than 200."""
FULL_LIMIT = 1000
RELEASE = b"\nA0B0C0D0E0\n"
"""Message that frees all fingers; the newline before it ends whatever was sent by half."""

_TOKEN = re.compile(rb"(?:\(([A-Z]{2,3})\)|([A-Z]))(-?\d{1,6}(?:\.\d{1,6})?)?")
_NONE = (math.nan,) * 5
_NO_JOINTS = ((math.nan,) * 4,) * 5


class LineError(ValueError):
    """A line that is not of the format; the message names the place."""


class GloveLine(NamedTuple):
    """A sample in the glove's own numbers, NaN if missing: curl and splay of the fingers, four joints of each."""

    curl: tuple[float, ...]
    splay: tuple[float, ...]
    joints: tuple[tuple[float, ...], ...]


def parse_line(line: bytes) -> GloveLine | None:
    """Parse a line without its end; returns None if it holds no fingers.

    LineError if it is not of the format, or holds a key twice or only some of the fingers.
    """
    found: dict[str, float] = {}
    place = 0
    while place < len(line):
        token = _TOKEN.match(line, place)
        if token is None:
            raise LineError(f"{line[:40]!r}: byte {place} is no key of the letter format")
        key = (token.group(1) or token.group(2)).decode()
        if key in found:
            raise LineError(f"{line[:40]!r}: {key} twice; expected each key once")
        found[key] = math.nan if token.group(3) is None else float(token.group(3))
        place = token.end()
    if not found:
        raise LineError("an empty line")
    curl = tuple(found.get(key, math.nan) for key in FINGER_KEYS)
    known = sum(math.isfinite(value) for value in curl)
    if known == 0:
        return None
    if known < len(FINGER_KEYS):
        raise LineError(f"{line[:40]!r}: {known} of 5 fingers")
    if not any(len(key) > 1 for key in found):
        return GloveLine(curl, _NONE, _NO_JOINTS)
    return GloveLine(
        curl,
        tuple(found.get(f"{key}B", math.nan) for key in FINGER_KEYS),
        tuple(tuple(found.get(f"{key}A{bone}", math.nan) for bone in "ABCD") for key in FINGER_KEYS),
    )


def format_limits(limits: Sequence[int]) -> bytes:
    """Encode a command: five numbers, 0 free to 1000 blocked fully extended."""
    return ("".join(f"{key}{value:d}" for key, value in zip(FINGER_KEYS, limits)) + "\n").encode()


class LineStream:
    """Cuts a stream of bytes into lines; the rest of one at its begin is skipped unless it begins with a `whole` one.

    `overlong` is the number of skipped lines longer than `LONGEST_LINE`.
    """

    def __init__(self, *, whole: bool) -> None:
        self.overlong = 0
        self._rest = b""
        self._skips = not whole

    def feed(self, data: bytes) -> list[bytes]:
        """Append what arrived; returns the lines that are whole now, without their ends and empty ones."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if lines and self._skips:
            del lines[0]
            self._skips = False
        if len(self._rest) > LONGEST_LINE:
            self.overlong += not self._skips
            self._rest, self._skips = b"", True
        kept = []
        for line in lines:
            bare = line.strip(b"\r \t\0")
            if len(bare) > LONGEST_LINE:
                self.overlong += 1
            elif bare:
                kept.append(bare)
        return kept
