"""Why the fingers must be free in a tick, judged anew in every tick."""

from hhsim.live.ipc.config import SafetyLimits
from hhsim.live.ipc.session_memory import FAULT, INFORMATION, WARNING
from hhsim.result.safety import Safety

# Numbers: operations on flags take a microsecond each.
_STALE_INPUT = int(Safety.STALE_INPUT)
_NOT_FINITE = int(Safety.NOT_FINITE)
_OVERRUN_STREAK = int(Safety.OVERRUN_STREAK)
_DEVICE_LOST = int(Safety.DEVICE_LOST)
_STOPPING = int(Safety.STOPPING)
_NO_WATCHDOG = int(Safety.NO_WATCHDOG)
_DRY_RUN = int(Safety.DRY_RUN)
_NO_INPUT_YET = int(Safety.NO_INPUT_YET)


class Interlock:
    """Judges what is known of a tick before it is solved.

    A bit stands as long as its reason does; the output's ramp then keeps the fingers from being seized at once.

    Args:
        limits: From when on the fingers are freed.
        dry_run: Nothing is sent, so that no watchdog is needed.
        period_ns: Of a tick [ns]; 1 kHz by default.

    Attributes:
        streak: Periods missed since the last tick that came in time.
        eases: Whether these are a stall after which the stiffness is to fall, but not at once.
    """

    def __init__(self, limits: SafetyLimits, *, dry_run: bool = False, period_ns: int = 1_000_000) -> None:
        """Nothing has been missed."""
        self._stale_ns = round(1e9 * limits.stale)
        self._watchdog_ns = round(1e9 * limits.watchdog_stale)
        self._eased = limits.overruns if limits.after_stall == "ease" else None
        self._released = limits.release_at(period_ns)
        self._watchdog = limits.watchdog and not dry_run
        self._always = _DRY_RUN if dry_run else 0
        self.streak = 0
        self.eases = False

    def judge(
        self,
        now_ns: int,
        *,
        sample_ns: int,
        pose_ns: int,
        usable: bool,
        missed: int,
        watchdog_ns: int,
        armed: bool,
        lost: bool,
        stopping: bool,
    ) -> int:
        """Bits of `Safety` for a tick.

        Args:
            now_ns: CLOCK_MONOTONIC [ns].
            sample_ns: Of the sample in use, -1 before the first.
            pose_ns: Of the pose in use, -1 before the first.
            usable: Whether the newest sample that came can be used.
            missed: Periods missed right before this tick.
            watchdog_ns: The watchdog's last sign of life, 0 before the first.
            armed: Whether the watchdog can reach the glove.
            lost: Whether the glove is gone.
            stopping: Whether this is one of the last ticks.
        """
        bits = self._always
        if sample_ns < 0 or pose_ns < 0:
            bits |= _NO_INPUT_YET
        elif now_ns - min(sample_ns, pose_ns) > self._stale_ns:
            bits |= _STALE_INPUT
        if not usable:
            bits |= _NOT_FINITE
        self.streak = self.streak + missed if missed else 0
        if self.streak >= self._released:
            bits |= _OVERRUN_STREAK
        self.eases = self._eased is not None and self.streak >= self._eased
        if lost:
            bits |= _DEVICE_LOST
        if stopping:
            bits |= _STOPPING
        if self._watchdog and not (armed and now_ns - watchdog_ns <= self._watchdog_ns):
            bits |= _NO_WATCHDOG
        return bits


WORDS: dict[Safety, tuple[int, str, str]] = {
    Safety.STALE_INPUT: (WARNING, "nothing new from the glove or of the palm", "samples come again"),
    Safety.NOT_FINITE: (WARNING, "a sample that is not finite, or of no hand", "samples can be used again"),
    Safety.SOLVER_FAILED: (FAULT, "the solver failed", "the solver is back"),
    Safety.OVERRUN_STREAK: (WARNING, "one period after the other was missed", "the loop is in time again"),
    Safety.DEVICE_LOST: (FAULT, "the glove is gone", "the glove is back"),
    Safety.NO_WATCHDOG: (FAULT, "the watchdog does not answer, or cannot reach the glove", "the watchdog is there"),
}
"""Level of the event, what is wrong, and what is said when it no longer is."""

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
        for bit, (level, wrong, right) in WORDS.items():
            if risen & bit:
                if now_ns - self._last_logged.get(bit, now_ns - QUIET_NS) < QUIET_NS:
                    self._not_logged[bit] = self._not_logged.get(bit, 0) + 1
                    continue
                left_out = self._not_logged.pop(bit, 0)
                more = f" ({left_out:,} times more since this was last said)" if left_out else ""
                detail = self.detail.get(bit)
                lines.append((level, f"{wrong}: the fingers are free{more}{f': {detail}' if detail else ''}"))
                self._last_logged[bit] = now_ns
                self._open.add(bit)
            elif fallen & bit and bit in self._open:
                self._open.remove(bit)
                lines.append((INFORMATION, right))
        return lines
