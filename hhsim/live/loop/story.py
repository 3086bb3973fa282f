"""What a loop tells: the notes of its compiled code and the words of the driver as lines of the session's log."""

from typing import Any

import numpy as np

from hhsim.kernels.live import notes as codes
from hhsim.kernels.live.notes import CAPACITY
from hhsim.live.device import GloveInfo
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import REASON, WORD_CAPACITY, SessionMemory
from hhsim.live.loop.interlock import SafetyLog
from hhsim.live.loop.plausibility import doubts, found_in_sample, reading_of_no_hand
from hhsim.live.loop.sample_interval import interval_hint
from hhsim.live.shared_memory import RingReader
from hhsim.result.miss_cause import WORDS, MissCause
from hhsim.result.safety import Safety
from hhsim.result.schema import WARNING
from hhsim.system.counted import counted

BEGINS_INSIDE = (
    "the hand begins inside the object: the shown hand begins at the nearest free place, and may be caught there; "
    "begin anew with the hand open, or elsewhere"
)
_NUMBERS = ("time_ns", "code", "place", "count")
_FOUND = (codes.JUMPED, codes.JUMPED_BACK, codes.JUMP_FOLLOWED, codes.MOVES_AGAIN, codes.STUCK)


class Story:
    """Writes the log of a session; one thread tells it.

    Args:
        setup: Of the session.
        memory: Of the session.
        info: Of the glove.
        notes: Of `NOTES`, shape (1,), which the loop writes.
        refused: Of the loop's `REFUSED`, shape (1,).
        loop: Of `hhsim.kernels.live.tick.LOOP`, shape (1,).

    Attributes:
        detail: What is known of the reason for a safety bit, for when it is told next.
    """

    def __init__(
        self, setup: LiveSetup, memory: SessionMemory, info: GloveInfo, notes: Any, refused: Any, loop: Any
    ) -> None:
        """Nothing is told yet."""
        self._setup, self._memory, self._info = setup, memory, info
        self._notes, self._refused, self._loop = notes[0], refused[0], loop[0]
        self._words = RingReader(memory.words)
        self._next = 0
        self._begun = False
        self._log = SafetyLog()
        self.detail = self._log.detail

    def tell(self) -> None:
        """Write what is new into the log."""
        if not self._begun:
            self._begun = True
            for text in doubts(self._info):
                self._memory.log(WARNING, text)
        # The loop's notes as far as they are now: the reasons that the driver gave for them are known by then.
        written = int(self._notes.written[0])
        self._read_words()
        if written - self._next > CAPACITY:
            lost = written - CAPACITY - self._next
            self._memory.log(WARNING, f"{counted(lost, 'thing')} to tell lost: they came too fast")
            self._next += lost
        while self._next < written:
            i = self._next % CAPACITY
            self._next += 1
            time_ns, code, place, count = (int(getattr(self._notes, name)[i]) for name in _NUMBERS)
            self._tell(time_ns, code, place, count, float(self._notes.value[i]))

    def _read_words(self) -> None:
        _, words = self._words.read(WORD_CAPACITY)
        for word in words:
            level, text = int(word["level"]), bytes(word["text"]).decode("utf-8", "replace")
            if level == REASON:
                self.detail[Safety.DEVICE_LOST] = text
            else:
                self._memory.log(level, text, int(word["time_ns"]))

    def _tell(self, time_ns: int, code: int, place: int, count: int, value: float) -> None:
        detail = self.detail
        if code in _FOUND:
            level, text = found_in_sample(code, place, count, value)
            self._memory.log(level, text, time_ns)
        elif code == codes.SAFETY_CHANGED:
            if count & Safety.STALE_INPUT:
                stale = self._setup.safety.stale
                hint = interval_hint(float(self._loop.usual_ns), stale)
                detail[Safety.STALE_INPUT] = f"for more than {1e3 * stale:g} ms, as --stale says{hint}"
            for level, text in self._log.changed(count, time_ns):
                self._memory.log(level, text, time_ns)
        elif code == codes.MISSED:
            detail[Safety.OVERRUN_STREAK] = f"{count:,} the last time, {WORDS[MissCause(place)]}"
        elif code == codes.LONG_TICK:
            detail[Safety.OVERRUN_STREAK] = "during a tick; the recording tells the cause"
        elif code == codes.REFUSED:
            known = np.array(self._refused.known) == 1
            detail[Safety.NOT_FINITE] = reading_of_no_hand(self._refused, self._info, known)
        elif code == codes.BEGAN_INSIDE:
            self._memory.log(WARNING, BEGINS_INSIDE, time_ns)
        elif code == codes.FULL:
            detail[Safety.SOLVER_FAILED] = "more contacts than the solver holds"
        elif code == codes.DRIVER_SILENT:
            detail[Safety.DEVICE_LOST] = f"its driver has given no sign of life for {1e-6 * count:.0f} ms"
