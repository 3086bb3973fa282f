"""From when on the fingers must be free, and what the log says of it."""

from typing import Any

from hhsim.kernels.live.interlock import DRY_RUN, INTERLOCK
from hhsim.live.ipc.config import SafetyLimits
from hhsim.result.safety import WORDS, Safety
from hhsim.result.schema import FAULT, INFORMATION, WARNING
from hhsim.solver.workspace import zeroed
from hhsim.system.counted import counted

NEVER = 1 << 60
"""More periods than a session can miss."""


class Interlock:
    """The limits by which `hhsim.kernels.live.interlock.judge` frees the fingers.

    Args:
        limits: From when on the fingers are freed.
        dry_run: Nothing is sent, so that no watchdog is needed.
        period_ns: Of a tick [ns]; 1 kHz by default.

    Attributes:
        state: Of `INTERLOCK`, shape (1,).
        at: Its one record.
    """

    def __init__(self, limits: SafetyLimits, *, dry_run: bool = False, period_ns: int = 1_000_000) -> None:
        """Nothing has been missed."""
        self.state = zeroed(INTERLOCK)
        self.at: Any = self.state[0]
        self.at.stale_ns = round(1e9 * limits.stale)
        self.at.watchdog_ns = round(1e9 * limits.watchdog_stale)
        self.at.eased = limits.overruns if limits.after_stall == "ease" else NEVER
        self.at.released = limits.release_at(period_ns)
        self.at.watched = limits.watchdog and not dry_run
        self.at.always = DRY_RUN if dry_run else 0


LOGGED: dict[Safety, tuple[int, str]] = {
    Safety.STALE_INPUT: (WARNING, "samples come again"),
    Safety.NOT_FINITE: (WARNING, "samples can be used again"),
    Safety.SOLVER_FAILED: (FAULT, "the solver is back"),
    Safety.OVERRUN_STREAK: (WARNING, "the loop is in time again"),
    Safety.DEVICE_LOST: (FAULT, "the glove is back"),
    Safety.NO_WATCHDOG: (FAULT, "the watchdog is there"),
}
"""Level of the event, and what is said when its reason is over; `hhsim.result.safety.WORDS` say the reason."""

QUIET_NS = 1_000_000_000


class SafetyLog:
    """Turns changes of the safety bits into lines of the log; a bit that flickers is told once a second.

    Attributes:
        detail: What is known of the reason for a bit, for when it is told next.
    """

    def __init__(self) -> None:
        """No bit is set."""
        self.detail: dict[Safety, str] = {}
        self._last = 0
        self._last_logged: dict[Safety, int] = {}
        self._not_logged: dict[Safety, int] = {}
        self._open: set[Safety] = set()

    def changed(self, safety: int, now_ns: int) -> list[tuple[int, str]]:
        """Level and text of what is to be said of a tick.

        Args:
            safety: The tick's bits.
            now_ns: CLOCK_MONOTONIC [ns].
        """
        if safety == self._last:
            return []
        risen, fallen = safety & ~self._last, self._last & ~safety
        self._last = safety
        lines: list[tuple[int, str]] = []
        for bit, (level, right) in LOGGED.items():
            if risen & bit:
                if now_ns - self._last_logged.get(bit, now_ns - QUIET_NS) < QUIET_NS:
                    self._not_logged[bit] = self._not_logged.get(bit, 0) + 1
                    continue
                left_out = self._not_logged.pop(bit, 0)
                more = f" ({counted(left_out, 'time')} more since this was last said)" if left_out else ""
                detail = self.detail.get(bit)
                lines.append((level, f"{WORDS[bit]}: the fingers are free{more}{f': {detail}' if detail else ''}"))
                self._last_logged[bit] = now_ns
                self._open.add(bit)
            elif fallen & bit and bit in self._open:
                self._open.remove(bit)
                lines.append((INFORMATION, right))
        return lines
