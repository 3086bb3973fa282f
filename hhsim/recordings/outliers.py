"""Samples that no hand made: outliers, jumps, rows out of order, and a frozen tracker.

A step is impossible if it is faster than a hand (`Kind.speed`, above what is known of punches, flicks and pianists), a
sample if going there and back takes more than `Kind.force`. Runs of samples between two impossible steps are outliers:
their numbers become NaN, to be interpolated. What a hand could have done stays; suspect samples are flagged.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag
from hhsim.recordings.recording import FINGER_ARM, PALM_ARM, Recording, change, turn

Vectors = Callable[[IntArray, IntArray], FloatArray]
"""Vectors between the samples of two arrays of indices, shape (N, C)."""


class Kind(NamedTuple):
    """Limits of a hand's motion in one kind of coordinate."""

    key: str  # field of a `Recording` that holds it; of joints, "angles"
    name: str  # name in messages
    unit: str
    speed: float  # fastest change [unit/s]
    force: float  # largest second derivative [unit/s²]
    noise: float  # largest change that is noise of the tracker [unit]
    outlier: SampleFlag  # flag of a sample that is replaced


POSITION = Kind("position", "palm position", "m", 10.0, 500.0, 0.01, SampleFlag.PALM_OUTLIER)
ORIENTATION = Kind("orientation", "palm orientation", "rad", 50.0, 4000.0, 0.15, SampleFlag.PALM_OUTLIER)
JOINT = Kind("angles", "joint angle", "rad", 60.0, 5000.0, 0.25, SampleFlag.FINGERS_OUTLIER)

LONGEST_RUN = 0.25
"""Longest duration of an outlier [s]; a longer run is another place of the hand."""
LONGEST_COUNT = 25
MOST_JUMPS = 0.1
"""Largest share of jumps among the steps of a motion."""
SUSPECT_RATIO = 8.0
"""Ratio of a suspect sample's deviation to the usual one around it."""
SUSPECT_FLOOR = 0.008
"""Smallest deviation that is not noise [m of a fingertip]."""
JOINT_FLOOR = 1e-3
"""Smallest deviation of a recorded joint that is told [m]."""
WINDOW = 7
"""Samples on either side that the local deviation is taken from."""
MOST_DISORDER = 0.9
"""Largest ratio of one-step to two-step distances: 0.5 for a smooth motion, 0.71 for a random walk, 1 for no order."""
DISORDER_FLOOR = 0.02
"""Smallest mean step whose order matters [m of a fingertip]."""
FROZEN_RUN = 5
"""Number of equal samples in a row of a tracker that repeats itself."""


def clean_glitches(recording: Recording) -> Recording:
    """Replace outliers by NaN, flag jumps and suspect samples, of increasing stamps, SI units; error for no motion."""
    if recording.sample_count >= 8:
        # Medians: a few spikes are no disorder.
        one, two = (float(np.median(way)) for way in _ways(recording))
        if one > DISORDER_FLOOR and one > MOST_DISORDER * two:
            reason = f"neighbouring samples are as far apart ({1e3 * one:.0f} mm) as others"
            raise TrajectoryError(f"{reason}: the rows are no motion; are they out of order?")
    for kind in (POSITION, ORIENTATION, JOINT):
        recording = _without_outliers(recording, kind)
    return suspect_joints(_suspects(_frozen(recording)))


