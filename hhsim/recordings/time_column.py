"""Which column or key holds the stamps, and in which unit, by its name."""

import re
from collections.abc import Iterable
from typing import NamedTuple

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_TIME_WORDS = {"time", "timestamp", "stamp", "timestamps", "t", "clock"}
_UNIT_WORDS = {
    "s": "s",
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "ms": "ms",
    "msec": "ms",
    "millis": "ms",
    "milliseconds": "ms",
    "us": "us",
    "usec": "us",
    "micros": "us",
    "microseconds": "us",
    "ns": "ns",
    "nsec": "ns",
    "nanos": "ns",
    "nanoseconds": "ns",
}
_OWN_CLOCK = {"device", "sample", "capture", "tracking", "sensor"}


class TimeColumn(NamedTuple):
    """A column of stamps.

    Attributes:
        name: As the file has it.
        unit: s, ms, us or ns; None where the name does not say.
        others: The file's other columns of stamps.
    """

    name: str
    unit: str | None
    others: tuple[str, ...] = ()


def time_column(names: Iterable[str]) -> TimeColumn | None:
    """The column of stamps among these, None without any; of several that of the device, which knows no delay."""
    found = [(name, words) for name in names if (words := _words(name)) & _TIME_WORDS and not words & {"zone", "of"}]
    if not found:
        return None
    name, words = next((each for each in found if each[1] & _OWN_CLOCK), found[0])
    unit = next((_UNIT_WORDS[word] for word in sorted(words) if word in _UNIT_WORDS), None)
    return TimeColumn(name, unit, tuple(other for other, _ in found if other != name))


def _words(name: str) -> set[str]:
    return {word.lower() for word in _WORD.findall(name)}
