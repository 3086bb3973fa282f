"""Where in the loop's period the glove's samples come: deadlines move, so that a tick begins right after its sample.

A sample that comes in the middle of a period waits for the rest of it, and one whose phase drifts waits for all of it
now and then. The phase of a glove whose interval is a whole number of periods stays; its mean direction and spread are
those of directional statistics (Mardia and Jupp, Directional Statistics, 2000, section 2.3). Other gloves have no
phase, and deadlines stay where they are.
"""

import math

import numpy as np

from hhsim.kernels.jit import Record, as_int64, jit

PHASE = np.dtype([("cosine", np.float64), ("sine", np.float64)], align=True)
"""Running mean of the phase's cosine and sine."""

WEIGHT = 1.0 / 128.0
"""Of the newest sample: a mean of about half a second at 200 Hz."""
LEAST_RESULTANT = 0.7
"""Mean resultant length below which samples have no phase: a deviation of 0.13 periods."""
DEVIATIONS = 4.0
"""How many standard deviations after the mean of its samples a deadline is to be."""
LEAST_INTERVAL = 0.75
"""Periods: samples that come more often are never old."""
MOST_SHIFT = 5000
"""A deadline moves by a period through this at most: a glove's clock may go so much faster or slower than ours."""


@jit
def count_phase(phase: Record, handed: int, period: int) -> None:
    """Count in a sample.

    Args:
        phase: Of `PHASE`.
        handed: When the loop could take it [ns].
        period: The loop's [ns].
    """
    angle = 2.0 * math.pi * float(handed % period) / float(period)
    phase.cosine += WEIGHT * (math.cos(angle) - phase.cosine)
    phase.sine += WEIGHT * (math.sin(angle) - phase.sine)


@jit
def deadline_shift(phase: Record, deadline: int, period: int) -> int:
    """By how much the next deadline is to be more than a period after `deadline` [ns], negative for less.

    Args:
        phase: Of `PHASE`.
        deadline: The present one [ns].
        period: The loop's [ns].
    """
    resultant = math.hypot(phase.cosine, phase.sine)
    if resultant < LEAST_RESULTANT:
        return as_int64(0)
    turn = float(period) / (2.0 * math.pi)
    deviation = turn * math.sqrt(max(0.0, -2.0 * math.log(resultant)))
    wanted = turn * math.atan2(phase.sine, phase.cosine) + DEVIATIONS * deviation
    off = (int(wanted) - deadline) % period
    if 2 * off > period:
        off -= period
    most = period // MOST_SHIFT
    return min(max(off, -most), most)
