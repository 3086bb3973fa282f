"""Playback of a motion on the clock, again and again, shared by a simulated or replayed glove and its palm's pose."""

from dataclasses import dataclass, field

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.motion.trajectory import Trajectory

RETURN_TIME = 1.0
"""Time from the last sample of the motion back to its first one [s]."""
SINGLE_RATE = 200.0
"""Sample rate of a motion of one sample [Hz]."""


@dataclass(eq=False)
class Playback:
    """A trajectory on the clock, again and again; one object keeps the fingers and the palm of a motion together.

    It begins anew `RETURN_TIME` after its end.
    """

    trajectory: Trajectory
    start_ns: int = -1  # CLOCK_MONOTONIC of the first sample [ns]; -1 until the first call of `elapsed`
    stamps: FloatArray = field(init=False)  # times of the samples since the first one [s], shape (T,)
    period: float = field(init=False)  # usual time from one sample to the next [s]

    def __post_init__(self) -> None:
        own = self.trajectory
        self.stamps = own.time - own.time[0]
        self.period = 1.0 / (own.mean_rate or SINGLE_RATE)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.stamps[-1])

    def elapsed(self, now_ns: int) -> float:
        """Return the time since the motion began [s], never negative; the first call begins it."""
        if self.start_ns < 0:
            self.start_ns = now_ns
        return max(0.0, 1e-9 * (now_ns - self.start_ns))

    def place(self, elapsed: float) -> tuple[int, int, float]:
        """Return the samples before and after `elapsed` [s], and the fraction of the way from one to the other."""
        elapsed %= self.duration + RETURN_TIME
        if elapsed >= self.duration:
            return self.stamps.shape[0] - 1, 0, (elapsed - self.duration) / RETURN_TIME
        newest = int(np.searchsorted(self.stamps, elapsed, side="right")) - 1
        step = self.stamps[newest + 1] - self.stamps[newest]
        return newest, newest + 1, float((elapsed - self.stamps[newest]) / step)

    def fingers(self, before: int, after: int, share: float) -> tuple[FloatArray, FloatArray]:
        """Return flexion (5, 3) and abduction (5,) [rad] between two samples; those of the first where `share` is 0."""
        own = self.trajectory
        if share == 0.0:
            return own.flexion[before], own.abduction[before]
        flexion = (1.0 - share) * own.flexion[before] + share * own.flexion[after]
        return flexion, (1.0 - share) * own.abduction[before] + share * own.abduction[after]
