"""Log of a live session: the loop's notes and its safety bits as lines for people."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.live import plausibility as codes
from hhsim.kernels.live.plausibility import CAPACITY, MOST_ANGLE, TRUST
from hhsim.live.device import GloveInfo
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.settings import LiveSetup
from hhsim.result.miss_cause import WORDS as MISS_WORDS
from hhsim.result.miss_cause import MissCause
from hhsim.result.safety import WORDS, Safety
from hhsim.result.schema import FAULT, INFORMATION, WARNING
from hhsim.system.counted import counted

Line = tuple[int, str]
"""Level and text."""

BEGINS_INSIDE = (
    "the hand begins inside the object: the shown hand begins at the nearest free place, and may be caught there; "
    "begin anew with the hand open, or elsewhere"
)
LOGGED: dict[Safety, Line] = {
    Safety.STALE_INPUT: (WARNING, "samples come again"),
    Safety.NOT_FINITE: (WARNING, "samples can be used again"),
    Safety.SOLVER_FAILED: (FAULT, "the solver is back"),
    Safety.OVERRUN_STREAK: (WARNING, "the loop is in time again"),
    Safety.DEVICE_LOST: (FAULT, "the glove is back"),
    Safety.NO_WATCHDOG: (FAULT, "the watchdog is there"),
    Safety.OTHER_HAND: (WARNING, "the other hand is well again"),
}
"""Level of each reason's line, and the text when the reason is over; `hhsim.result.safety.WORDS` name the reason."""
QUIET_NS = 1_000_000_000
"""Shortest time between two lines of the same reason [ns]."""
MOST_READING = 1.5
"""Largest plausible value of a channel that is 0 to 1."""
NAMES = ("thumb", "index finger", "middle finger", "ring finger", "little finger")
LOST = 1
"""Samples in a row that a link may lose unnoticed; the next one is then that many intervals late, and one more."""

_NUMBERS = ("time_ns", "code", "place", "count")
_IN_SAMPLE = (codes.JUMPED, codes.JUMPED_BACK, codes.JUMP_FOLLOWED, codes.MOVES_AGAIN, codes.STUCK)


class SafetyLog:
    """Log lines for changes of the safety bits, with `detail`; a bit that flickers has one line in `QUIET_NS`."""

    def __init__(self) -> None:
        self.detail: dict[Safety, str] = {}
        self._last = 0
        self._last_logged: dict[Safety, int] = {}
        self._open: set[Safety] = set()

    def changed(self, safety: int, now_ns: int) -> list[Line]:
        """Return the lines for a tick with the bits `safety` at CLOCK_MONOTONIC [ns]."""
        risen, fallen = safety & ~self._last, self._last & ~safety
        self._last = safety
        lines: list[Line] = []
        for bit, (level, over) in LOGGED.items():
            if risen & bit:
                if now_ns - self._last_logged.get(bit, now_ns - QUIET_NS) < QUIET_NS:
                    continue
                detail = self.detail.get(bit)
                lines.append((level, f"{WORDS[bit]}: the fingers are free{f': {detail}' if detail else ''}"))
                self._last_logged[bit] = now_ns
                self._open.add(bit)
            elif fallen & bit and bit in self._open:
                self._open.remove(bit)
                lines.append((INFORMATION, over))
        return lines


