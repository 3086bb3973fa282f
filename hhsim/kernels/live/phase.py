"""Where in the loop's period the glove's samples come: deadlines move, so that each sample finds a loop that waits.

A tick is due with its sample in the last part of a period alone (`hhsim.kernels.live.deadlines`), and one that comes
before waits for that. The phase of a glove whose interval is a whole number of periods stays; its mean direction and
spread are those of directional statistics (Mardia and Jupp, Directional Statistics, 2000, section 2.3). Other gloves
have no phase, and deadlines stay where they are.
"""

import math

import numpy as np

from hhsim.kernels.jit import Record, as_int64, jit
from hhsim.kernels.live.deadlines import EARLIEST

PHASE = np.dtype(
    [
        ("cosine", np.float64),
        ("sine", np.float64),
        ("samples", np.int64),
    ],
    align=True,
)
"""Running mean of the phase's cosine and sine, of so many samples."""

WEIGHT = 1.0 / 128.0
"""Of the newest sample, where there are so many: a mean of about half a second at 200 Hz."""
LEAST_SAMPLES = 48
"""Before there are so many, samples of another rate may look as if they had a phase."""
LEAST_RESULTANT = 0.7
"""Mean resultant length below which samples have no phase: a deviation of 0.13 periods."""
AFTER_MEAN = 0.5 * EARLIEST
"""Of a period: so long after the mean of its samples a deadline is to be, and jitter may be as much to either side."""
LEAST_INTERVAL = 0.75
"""Periods: samples that come more often are never old."""
LARGEST_SHIFT = 1.0 / 5000.0
"""Of a period: by so much each deadline moves at most. A glove's clock may go so much faster or slower than ours."""


@jit
def count_phase(phase: Record, handed: int, period: int) -> None:
    """Count in a sample.

    Args:
        phase: Of `PHASE`.
        handed: When the loop could take it [ns].
        period: The loop's [ns].
    """
    angle = 2.0 * math.pi * float(handed % period) / float(period)
    cosine, sine = math.cos(angle), math.sin(angle)
    phase.samples += 1
    weight = max(1.0 / float(phase.samples), WEIGHT)
    phase.cosine += weight * (cosine - phase.cosine)
    phase.sine += weight * (sine - phase.sine)


@jit
def deadline_shift(phase: Record, deadline: int, period: int, interval: float) -> int:
    """By how much the next deadline is to be more than a period after `deadline` [ns], negative for less.

    Args:
        phase: Of `PHASE`.
        deadline: The present one [ns].
        period: The loop's [ns].
        interval: Between two samples, usually [ns].
    """
    resultant = math.hypot(phase.cosine, phase.sine)
    if phase.samples < LEAST_SAMPLES or resultant < LEAST_RESULTANT or interval < LEAST_INTERVAL * float(period):
        return as_int64(0)
    wanted = float(period) * (math.atan2(phase.sine, phase.cosine) / (2.0 * math.pi) + AFTER_MEAN)
    off = (int(wanted) - deadline) % period
    if 2 * off > period:
        off -= period
    most = int(float(period) * LARGEST_SHIFT)
    return min(max(off, -most), most)
