"""A motion that is played beside the clock: what a simulated or replayed glove and the pose of its palm have in common.

One `Playback` is given to both of them, so that fingers and palm stay together whoever asks first.
"""

from dataclasses import dataclass, field

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.motion.trajectory import Trajectory

RETURN_TIME = 1.0
"""From the last sample of a repeated motion back to its first one [s]."""
SINGLE_RATE = 200.0
"""Of a motion of one sample, which has no rate of its own [Hz]."""


@dataclass(eq=False)
class Playback:
    """A trajectory and the instant at which it began.

    Attributes:
        rate: Samples a second instead of the stamps' own [Hz]; 0 for the stamps.
        repeat: Begin anew after the end, with `RETURN_TIME` for the way back; else the last sample stays.
        start_ns: CLOCK_MONOTONIC of the first sample [ns]; -1 until somebody asks, which starts the motion.
        stamps: Of the samples since the first one [s], shape (T,).
        period: Usual time from one sample to the next [s].

    Raises:
        InputError: A rate that is negative or not finite.
    """

    trajectory: Trajectory
    rate: float = 0.0
    repeat: bool = False
    start_ns: int = -1
    stamps: FloatArray = field(init=False)
    period: float = field(init=False)

    def __post_init__(self) -> None:
        """Put the samples on the clock."""
        if not (np.isfinite(self.rate) and self.rate >= 0.0):
            raise InputError(f"a motion played at {self.rate} Hz; expected a positive rate, or 0 for its own")
        own = self.trajectory
        if self.rate > 0.0:
            self.stamps, self.period = np.arange(own.sample_count) / self.rate, 1.0 / self.rate
        else:
            self.stamps = own.time - own.time[0]
            self.period = 1.0 / (own.mean_rate or SINGLE_RATE)

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.stamps[-1])

    def elapsed(self, now_ns: int) -> float:
        """Time since the motion began [s], never negative; the first call begins it."""
        if self.start_ns < 0:
            self.start_ns = now_ns
        return max(0.0, 1e-9 * (now_ns - self.start_ns))

    def place(self, elapsed: float) -> tuple[int, int, float]:
        """Where in the motion `elapsed` [s] is: two samples, and the share of the way from one to the other."""
        last = self.stamps.shape[0] - 1
        if self.repeat:
            elapsed %= self.duration + RETURN_TIME
        if elapsed >= self.duration:
            return (last, 0, (elapsed - self.duration) / RETURN_TIME) if self.repeat else (last, last, 0.0)
        newest = int(np.searchsorted(self.stamps, elapsed, side="right")) - 1
        step = self.stamps[newest + 1] - self.stamps[newest]
        return newest, newest + 1, float((elapsed - self.stamps[newest]) / step)
