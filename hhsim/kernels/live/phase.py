"""Phase of the glove's samples in the loop's period: deadlines move so that each sample finds a waiting loop.

A tick is due with its sample only in the last part of a period (`hhsim.kernels.live.deadlines`). A glove whose interval
is a whole number of periods has a constant phase; mean direction and spread are those of directional statistics (Mardia
and Jupp, Directional Statistics, 2000, section 2.3). For other gloves deadlines do not move.
"""

import math

import numpy as np

from hhsim.kernels.elementary import arc_tangent, hypotenuse, sine_cosine
from hhsim.kernels.jit import Record, as_int64, jit
from hhsim.kernels.live.deadlines import EARLIEST

PHASE = np.dtype([("cosine", np.float64), ("sine", np.float64), ("samples", np.int64)], align=True)
"""Running means of the phase's cosine and sine, and the number of samples."""

WEIGHT = 1.0 / 128.0
"""Least weight of the newest sample: a mean of about half a second at 200 Hz."""
LEAST_SAMPLES = 48
"""Samples of another rate may seem to have a phase before there are so many."""
LEAST_RESULTANT = 0.7
"""Mean resultant length below which samples have no phase: a deviation of 0.13 periods."""
AFTER_MEAN = 0.5 * EARLIEST
"""Wanted time of a deadline after the mean phase, and largest jitter to either side [periods]."""
LEAST_INTERVAL = 0.75
"""Interval of samples below which they are never old [periods]."""
LARGEST_SHIFT = 1.0 / 5000.0
"""Largest shift of a deadline, and difference of a glove's clock from ours that can be followed [periods]."""


@jit
def count_phase(phase: Record, handed: int, period: int) -> None:
    """Add a sample that was handed over at `handed` [ns] to the phase in a loop's `period` [ns]."""
    angle = 2.0 * math.pi * float(handed % period) / float(period)
    sine, cosine = sine_cosine(angle)
    phase.samples += 1
    weight = max(1.0 / float(phase.samples), WEIGHT)
    phase.cosine += weight * (cosine - phase.cosine)
    phase.sine += weight * (sine - phase.sine)


@jit
def deadline_shift(phase: Record, deadline: int, period: int, interval: float) -> int:
    """Compute the shift of the next deadline from one period after `deadline` [ns], for a usual sample interval."""
    resultant = hypotenuse(phase.cosine, phase.sine)
    if phase.samples < LEAST_SAMPLES or resultant < LEAST_RESULTANT or interval < LEAST_INTERVAL * float(period):
        return as_int64(0)
    wanted = float(period) * (arc_tangent(phase.sine, phase.cosine) / (2.0 * math.pi) + AFTER_MEAN)
    off = (int(wanted) - deadline) % period
    if 2 * off > period:
        off -= period
    most = int(float(period) * LARGEST_SHIFT)
    return min(max(off, -most), most)
