"""Figures of a live session: its times, and its faults: an early end, malformed packets, fingers freed for safety."""

import signal
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import DamagedFileError, InputError
from hhsim.metrics.run_metric import Figure
from hhsim.result.miss_cause import WORDS
from hhsim.result.reader import Result
from hhsim.result.safety import Safety
from hhsim.result.schema import FAULT

_TIMES = {
    "wakeup": "wake-up after the deadline",
    "latency": "sample in to command out",
    "tick": "the solver's tick, wall",
}
_PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}

MISSED_BY: tuple[Figure, ...] = tuple(
    Figure(f"missed_{cause.name.lower()}", f"missed: {words}") for cause, words in WORDS.items()
)
"""Missed ticks by cause."""

SESSION_TIMES: tuple[Figure, ...] = (
    Figure("missed", "missed ticks"),
    *(
        Figure(f"{name}_{part}", f"{label}, {words}", 1, "µs")
        for name, label in _TIMES.items()
        for part, words in _PERCENTILES.items()
    ),
)
"""Figures in the order of the session's table and, in SI units, of its /summary."""

IN_ORDER = frozenset(("duration", "stopped", "SIGINT"))
"""Reasons of an orderly end: the duration, or the user."""
SIGNALS = frozenset(number.name for number in signal.Signals)
"""Reasons of an end by another process: orderly where no duration was asked for."""
FREED_FOR_SAFETY = ~(Safety.STOPPING | Safety.DRY_RUN | Safety.NO_INPUT_YET)
"""Reasons of free fingers that nobody asked for: faults of the log, and its warnings, such as late input."""


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
    """Read the log of a session, empty for a replay; DamagedFileError for times, levels and texts that are no log."""
    if result.live is None:
        return SessionLog(np.empty(0), np.empty(0, np.int64), [])
    times, levels, texts = (result[f"live/event/{name}"] for name in ("time", "level", "text"))
    for name, values in (("time", times), ("level", levels)):
        if values.dtype.kind not in "iuf" or values.shape != (len(texts),):
            raise DamagedFileError(
                f"{result.path}: live/event/{name} is {values.dtype} {values.shape}; expected numbers"
            )
    begin = (result["live/tick/deadline"] if result.ticks else times)[:1].sum()
    # Differences of whole nanoseconds: seconds since the machine's start would lose the last digits.
    return SessionLog(1e-9 * (times - begin), levels, [bytes(text).decode("utf-8", "replace") for text in texts])


class FaultCounts(NamedTuple):
    """Counts of a session's faults; NaN where one is not known."""

    early: float  # 1 for a session that did not end in order, or whose recording was cut short; else 0
    faults: float  # logged faults; an early end is one at least
    malformed: float  # malformed packets of the glove, and all packets
    frames: float
    freed: float  # ticks with fingers freed for safety, by a fault or a warning, and all ticks
    ticks: float

    @property
    def line(self) -> str:
        """Return the counts in one line."""
        _, faults, malformed, frames, freed, ticks = ("—" if np.isnan(count) else f"{count:,.0f}" for count in self)
        return (
            f"faults: {faults}{' (ended early)' if self.early else ''}; malformed packets: {malformed} of {frames}; "
            f"ticks with fingers freed for safety: {freed} of {ticks}"
        )

    @property
    def figures(self) -> dict[str, float]:
        """Return the figures of `SESSION_FAULTS` by name."""
        malformed, freed = _share(self.malformed, self.frames), _share(self.freed, self.ticks)
        return dict(zip((fault.name for fault in SESSION_FAULTS), (self.early, self.faults, malformed, freed)))


@dataclass(frozen=True, kw_only=True)
class SessionFault(Figure):
    """Figure of a session's faults, a count or in %; `limit` is the default one."""

    limit: float


_IN_PERCENT: dict[str, Any] = {"digits": 3, "unit": "%"}
SESSION_FAULTS = (
    SessionFault(name="ended_early", label="ended early or was killed (1: yes)", limit=0.0),
    SessionFault(name="faults", label="faults, an early end included", limit=0.0),
    SessionFault(name="malformed_share", label="malformed packets, of all of the glove's", limit=0.1, **_IN_PERCENT),
    SessionFault(name="freed_share", label="ticks with fingers freed for safety", limit=1.0, **_IN_PERCENT),
)
"""Figures in the order of a table, and of `FaultCounts.figures`."""


def recorded_faults(session: Result) -> FaultCounts:
    """Count the faults of a recorded session; NaN for packets that its file does not tell of."""
    early = float(bool(broken_off(session)))
    try:
        counters = session.live_json("counters")
    except InputError:
        counters = {}
    malformed, frames = (float(counters.get(name, np.nan)) for name in ("malformed", "frames"))
    return FaultCounts(
        early=early,
        faults=max(early, float(len(session_log(session).faults))),
        malformed=malformed,
        frames=frames,
        freed=float(np.sum(session["live/tick/safety"] & int(FREED_FOR_SAFETY) > 0)),
        ticks=float(session.ticks),
    )


def how_it_ended(result: Result) -> str:
    """Reason of a session's end; "" of a replay."""
    if result.live is None:
        return ""
    ended = str(result.live["ended"])
    return "the recording was cut short" if not ended or (ended in IN_ORDER and not result.complete) else ended


def ended_before_its_time(result: Result) -> str:
    """Reason and time of an end before the duration that was asked for; "" of any other run."""
    ended = how_it_ended(result)
    if ended in ("", "duration") or result.scene["duration"] is None:
        return ""
    periods = result.ticks + int(result.summary.get("missed", 0))
    return f"{_in_words(ended)} after {periods / result.rate:.1f} of {result.scene['duration']:g} s"


def broken_off(result: Result) -> str:
    """Reason of an end out of order; "" of any other run."""
    ended = how_it_ended(result)
    if not ended or ended in IN_ORDER or (ended in SIGNALS and result.scene["duration"] is None):
        return ""
    return ended_before_its_time(result) or _in_words(ended)


def _in_words(ended: str) -> str:
    return f"ended by {ended}" if ended in SIGNALS else ended


def _share(count: float, of: float) -> float:
    return 100.0 * count / of if of else np.nan
