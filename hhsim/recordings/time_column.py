"""Detection of the column or key that holds the stamps, and of its unit, by its name."""

import re
from collections.abc import Iterable
from typing import NamedTuple

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_TIME_WORDS = {"time", "timestamp", "stamp", "timestamps", "t", "clock"}
_UNIT_WORDS = {
    word: words.split()[0]
    for words in (
        "s sec secs second seconds",
        "ms msec millis milliseconds",
        "us usec micros microseconds",
        "ns nsec nanos nanoseconds",
    )
    for word in words.split()
}
_OWN_CLOCK = {"device", "sample", "capture", "tracking", "sensor"}


class TimeColumn(NamedTuple):
    """Column of stamps.

    Attributes:
        unit: Unit: s, ms, us or ns; None if the name does not say.
        others: Other columns of stamps in the file.
    """

    name: str
    unit: str | None
    others: tuple[str, ...] = ()


def time_column(names: Iterable[str]) -> TimeColumn | None:
    """Return the column of stamps among these, or None; of several that of the device, which has no delay."""
    words_of = {name: {word.lower() for word in _WORD.findall(name)} for name in names}
    found = [(name, words) for name, words in words_of.items() if words & _TIME_WORDS and not words & {"zone", "of"}]
    if not found:
        return None
    name, words = next((each for each in found if each[1] & _OWN_CLOCK), found[0])
    unit = next((_UNIT_WORDS[word] for word in sorted(words) if word in _UNIT_WORDS), None)
    return TimeColumn(name, unit, tuple(other for other, _ in found if other != name))
