"""What went wrong in a live session: an early end, faults, malformed packets, freed fingers."""

import json
import signal
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hhsim.errors import InputError
from hhsim.metrics.run_metric import Figure
from hhsim.result.reader import Result
from hhsim.result.safety import Safety
from hhsim.result.schema import FAULT

IN_ORDER = frozenset(("duration", "stopped", "SIGINT"))
"""Why a session ended that came to its end, or that its user stopped."""
SIGNALS = frozenset(number.name for number in signal.Signals)
"""Why one ended that somebody else stopped: in order where no duration was asked for."""
FREED_BY_FAULT = (
    Safety.STALE_INPUT
    | Safety.NOT_FINITE
    | Safety.SOLVER_FAILED
    | Safety.OVERRUN_STREAK
    | Safety.DEVICE_LOST
    | Safety.NO_WATCHDOG
)
"""Why the fingers are free where nobody asked for it."""


class FaultCounts(NamedTuple):
    """What went wrong in a session, counted; NaN where that is not known.

    Attributes:
        early: 1 of one that was not brought to its end in order, or whose recording was cut short; else 0.
        faults: Of its log; an early end is one at least, whether or not somebody was left to log it.
        malformed, frames: Malformed packets of the glove, and all of them.
        freed, ticks: Ticks with fingers that were freed by a fault, and all of them.
    """

    early: float
    faults: float
    malformed: float
    frames: float
    freed: float
    ticks: float

    @property
    def line(self) -> str:
        """All of them in a line."""
        _, faults, malformed, frames, freed, ticks = ("—" if np.isnan(count) else f"{count:,.0f}" for count in self)
        return (
            f"faults: {faults}{' (ended early)' if self.early else ''}; malformed packets: {malformed} of {frames}; "
            f"ticks with fingers freed by a fault: {freed} of {ticks}"
        )

    @property
    def figures(self) -> dict[str, float]:
        """The figures of `SESSION_FAULTS` by name."""
        malformed, freed = _share(self.malformed, self.frames), _share(self.freed, self.ticks)
        return dict(zip((fault.name for fault in SESSION_FAULTS), (self.early, self.faults, malformed, freed)))


@dataclass(frozen=True, kw_only=True)
class SessionFault(Figure):
    """A figure of what went wrong in a session, a count or in %; NaN where it is undefined.

    Attributes:
        limit: Largest value of a project that sets none.
    """

    limit: float


_IN_PERCENT: dict[str, Any] = {"digits": 3, "unit": "%"}
SESSION_FAULTS = (
    SessionFault(name="ended_early", label="ended early or was killed (1: yes)", limit=0.0),
    SessionFault(name="faults", label="faults, an early end included", limit=0.0),
    SessionFault(name="malformed_share", label="malformed packets, of all of the glove's", limit=0.1, **_IN_PERCENT),
    SessionFault(name="freed_share", label="ticks with fingers freed by a fault", limit=1.0, **_IN_PERCENT),
)
"""In the order of a table, and of `FaultCounts.figures`."""


def recorded_faults(session: Result) -> FaultCounts:
    """Count what went wrong in a recorded session; NaN for what its file lacks, or has damaged."""
    early = float(bool(broken_off(session)))

    def glove(name: str) -> float:
        return float(json.loads((session.live or {}).get("counters") or "{}").get(name, 0))

    return FaultCounts(
        early=early,
        faults=_known(lambda: max(early, float(np.sum(session["live/event/level"] == FAULT)))),
        malformed=_known(lambda: glove("malformed")),
        frames=_known(lambda: glove("frames")),
        freed=_known(lambda: float(np.sum(session["live/tick/safety"] & int(FREED_BY_FAULT) > 0))),
        ticks=float(session.ticks),
    )


def how_it_ended(result: Result) -> str:
    """Return why a session ended; "" of a replay."""
    if result.live is None:
        return ""
    ended = str(result.live.get("ended") or "")
    return "the recording was cut short" if not ended or (ended in IN_ORDER and not result.complete) else ended


def ended_before_its_time(result: Result) -> str:
    """Return how and when a session ended before the duration that was asked for; "" of any other run."""
    ended, asked = how_it_ended(result), result.scene.get("duration")
    if ended in ("", "duration") or not isinstance(asked, int | float):
        return ""
    periods = result.ticks + int(result.summary.get("missed", 0))
    return f"{_in_words(ended)} after {periods / result.rate:.1f} of {asked:g} s"


def broken_off(result: Result) -> str:
    """Return why a session ended that was not brought to its end in order; "" where it was, and of a replay."""
    ended = how_it_ended(result)
    # A file that does not tell the duration tells the signal of a loop whose command was killed.
    in_order = ended in SIGNALS and result.scene.get("duration", "unknown") is None
    if not ended or ended in IN_ORDER or in_order:
        return ""
    return ended_before_its_time(result) or _in_words(ended)


def first_mishap(session: Result) -> str:
    """Return how a session ended that did not end in order, else the first fault of its log, else ""."""
    if ended := broken_off(session):
        return ended
    faults = np.flatnonzero(session["live/event/level"] == FAULT)
    return bytes(session["live/event/text"][faults[0]]).decode("utf-8", "replace") if faults.size else ""


def _in_words(ended: str) -> str:
    return f"ended by {ended}" if ended in SIGNALS else ended


def _known(count: Callable[[], float]) -> float:
    try:
        return count()
    except (InputError, ValueError, TypeError, AttributeError):
        return np.nan


def _share(count: float, of: float) -> float:
    return 100.0 * count / of if of else np.nan
