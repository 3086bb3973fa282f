"""Resampling from irregular stamps to ticks: monotone cubic, slerp, or hold.

The cubic is that of Fritsch & Butland (SIAM J. Sci. Stat. Comput. 5, 1984; "PCHIP"): between two samples it never
leaves their range, so a resampled finger flexes no further than measured, and a palm that rests stays at rest.

Ticks that fall on a stamp (within `STAMP_TOLERANCE`) take the sample bit for bit: a recording made at the tick rate is
replayed unchanged.
"""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.reproducible import arc_tangent, sine_and_cosine

STAMP_TOLERANCE = 1e-9
"""Largest distance of a stamp from a tick at the same time [s]: 3 · 0.001 and 3 / 1000 differ in the last bit."""

SMALL_ARC = 1e-6
"""Angle between quaternions [rad] below which chord and arc are equal in double precision."""


def tick_times(duration: float, rate: float) -> FloatArray:
    """Return k / rate [s] for k = 0, 1, … up to `duration` [s] inclusive, shape (N,)."""
    count = int(np.floor((duration + STAMP_TOLERANCE) * rate)) + 1
    return np.arange(count) / rate


def newest_sample(time: FloatArray, ticks: FloatArray) -> IntArray:
    """Return the index of the newest sample at or before each tick, shape (N,); no tick is before the first stamp."""
    index = np.searchsorted(time, ticks + STAMP_TOLERANCE, side="right") - 1
    return np.asarray(np.maximum(index, 0), dtype=np.int64)


def on_stamp(time: FloatArray, ticks: FloatArray, newest: IntArray) -> BoolArray:
    """Return True where a tick takes its newest sample as it is: on a stamp, or after all; shape (N,)."""
    sample: BoolArray = np.abs(ticks - time[newest]) <= STAMP_TOLERANCE
    sample |= newest == time.shape[0] - 1
    return sample


def monotone_slopes(time: FloatArray, values: FloatArray) -> FloatArray:
    """Compute the slopes [1/s] of the shape-preserving cubic at samples (T, C) of increasing stamps (T,) [s], T >= 2.

    They are zero at every local extremum, else the weighted harmonic mean of the neighbouring secants, which keeps
    every interval monotone.
    """
    step = np.diff(time)[:, None]
    secant = np.diff(values, axis=0) / step
    if time.shape[0] == 2:
        return np.repeat(secant, 2, axis=0)
    slopes = np.zeros_like(values)
    before, after = secant[:-1], secant[1:]
    weight_before, weight_after = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
    # Signs, not the product: the product of two tiny secants underflows to zero.
    turning = np.sign(before) * np.sign(after) <= 0.0
    first, second = np.where(turning, 1.0, before), np.where(turning, 1.0, after)
    swapped = np.abs(first) > np.abs(second)
    small, large = np.where(swapped, second, first), np.where(swapped, first, second)
    total, weight = weight_before + weight_after, np.where(swapped, weight_after, weight_before)
    # In ratio form the mean cannot overflow when the secants are tiny.
    harmonic = small * total / (weight + (total - weight) * (np.abs(small) / np.abs(large)))
    slopes[1:-1] = np.where(turning, 0.0, harmonic)
    slopes[0] = _end_slope(step[0], step[1], secant[0], secant[1])
    slopes[-1] = _end_slope(step[-1], step[-2], secant[-1], secant[-2])
    return slopes


def _end_slope(step: FloatArray, next_step: FloatArray, secant: FloatArray, next_secant: FloatArray) -> FloatArray:
    """Return the three-point slope at an end, limited so that the end interval stays monotone."""
    slope = ((2.0 * step + next_step) * secant - step * next_secant) / (step + next_step)
    wrong_way = np.sign(slope) != np.sign(secant)
    too_steep = (np.sign(secant) != np.sign(next_secant)) & (np.abs(slope) > 3.0 * np.abs(secant))
    return np.where(wrong_way, 0.0, np.where(too_steep, 3.0 * secant, slope))


def interpolate_monotone(time: FloatArray, values: FloatArray, ticks: FloatArray) -> FloatArray:
    """Evaluate the shape-preserving cubic through samples (T, …) at ticks (N,) [s], each within its neighbours' range.

    The stamps (T,) [s] increase; ticks after the last one take the last sample.
    """
    flat = values.reshape(values.shape[0], -1)
    newest = newest_sample(time, ticks)
    out = flat[newest]
    between = ~on_stamp(time, ticks, newest)
    if between.any():
        i = newest[between]
        slopes = monotone_slopes(time, flat)
        step = (time[i + 1] - time[i])[:, None]
        s = (ticks[between] - time[i])[:, None] / step
        a, b = flat[i], flat[i + 1]
        # Hermite's cubic written about the sample, so that equal samples give exactly that value.
        rise = (b - a) * (s * s * (3.0 - 2.0 * s))
        bend = step * (s * (1.0 - s)) * (slopes[i] * (1.0 - s) - slopes[i + 1] * s)
        out[between] = np.clip(a + rise + bend, np.minimum(a, b), np.maximum(a, b))
    return np.ascontiguousarray(out.reshape(ticks.shape[0], *values.shape[1:]))


def interpolate_orientation(time: FloatArray, quaternions: FloatArray, ticks: FloatArray) -> FloatArray:
    """Interpolate unit quaternions (T, 4), w x y z, along the shorter great arc (slerp) at ticks (N,) [s]; (N, 4).

    The stamps (T,) [s] increase.
    """
    newest = newest_sample(time, ticks)
    out = quaternions[newest]
    between = ~on_stamp(time, ticks, newest)
    if between.any():
        i = newest[between]
        s = ((ticks[between] - time[i]) / (time[i + 1] - time[i]))[:, None]
        a, b = quaternions[i], quaternions[i + 1]
        b = np.where(np.sum(a * b, axis=1, keepdims=True) < 0.0, -b, b)
        # Half chords give the angle without the cancellation of acos near 1.
        chord = np.linalg.norm(b - a, axis=1, keepdims=True)
        arc = 2.0 * arc_tangent(chord, np.linalg.norm(b + a, axis=1, keepdims=True))
        small = arc < SMALL_ARC
        sine = np.where(small, 1.0, sine_and_cosine(arc)[0])
        weight_a = np.where(small, 1.0 - s, sine_and_cosine((1.0 - s) * arc)[0] / sine)
        weight_b = np.where(small, s, sine_and_cosine(s * arc)[0] / sine)
        mixed = weight_a * a + weight_b * b
        still = np.all(a == b, axis=1, keepdims=True)
        out[between] = np.where(still, a, mixed / np.linalg.norm(mixed, axis=1, keepdims=True))
    return np.ascontiguousarray(out)
