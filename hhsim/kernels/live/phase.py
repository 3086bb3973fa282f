"""Where in the loop's period the glove's samples come: deadlines move, so that a tick begins right after its sample.

A sample that comes in the middle of a period waits for the rest of it, and one whose phase drifts waits for all of it
now and then. The phase of a glove whose interval is a whole number of periods stays; its mean direction and spread are
those of directional statistics (Mardia and Jupp, Directional Statistics, 2000, section 2.3). Other gloves have no
phase, and deadlines stay where they are.
"""

import math

import numpy as np

from hhsim.kernels.jit import Record, as_int64, jit

PHASE = np.dtype(
    [
        ("cosine", np.float64),
        ("sine", np.float64),
        ("further", np.float64),
        ("samples", np.int64),
        ("stage", np.int64),
        ("leaps", np.int64),
    ],
    align=True,
)
"""Running mean of the phase's cosine and sine, of so many samples; how far the search is, and how often it leapt.

`further` is by how many standard deviations a deadline is to be further after the mean than `DEVIATIONS`.
"""

SEARCHING, MOVING, FOUND = 0, 1, 2
"""No phase is known yet; deadlines move to the first one that was found; they follow it."""

WEIGHT = 1.0 / 128.0
"""Of the newest sample, where there are so many: a mean of about half a second at 200 Hz."""
LEAST_SAMPLES = 48
"""Before there are so many, samples of another rate may look as if they had a phase."""
LEAST_RESULTANT = 0.7
"""Mean resultant length below which samples have no phase: a deviation of 0.13 periods."""
DEVIATIONS = 3.0
"""How many standard deviations after the mean of its samples a deadline is to be, to begin with."""
LATE_SHARE = 0.005
"""Of the samples that may miss their tick and wait for the next one: where fewer do, all others wait longer."""
LEAST_FURTHER, MOST_FURTHER = -1.0, 3.0
"""What `further` stays between: a stall of the machine tells nothing of a glove."""
LEAST_INTERVAL = 0.75
"""Periods: samples that come more often are never old."""
FIRST_SHIFT = 1.0 / 100.0
"""Of a period: by so much each deadline moves until the first phase that was found is nearer than that."""
MOST_LEAPS = 60
"""Such steps in a session: half a period is the way to any phase, but a glove that only answers would be run after."""
LARGEST_SHIFT = 1.0 / 5000.0
"""By so much each deadline moves at most from then on: a glove's clock may go so much faster or slower than ours."""


@jit
def _deviation(phase: Record) -> float:
    """Standard deviation of the phase [rad], of directional statistics."""
    resultant = min(max(math.hypot(phase.cosine, phase.sine), 1e-12), 1.0)
    return math.sqrt(-2.0 * math.log(resultant))


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
    if phase.samples >= LEAST_SAMPLES:
        # A quantile by stochastic approximation (Robbins and Monro, 1951): jitter has longer tails than a normal law's.
        after = math.atan2(sine * phase.cosine - cosine * phase.sine, cosine * phase.cosine + sine * phase.sine)
        late = after > (DEVIATIONS + phase.further) * _deviation(phase)
        further = phase.further + (1.0 - LATE_SHARE if late else -LATE_SHARE)
        phase.further = min(max(further, LEAST_FURTHER), MOST_FURTHER)
    phase.samples += 1
    weight = max(1.0 / float(phase.samples), WEIGHT)
    phase.cosine += weight * (cosine - phase.cosine)
    phase.sine += weight * (sine - phase.sine)


@jit
def deadline_shift(phase: Record, deadline: int, period: int, interval: float) -> int:
    """By how much the next deadline is to be more than a period after `deadline` [ns], negative for less.

    Args:
        phase: Of `PHASE`. Deadlines that move by `FIRST_SHIFT` follow one another, once in a session.
        deadline: The present one [ns].
        period: The loop's [ns].
        interval: Between two samples, usually [ns].
    """
    resultant = math.hypot(phase.cosine, phase.sine)
    if phase.samples < LEAST_SAMPLES or resultant < LEAST_RESULTANT or interval < LEAST_INTERVAL * float(period):
        phase.stage = FOUND if phase.stage == MOVING else phase.stage
        return as_int64(0)
    turn = float(period) / (2.0 * math.pi)
    wanted = turn * (math.atan2(phase.sine, phase.cosine) + (DEVIATIONS + phase.further) * _deviation(phase))
    off = (int(wanted) - deadline) % period
    if 2 * off > period:
        off -= period
    most = int(float(period) * FIRST_SHIFT)
    if phase.stage == FOUND or phase.leaps == MOST_LEAPS or abs(off) <= most:
        phase.stage = FOUND
        most = int(float(period) * LARGEST_SHIFT)
    else:
        phase.stage = MOVING
        phase.leaps += 1
    return min(max(off, -most), most)
