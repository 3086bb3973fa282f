"""Rows of a recorded session: the sample that each tick used, and the span in which it ran.

The loop sleeps until a tick is due, reads, solves, sends commands and sleeps again, or begins the next tick at once. So
a tick's work lies between its wake-up and the next deadline, or the next begin, and a sample belongs to the tick in
whose span its bytes were read.
"""

from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, IntArray
from hhsim.result.reader import Result
from hhsim.result.safety import WORDS, Safety
from hhsim.verify.file_checks import follows

MOST_ANGLE = 2.0 * np.pi
"""Largest plausible joint angle [rad]: samples beyond are not used."""
MOST_READ = 64
"""Most samples taken by one tick."""
HANDED_OVER = 20_000_000
"""Longest time from the stamp of a sample's hand-over to the end of it [ns]: a driver may be stopped in between."""
QUIET = 1_000_000_000
"""Time in which the log does not repeat a line [ns]."""
LOOP_DIED = "the loop failed or was killed"
"""Reason of the end of a session whose loop was not brought to its end."""


class SessionRows:
    """Tables of a session; arrays have shape (T,) and are as /live/tick unless a comment says otherwise."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.live: dict[str, Any] = dict(result.live or {})  # description of the session
        self.limits: dict[str, Any] = result.told("limits")  # of output and safety
        self.dry_run = bool(self.live["dry_run"])  # True if nothing was sent
        self.period_ns = round(1e9 / float(result.scene["rate"]))  # of a tick
        # Most that a bend moves in it.
        self.bend_step = float(self.limits["output"]["bend_speed"]) * 1e-9 * self.period_ns
        self.numbers = np.arange(result.ticks)
        self.follows = follows(result)  # True if the row before is the tick before
        self.period, self.deadline, self.early, self.wakeup, self.latency, self.missed, self.safety = (
            np.asarray(result[f"live/tick/{name}"], np.int64)
            for name in ("period", "deadline", "early", "wakeup", "latency", "missed", "safety")
        )
        self.at_once = np.asarray(result["live/tick/at_once"], bool)
        self.bend = np.asarray(result["live/tick/command_bend"])  # command to each finger, (T, 5)
        self.stiffness = np.asarray(result["live/tick/command_stiffness"])  # (T, 5)
        slept_over = self.wakeup // self.period_ns * self.period_ns
        self.woke = self.deadline + self.wakeup - slept_over  # wake-up of the loop, or begin of the tick [ns]
        # The span of a tick that is not in the file, because the solver failed, is unknown.
        whole = np.zeros(result.ticks, bool)
        whole[1:] = np.diff(self.period) == 1 + self.missed[1:]
        whole &= self.follows
        self.closed = np.append(whole[1:], False)  # True where the end of the tick's span is known
        # That end: the next deadline slept for, or the begin of a tick at once [ns].
        self.over = np.append(np.where(self.at_once, self.woke, self.deadline - slept_over)[1:], 0)

    @cached_property
    def samples(self) -> dict[str, AnyArray]:
        """Columns of /live/sample, by name."""
        names = ("record", "seq", "time", "handed", "good", "flexion", "abduction")
        return {name: np.asarray(self.result[f"live/sample/{name}"]) for name in names}

    @property
    def samples_whole(self) -> bool:
        """True if every sample that came should be in the file."""
        return self.result.complete and int(self.live["lost_samples"]) == 0

    @cached_property
    def usable(self) -> BoolArray:
        """True for finite, plausible samples, shape (S,)."""
        angles = np.concatenate(
            [self.samples["flexion"].reshape(-1, 15), self.samples["abduction"].reshape(-1, 5)], axis=1
        )
        # NaN compares false.
        return np.asarray((self.samples["good"] == 1) & (np.abs(angles) <= MOST_ANGLE).all(axis=1))

    @cached_property
    def used(self) -> IntArray:
        """Row of the sample that each tick used, -1 where it is not in the file, shape (T,)."""
        seq, wanted = self.samples["seq"], np.asarray(self.result["input_seq"], np.int64)
        if len(seq) == 0:
            return np.full(len(wanted), -1)
        order = np.argsort(seq, kind="stable")
        place = np.clip(np.searchsorted(seq[order], wanted), 0, len(seq) - 1)
        row = order[place]
        return np.where(seq[row] == wanted, row, -1)

    @cached_property
    def newest(self) -> IntArray:
        """Row of the last sample that was certainly there when each tick began, -1 for none, shape (T,).

        The driver hands samples over one by one: at the stamp of one, the one before is there.
        """
        handed = self.samples["handed"]
        return np.maximum(np.searchsorted(handed, self.woke - HANDED_OVER) - 1, np.searchsorted(handed, self.woke) - 2)

    @cached_property
    def clear(self) -> BoolArray:
        """True for ticks whose samples are known: a burst of more than `MOST_READ` is taken by several ticks."""
        if not self.samples_whole:
            return np.zeros(self.result.ticks, bool)
        before = np.concatenate([[-1], self.used[:-1]])
        return np.asarray(self.closed & (self.used >= 0) & (self.newest - before < MOST_READ))

    def solver_failed(self, begin: IntArray, end: IntArray) -> BoolArray:
        """True where the log tells, or may have lost, a failed solver between stamps [ns] (N,) or shortly before."""
        if int(self.live["lost_events"]) > 0:
            return np.ones(len(begin), bool)
        stamps = np.asarray(self.result["live/event/time"], np.int64)
        failed = stamps[np.array([text.startswith(WORDS[Safety.SOLVER_FAILED]) for text in self.log], bool)]
        return np.asarray(((failed > begin[:, None] - QUIET) & (failed < end[:, None])).any(axis=1))

    @cached_property
    def log(self) -> list[str]:
        """Lines of the session's log."""
        return [bytes(text).rstrip(b"\0").decode("utf-8", "replace") for text in self.result["live/event/text"]]
