"""Log of a live session, as its report shows it."""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.result.reader import Result
from hhsim.result.schema import FAULT


class SessionLog(NamedTuple):
    """Events of a session: time since its first tick was due [s], level (0 information, 1 warning, 2 fault), text."""

    time: FloatArray
    level: IntArray
    text: list[str]

    @property
    def faults(self) -> FloatArray:
        """Times of the faults [s]."""
        return self.time[self.level >= FAULT]


def session_log(result: Result) -> SessionLog:
    """Read the log of a session; it is empty for a replay, or if it cannot be read."""
    try:
        times, levels = result["live/event/time"], np.asarray(result["live/event/level"])
        texts = result["live/event/text"]
        begin = int(result["live/tick/deadline"][0]) if result.ticks else int(times[0]) if len(times) else 0
    except InputError:
        return SessionLog(np.empty(0), np.empty(0, np.int64), [])
    lines = [text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text) for text in texts]
    # Differences of whole nanoseconds: seconds since the machine's start would lose the last digits.
    return SessionLog(1e-9 * (times - begin), levels, lines)