def _ways(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Compute the distances of samples from the next ones, and from those after them [m]."""
    index = np.arange(recording.sample_count)
    return change(recording, index[:-1], index[1:]), change(recording, index[:-2], index[2:])


def _without_outliers(recording: Recording, kind: Kind) -> Recording:
    values, time, total = getattr(recording, kind.key), recording.time, recording.sample_count
    # The palm's coordinates are one vector, every joint moves by itself.
    width = 1 if kind is JOINT else values.shape[1]
    bad, jump, worst = np.zeros(values.shape, dtype=bool), np.zeros(total, dtype=bool), 0.0
    for first in range(0, values.shape[1], width):
        part, out = values[:, first : first + width], np.zeros(total, dtype=bool)
        # A quaternion of length zero is no orientation.
        index = np.flatnonzero(np.isfinite(part).all(axis=1) & (kind is not ORIENTATION or (part != 0.0).any(axis=1)))
        vector = partial(_way, part, kind)
        if index.size >= 3:
            fast = np.linalg.norm(vector(index[:-1], index[1:]), axis=1)
            fast = fast > kind.noise + kind.speed * np.diff(time[index])
            worst = max(worst, _mark_runs(time, index, vector, kind, fast, out, jump) if fast.any() else 0.0)
            worst = max(worst, _mark_spikes(time, index[~out[index]], vector, kind, out))
        bad[:, first : first + width] = out[:, None]
    outliers = np.asarray(bad.any(axis=1))
    found = int((outliers | jump).sum())
    if found > MOST_JUMPS * total + 3:
        raise TrajectoryError(
            f"the {kind.name} jumps at {found} of {total} samples, faster than {kind.speed:g} {kind.unit}/s: no hand "
            "moves so; are the rows out of order, or the stamps wrong?"
        )
    if outliers.any():
        clean = np.where(bad, np.nan, values)
        recording = recording.with_angles(clean) if kind is JOINT else recording.changed(**{kind.key: clean})
    text = f"{kind.name} off by up to {_amount(worst, kind.unit)}, which no hand does: interpolated"
    recording = recording.flagged(outliers, kind.outlier, text)
    text = f"{kind.name} jumps faster than {kind.speed:g} {kind.unit}/s and stays there: left as it is"
    return recording.flagged(jump, SampleFlag.JUMP, text)


def _way(values: FloatArray, kind: Kind, a: IntArray, b: IntArray) -> FloatArray:
    """Return the vectors from samples a to samples b of values, shape (T, C); of quaternions rotation vectors [rad]."""
    return turn(values[a], values[b]) if kind is ORIENTATION else np.asarray(values[b] - values[a])


def _mark_runs(
    time: FloatArray, index: IntArray, vector: Vectors, kind: Kind, fast: BoolArray, bad: BoolArray, jump: BoolArray
) -> float:
    """Mark runs that the main motion cannot reach, or jumps where they are too long; return the largest deviation."""
    edges = [0, *(np.flatnonzero(fast) + 1).tolist(), index.size]
    runs = [index[a:b] for a, b in pairwise(edges)]
    longest = int(np.argmax([run.size for run in runs]))
    worst = 0.0
    for direction in (1, -1):
        # From the longest run outwards, each time from the last sample that was believed.
        believed = runs[longest]
        for run in runs[longest + 1 :] if direction > 0 else runs[:longest][::-1]:
            a, b = (believed[-1:], run[:1]) if direction > 0 else (run[-1:], believed[:1])
            off = float(np.linalg.norm(vector(a, b), axis=1)[0])
            if off <= kind.noise + kind.speed * float(time[b[0]] - time[a[0]]):
                believed = run
            elif run.size <= LONGEST_COUNT and time[run[-1]] - time[run[0]] <= LONGEST_RUN:
                bad[run] = True
                worst = max(worst, off)
            else:
                jump[b] = True
                believed = run
    return worst


def _mark_spikes(time: FloatArray, index: IntArray, vector: Vectors, kind: Kind, bad: BoolArray) -> float:
    """Mark single samples that no force could have moved there and back; return the largest deviation."""
    if index.size < 3:
        return 0.0
    a, b, c = index[:-2], index[1:-1], index[2:]
    before, after = time[b] - time[a], time[c] - time[b]
    over = vector(a, c)
    off = np.linalg.norm(vector(a, b) - (before / (before + after))[:, None] * over, axis=1)
    spike = (2.0 * off > kind.force * before * after) & (off > kind.noise) & (np.linalg.norm(over, axis=1) < off)
    # The largest of neighbouring deviations is the spike: its neighbours' chords contain it.
    padded = np.concatenate([[0.0], off, [0.0]])
    spike &= (off >= padded[:-2]) & (off >= padded[2:])
    bad[b[spike]] = True
    return float(off[spike].max(initial=0.0))


def _frozen(recording: Recording) -> Recording:
    rows = np.concatenate([recording.position, recording.orientation, recording.angles], axis=1)
    same = (rows[1:] == rows[:-1]).all(axis=1)
    frozen = np.zeros(len(rows), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))).reshape(-1, 2)
    for first, last in [] if same.all() else edges.tolist():
        frozen[first : last + 1] |= last - first + 1 >= FROZEN_RUN
    text = "the same numbers over and over: the tracker may have lost the hand; left as they are"
    return recording.flagged(frozen, SampleFlag.FROZEN, text)


def _suspects(recording: Recording) -> Recording:
    """Flag samples that a hand could do, but that differ from their neighbours, or stand in no order."""
    count = recording.sample_count
    if count < 2 * WINDOW + 2:
        return recording
    off = np.zeros(count)
    off[1:-1] = bend(recording)
    suspect = (off > SUSPECT_FLOOR) & (off > SUSPECT_RATIO * _usual(off))
    one, two = _ways(recording)
    ways, wide = (np.convolve(way, np.ones(2 * WINDOW), "same") / (2 * WINDOW) for way in (one[:-1], two))
    suspect[1:-1] |= (ways > SUSPECT_FLOOR) & (ways > MOST_DISORDER * wide)
    most = _amount(off[suspect].max(initial=0.0), "m")
    text = f"out of line with the samples around by up to {most} of a fingertip: left"
    return recording.flagged(suspect, SampleFlag.SUSPECT, text)


def suspect_joints(recording: Recording) -> Recording:
    """Flag samples with a joint out of line with the samples around, or a bone of another length; they stay."""
    joints, time, count = recording.joints, recording.time, recording.sample_count
    if joints is None or count < 2 * WINDOW + 2:
        return recording
    off = np.zeros(joints.shape[:2])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None, None]
        off[1:-1] = np.linalg.norm(joints[1:-1] - joints[:-2] - share * (joints[2:] - joints[:-2]), axis=2)
    fingers = joints[:, 1:].reshape(count, 5, 4, 3)
    length = np.linalg.norm(np.diff(fingers, axis=2), axis=-1).reshape(count, 15)
    known = np.isfinite(length).all(axis=1)
    stretch = np.abs(length - np.median(length[known], axis=0)) if known.any() else length
    off, stretch = np.nan_to_num(off), np.nan_to_num(stretch)
    text = "a joint out of line with the samples around, or a bone of another length, by up to {:.1f} mm: left"
    bent = (off > JOINT_FLOOR) & (off > SUSPECT_RATIO * _usual(off))
    stretched = (stretch > JOINT_FLOOR) & (stretch > SUSPECT_RATIO * np.median(stretch, axis=0))
    most = 1e3 * max(off[bent].max(initial=0.0), stretch[stretched].max(initial=0.0))
    return recording.flagged(bent.any(axis=1) | stretched.any(axis=1), SampleFlag.SUSPECT, text.format(most))


def _usual(off: FloatArray) -> FloatArray:
    """Return the usual deviation around each sample, shape (T, ...)."""
    padded = np.pad(off, [(WINDOW, WINDOW)] + [(0, 0)] * (off.ndim - 1), mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * WINDOW + 1, axis=0)
    # The sample and its two neighbours, whose chords contain it, are excluded.
    return np.asarray(np.median(np.delete(around, (WINDOW - 1, WINDOW, WINDOW + 1), axis=-1), axis=-1))


def bend(recording: Recording) -> FloatArray:
    """Compute the distance of each sample but the ends from the chord of its neighbours [m of a fingertip]."""
    time, q = recording.time, recording.orientation
    share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    parts = [
        values[1:-1] - values[:-2] - share * (values[2:] - values[:-2])
        for values in (recording.position, FINGER_ARM * recording.angles)
    ]
    parts.append(PALM_ARM * (turn(q[:-2], q[1:-1]) - share * turn(q[:-2], q[2:])))
    return np.asarray(np.sqrt(sum(np.nansum(off * off, axis=1) for off in parts)))


def _amount(value: float, unit: str) -> str:
    return f"{1e3 * value:.0f} mm" if unit == "m" else f"{np.degrees(value):.0f}°"
