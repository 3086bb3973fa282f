"""The rows of a recorded session as the referee reads them: which sample a tick had, and from when to when it ran.

A loop of one thread sleeps until a tick is due, reads, solves, tells the fingers, and sleeps again until the next one
is, or begins that at once. So all that a tick did lies between its waking and when the next one was due, or its
beginning, and a sample belongs to the tick in whose span its bytes were read.
"""

import json
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, IntArray
from hhsim.result.reader import Result
from hhsim.verify.file_checks import follows

MOST_ANGLE = 2.0 * np.pi
"""No joint of a hand is beyond this [rad]: a sample that says so is not used."""
MOST_READ = 64
"""Samples that a tick takes at most; what is left waits for the next one."""
HANDED_OVER = 20_000_000
"""A driver that takes longer from the bytes of a sample to its record [ns] counts as gone: for the last sample, and for
files whose driver did not say when it handed one over."""

SOLVER_FAILED = "the solver failed"
"""How a line of the log begins that tells of a tick without a hand."""
QUIET = 1_000_000_000
"""For so long [ns] the log does not tell the same again."""
LOOP_DIED = "the loop failed or was killed"
"""Why a session ended that was not brought to its end."""
OLD_NAME = ("guardian", "watchdog")
"""What the first sessions call the watchdog, and what all later ones do: as for `str.replace`."""


class SessionRows:
    """The tables of a session.

    Args:
        result: Of a session.

    Attributes:
        live: What the session says of itself.
        limits: Of the output and of safety.
        dry_run: Whether nothing was sent.
        period_ns: Of a tick [ns].
        numbers: Of the rows, shape (T,).
        follows: Whether the row before is the tick before, shape (T,).
        period, deadline, wakeup, latency, missed, safety: As /live/tick, shape (T,).
        early: As /live/tick, 0 in files that do not say so, shape (T,).
        bend, stiffness: What each finger was told, shape (T, 5).
        at_once: Whether a tick began without a sleep; no tick of the files that do not say so did, shape (T,).
        woke: When the loop woke, or began the tick [ns], shape (T,).
        closed: Whether it is known when the tick was over, shape (T,).
        over: Where it is: when the next tick that slept was due, or when it began at once [ns], shape (T,).
    """

    def __init__(self, result: Result) -> None:
        """Read the ticks."""
        self.result = result
        self.live: dict[str, Any] = dict(result.live or {})
        self.limits: dict[str, Any] = json.loads(str(self.live["limits"]).replace(*OLD_NAME))
        self.dry_run = bool(self.live["dry_run"])
        self.period_ns = round(1e9 / float(result.scene["rate"]))
        self.numbers = np.arange(result.ticks)
        self.follows = follows(result)
        self.period, self.deadline, self.wakeup, self.latency, self.missed, self.safety = (
            np.asarray(result[f"live/tick/{name}"], np.int64)
            for name in ("period", "deadline", "wakeup", "latency", "missed", "safety")
        )
        self.bend = np.asarray(result["live/tick/command_bend"])
        self.stiffness = np.asarray(result["live/tick/command_stiffness"])
        slept_over = self.wakeup // self.period_ns * self.period_ns
        self.woke = self.deadline + self.wakeup - slept_over
        # A period whose tick is not in the file, since the solver failed, has a span that nobody knows.
        whole = np.zeros(result.ticks, bool)
        whole[1:] = np.diff(self.period) == 1 + self.missed[1:]
        whole &= self.follows
        self.closed = np.append(whole[1:], False)
        self.at_once = self._told("at_once").astype(bool)
        self.early = self._told("early")
        self.over = np.append(np.where(self.at_once, self.woke, self.deadline - slept_over)[1:], 0)

    def tells(self, name: str) -> bool:
        """Whether the file has this column of /live/tick, which older ones lack."""
        return f"live/tick/{name}" in self.result

    def _told(self, name: str) -> IntArray:
        told = self.result[f"live/tick/{name}"] if self.tells(name) else np.zeros(self.result.ticks)
        return np.asarray(told, np.int64)

    @cached_property
    def samples(self) -> dict[str, AnyArray]:
        """The columns of /live/sample that claims are about, by name."""
        names = ("record", "seq", "time", "good", "flexion", "abduction")
        return {name: np.asarray(self.result[f"live/sample/{name}"]) for name in names}

    @property
    def samples_whole(self) -> bool:
        """Whether every sample that came should be in the file."""
        return self.result.complete and int(self.live["lost_samples"]) == 0

    @cached_property
    def usable(self) -> BoolArray:
        """Samples that are finite and of a hand, shape (S,)."""
        angles = np.concatenate(
            [self.samples["flexion"].reshape(-1, 15), self.samples["abduction"].reshape(-1, 5)], axis=1
        )
        # NaN compares false.
        return np.asarray((self.samples["good"] == 1) & (np.abs(angles) <= MOST_ANGLE).all(axis=1))

    @cached_property
    def used(self) -> IntArray:
        """Row of the sample that each tick says it used, -1 where it is not in the file, shape (T,)."""
        seq, wanted = self.samples["seq"], np.asarray(self.result["input_seq"], np.int64)
        if len(seq) == 0:
            return np.full(len(wanted), -1)
        order = np.argsort(seq, kind="stable")
        place = np.clip(np.searchsorted(seq[order], wanted), 0, len(seq) - 1)
        row = order[place]
        return np.where(seq[row] == wanted, row, -1)

    @cached_property
    def newest(self) -> IntArray:
        """Row of the last sample that must have been there when each tick began, -1 for none, shape (T,).

        A driver does one thing after the other: when it says that it hands a sample over, the one before is there.
        """
        there = np.searchsorted(self.samples["time"], self.woke - HANDED_OVER) - 1
        if self.handed is None:
            return there
        return np.maximum(there, np.searchsorted(self.handed, self.woke) - 2)

    @cached_property
    def handed(self) -> IntArray | None:
        """When the driver was about to hand each sample over [ns], shape (S,); None where the file does not say."""
        name = "live/sample/handed"
        return np.asarray(self.result[name], np.int64) if name in self.result else None

    @cached_property
    def clear(self) -> BoolArray:
        """Ticks of which it is known what they took: a burst of more than `MOST_READ` samples is taken in several."""
        if not self.samples_whole:
            return np.zeros(self.result.ticks, bool)
        before = np.concatenate([[-1], self.used[:-1]])
        return np.asarray(self.closed & (self.used >= 0) & (self.newest - before < MOST_READ))

    def solver_failed(self, begin: IntArray, end: IntArray) -> BoolArray:
        """Whether the log tells of a failed solver between stamps [ns] (N,), or so shortly before that it says no more.

        Such a tick is not in the file. Where lines of the log were lost, one may have told of it.
        """
        if int(self.live["lost_events"]) > 0:
            return np.ones(len(begin), bool)
        stamps = np.asarray(self.result["live/event/time"], np.int64)
        failed = stamps[np.array([text.startswith(SOLVER_FAILED) for text in self.log], bool)]
        return np.asarray(((failed > begin[:, None] - QUIET) & (failed < end[:, None])).any(axis=1))

    @cached_property
    def log(self) -> list[str]:
        """Lines of the session's log."""
        return [bytes(text).rstrip(b"\0").decode("utf-8", "replace") for text in self.result["live/event/text"]]
