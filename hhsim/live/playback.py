"""Playback of a motion on the clock, again and again, shared by a simulated or replayed glove and its palm's pose."""

import math

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.motion.trajectory import Trajectory

RETURN_TIME = 1.0
"""Time from the last sample of the motion back to its first one [s]."""
SINGLE_RATE = 200.0
"""Sample rate of a motion of one sample [Hz]."""
ANGLES, POSITION, ORIENTATION = slice(20), slice(20, 23), slice(23, 27)
"""Columns of a row: flexion, finger by finger, and abduction [rad]; palm origin [m]; its quaternion (w, x, y, z)."""


class Playback:
    """A trajectory on the clock, again and again; one object keeps the fingers and the palm of a motion together.

    Attributes:
        trajectory: The motion.
        duration: Time from its first to its last sample [s].
        cycle: Time after which it begins anew: `duration` and `RETURN_TIME` [s].
        stamps: Times of the rows since the first one [s], shape (n,); the last one is `cycle`.
        rows: Samples of the motion, then those of the way back at the usual rate, and the first sample, shape (n, 27).
    """

    def __init__(self, trajectory: Trajectory) -> None:
        own = self.trajectory = trajectory
        self.duration = own.duration
        self.cycle = self.duration + RETURN_TIME
        samples = np.hstack([own.flexion.reshape(-1, 15), own.abduction, own.position, own.orientation])
        first, last = samples[0].copy(), samples[-1]
        if first[ORIENTATION] @ last[ORIENTATION] < 0.0:
            first[ORIENTATION] *= -1.0
        period = 1.0 / (own.mean_rate or SINGLE_RATE)
        back = period * np.arange(1, math.ceil(RETURN_TIME / period))
        self.stamps = np.concatenate([own.time - own.time[0], self.duration + back, [self.cycle]])
        share = back[:, None] / RETURN_TIME
        self.rows = np.concatenate([samples, (1.0 - share) * last + share * first, [first]])
        self._start_ns = -1

    def elapsed(self, now_ns: int) -> float:
        """Return the time since the motion began [s], never negative; the first call begins it."""
        if self._start_ns < 0:
            self._start_ns = now_ns
        return max(0.0, 1e-9 * (now_ns - self._start_ns))

    def at(self, elapsed: float) -> FloatArray:
        """Return the row at a time [s], linear between two."""
        elapsed %= self.cycle
        after = int(np.searchsorted(self.stamps, elapsed, side="right"))
        share = (elapsed - self.stamps[after - 1]) / (self.stamps[after] - self.stamps[after - 1])
        return np.asarray((1.0 - share) * self.rows[after - 1] + share * self.rows[after])