class Story:
    """Writes a session's log from records of `LiveArrays`; `tell` is for one thread, `detail` as of `SafetyLog`.

    Each line begins with `whose`.
    """

    def __init__(
        self,
        setup: LiveSetup,
        memory: SessionMemory,
        info: GloveInfo,
        notes: Any,
        refused: Any,
        loop: Any,
        whose: str = "",
    ) -> None:
        self._stale, self._memory, self._info, self._whose = setup.safety.stale, memory, info, whose
        self._notes, self._refused, self._loop = notes[0], refused[0], loop[0]
        self._next = 0
        self._begun = False
        self._log = SafetyLog()
        self.detail = self._log.detail

    def tell(self) -> None:
        """Log what is new."""
        if not self._begun:
            self._begun = True
            for text in doubts(self._info):
                self._log_line(WARNING, text)
        written = int(self._notes.written[0])
        if self._memory.why_lost:
            self.detail[Safety.DEVICE_LOST], self._memory.why_lost = self._memory.why_lost, ""
        if written - self._next > CAPACITY:
            lost = written - CAPACITY - self._next
            self._log_line(WARNING, f"{counted(lost, 'thing')} to tell lost: they came too fast")
            self._next += lost
        while self._next < written:
            i = self._next % CAPACITY
            self._next += 1
            time_ns, code, place, count = (int(getattr(self._notes, name)[i]) for name in _NUMBERS)
            for level, text in self._lines(time_ns, code, place, count, float(self._notes.value[i])):
                self._log_line(level, text, time_ns)

    def _log_line(self, level: int, text: str, time_ns: int | None = None) -> None:
        self._memory.log(level, f"{self._whose}{text}", time_ns)

    def _lines(self, time_ns: int, code: int, place: int, count: int, value: float) -> list[Line]:
        """Return the lines of a note; notes that only explain a later one change `detail`."""
        detail = self.detail
        if code in _IN_SAMPLE:
            return [found_in_sample(code, place, count, value)]
        if code == codes.BEGAN_INSIDE:
            return [(WARNING, BEGINS_INSIDE)]
        if code == codes.SAFETY_CHANGED:
            if count & Safety.STALE_INPUT:
                hint = interval_hint(float(self._loop.usual_ns), self._stale)
                detail[Safety.STALE_INPUT] = f"for more than {1e3 * self._stale:g} ms, as --stale says{hint}"
            return self._log.changed(count, time_ns)
        if code == codes.MISSED:
            detail[Safety.OVERRUN_STREAK] = f"{count:,} the last time, {MISS_WORDS[MissCause(place)]}"
        elif code == codes.LONG_TICK:
            detail[Safety.OVERRUN_STREAK] = "during a tick; the recording tells the cause"
        elif code == codes.REFUSED:
            known = np.array(self._refused.known) == 1
            detail[Safety.NOT_FINITE] = implausible_reading(self._refused, self._info, known)
        elif code == codes.FULL:
            detail[Safety.SOLVER_FAILED] = "more contacts than the solver holds"
        elif code == codes.DRIVER_SILENT:
            detail[Safety.DEVICE_LOST] = f"its driver has given no sign of life for {1e-6 * count:.0f} ms"
        return []


def doubts(info: GloveInfo) -> list[str]:
    """Return a warning for each doubtful channel and finger of a glove."""
    useless = (f"{NAMES[finger]}: its bend says too little to push on; it is kept free" for finger in info.kept_free)
    return [*info.doubtful, *useless]


def found_in_sample(code: int, place: int, count: int, value: float) -> Line:
    """Return the line for a note of `hhsim.kernels.live.plausibility.use_sample`."""
    finger = NAMES[place]
    if code == codes.JUMPED:
        jumped = f"{finger} jumped by {math.degrees(value):.0f}° in one sample"
        return WARNING, f"{jumped}: not believed until it stays, and kept free"
    if code == codes.STUCK:
        others = f"{NAMES[count // 8]} and {NAMES[count % 8]}"
        still = f"{finger} has not changed by one bit in {value:.1f} s in which {others} moved"
        return WARNING, f"{still}: is its sensor stuck? It is kept free"
    texts = {
        codes.JUMPED_BACK: "came back from its jump",
        codes.JUMP_FOLLOWED: "stays where it jumped to, and is followed",
        codes.MOVES_AGAIN: "moves again",
    }
    return INFORMATION, f"{finger} {texts[code]}: kept free until it was plausible for {TRUST:g} s"


def implausible_reading(sample: Any, info: GloveInfo, known: NDArray[np.bool_]) -> str:
    """Describe the channel of a sample that is no number, or the one farthest beyond any hand; "" if there is none.

    `known` are the channels that the last usable sample had, shape (n,): a glove may never send some of them.
    """
    values = np.abs(sample["channels"][: len(info.channels)])
    most = {"": MOST_READING, "rad": MOST_ANGLE}.get(info.unit, np.inf)
    unit = f" {info.unit}" if info.unit else ""
    bad = np.flatnonzero(~np.isfinite(values[: known.size]) & known[: values.size])
    if bad.size:
        return f"{info.channels[bad[0]]} is {sample['channels'][bad[0]]}"
    # NaN, which stands for a missing channel too, compares false.
    if not (values > most).any():
        return ""
    channel = int(np.nanargmax(values))
    hint = ": are the angles in degrees?" if info.unit == "rad" and values[channel] <= 360.0 else ""
    if not info.unit:
        hint = ": raw counts need --calibration with the readings of the open and of the closed hand"
    reading = f"{info.channels[channel]} is {sample['channels'][channel]:.4g}{unit}"
    return f"{reading}, and {most:.3g}{unit} the most of a hand{hint}"


def interval_hint(usual_ns: float, stale: float) -> str:
    """Suggest a limit of age for a glove's own rate; "" if one lost sample is not too old for the limit `stale` [s].

    `usual_ns` is the running median of the sample intervals [ns], 0 if unknown.
    """
    if stale >= (LOST + 1) * 1e-9 * usual_ns:
        return ""
    needed = (LOST + 1.5) * 1e-9 * usual_ns
    return (
        f"; samples come {1e9 / usual_ns:.0f} times a second, so that one that is lost frees the fingers: "
        f"--stale {1e3 * needed:.0f} would let it pass"
    )
