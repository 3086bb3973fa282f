"""What went wrong in a live session, by its file: an early end, faults, malformed packets, freed fingers."""

import json
import signal
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hhsim.errors import InputError
from hhsim.metrics.run_metric import Figure
from hhsim.result.reader import Result
from hhsim.result.safety import Safety

IN_ORDER = frozenset(("duration", "stopped", *(number.name for number in signal.Signals)))
"""Why a session ended whose loop came to its end."""
FAULT = 2
"""Level of an event that is a fault, as /live/event has it."""
FREED_BY_FAULT = (
    Safety.STALE_INPUT
    | Safety.NOT_FINITE
    | Safety.SOLVER_FAILED
    | Safety.OVERRUN_STREAK
    | Safety.DEVICE_LOST
    | Safety.NO_WATCHDOG
)
"""Why the fingers are free where nobody asked for it."""


@dataclass(frozen=True, kw_only=True)
class SessionFault(Figure):
    """A figure of what went wrong in a session, in SI units or in %; NaN where it is undefined.

    Attributes:
        limit: Largest value of a project that sets none.
        compute: From the session's file.
    """

    limit: float
    compute: Callable[[Result], float]

    def value(self, session: Result) -> float:
        """Return the figure of a session; NaN where its file lacks what it is computed from, or has it damaged."""
        try:
            return self.compute(session)
        except (InputError, ValueError, TypeError, AttributeError):
            return np.nan


def _ended_early(session: Result) -> float:
    return float(not session.complete or str((session.live or {}).get("ended")) not in IN_ORDER)


def _faults(session: Result) -> float:
    return float(np.count_nonzero(session["live/event/level"] == FAULT))


def _malformed(session: Result) -> float:
    counters = json.loads((session.live or {}).get("counters") or "{}")
    frames = float(counters.get("frames", 0))
    return 100.0 * float(counters.get("malformed", 0)) / frames if frames else np.nan


def _freed(session: Result) -> float:
    safety = session["live/tick/safety"]
    return 100.0 * float(np.count_nonzero(safety & int(FREED_BY_FAULT))) / len(safety) if len(safety) else np.nan


def first_mishap(session: Result) -> str:
    """Return how a session ended that did not end in order, else the first fault of its log, else ""."""
    if _ended_early(session):
        return str((session.live or {}).get("ended") or "the recording was cut short")
    faults = np.flatnonzero(session["live/event/level"] == FAULT)
    return bytes(session["live/event/text"][faults[0]]).decode("utf-8", "replace") if faults.size else ""


SESSION_FAULTS = (
    SessionFault(name="ended_early", label="ended early or was killed (1: yes)", limit=0.0, compute=_ended_early),
    SessionFault(name="faults", label="faults in the session's log", limit=0.0, compute=_faults),
    SessionFault(
        name="malformed_share",
        label="malformed packets, of all of the glove's",
        digits=3,
        unit="%",
        limit=0.1,
        compute=_malformed,
    ),
    SessionFault(
        name="freed_share",
        label="ticks with fingers freed by a fault",
        digits=3,
        unit="%",
        limit=1.0,
        compute=_freed,
    ),
)
"""In the order of a table."""
