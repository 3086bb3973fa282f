"""Cleaning of stamps that repeat, go backwards, are missing or leave gaps.

A sample out of order is sorted in if its place by stamp fits its neighbours at least as well as its place in the file;
otherwise its stamp is wrong, and it is left out. If many are, two clocks or recordings are mixed: refused.
"""

from bisect import bisect_right

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, mark
from hhsim.recordings.recording import MOTION, Recording, change, deviation, finding_of
from hhsim.system.counted import counted

SAME_STAMP = 1e-6
"""Smallest time between different stamps [s]: no glove samples at 1 MHz."""
GAP_STEPS = 3.0 - 1e-6
"""Least length of a gap [median steps]: three, but for rounding."""
MOST_DROPPED = 0.25
"""Largest share of samples that may be left out."""
MAIN_PIECE_SHARE = 0.9
"""Share of the samples from which on a piece far from the others is the recording."""
PATH_RATIO = 1.02
"""Ratio of the hand's path sorted by stamps to its path in the file above which some stamps are wrong."""
DEVIATION_RATIO = 3.0
"""Ratio of the deviation by stamp to that in the file above which a stamp is wrong."""
NOISE = 2e-3
"""Largest deviation that says nothing about an order [m]."""


def clean_stamps(recording: Recording, max_gap: float) -> Recording:
    """Return samples with strictly increasing stamps, of stamps [s] in any state with gaps up to `max_gap` [s].

    Raises TrajectoryError if too many stamps are missing, repeat or contradict the motion, or a gap is too long.
    """
    recording = _one_piece(_without_repeats(_in_order(_without_missing(recording))), max_gap)
    step = np.diff(recording.time)
    usual = float(np.median(step))
    gap = np.concatenate([[False], step > GAP_STEPS * usual])
    lengths = f"the longest {1e3 * step.max():.0f} ms where {1e3 * usual:.1f} ms is usual"
    return recording.flagged(gap, SampleFlag.GAP_BEFORE, f"gaps, {lengths}: the stamps stay, replays interpolate")


def _without_missing(recording: Recording) -> Recording:
    missing = np.isnan(recording.time)
    if not missing.any():
        return recording
    _bound(int(missing.sum()), recording.sample_count, "have no time stamp")
    return _dropped(recording, ~missing, "without a time stamp: left out")


def _in_order(recording: Recording) -> Recording:
    time = recording.time
    if (np.diff(time) >= 0.0).all():
        return recording
    order = np.argsort(time, kind="stable")
    moved = ~_longest_rise(time)
    wrong = np.zeros(time.shape, dtype=bool)
    if _path_length(recording, order) > PATH_RATIO * _path_length(recording, np.arange(time.shape[0])):
        wrong = _contradicting(recording, order, moved)
    if wrong.sum() > MOST_DROPPED * recording.sample_count:
        first = int(np.argmax(np.diff(time) < 0.0)) + 1
        raise TrajectoryError(
            f"the stamps go backwards at sample {first} ({time[first - 1]:.6g} s, then {time[first]:.6g} s) and "
            f"sorting them does not give one motion: {wrong.sum()} samples do not fit where their stamps put them; "
            "are these two recordings in one file?"
        )
    if wrong.any():
        recording = _dropped(recording, ~wrong, "whose stamp contradicts the motion around it: left out")
        moved = moved[~wrong]
        order = np.argsort(recording.time, kind="stable")
    return recording.flagged(moved, SampleFlag.REORDERED, "out of order: sorted by their stamps").chosen(order)


def _longest_rise(time: FloatArray) -> BoolArray:
    """Return members of a longest non-decreasing subsequence (patience sorting), shape (T,)."""
    count = time.shape[0]
    ends: list[int] = []
    tails: list[float] = []
    before = np.full(count, -1)
    for i, stamp in enumerate(time.tolist()):
        place = bisect_right(tails, stamp)
        if place:
            before[i] = ends[place - 1]
        if place == len(tails):
            tails.append(stamp)
            ends.append(i)
        else:
            tails[place] = stamp
            ends[place] = i
    member = np.zeros(count, dtype=bool)
    i = ends[-1]
    while i >= 0:
        member[i] = True
        i = int(before[i])
    return member


def _path_length(recording: Recording, order: IntArray) -> float:
    """Compute the length of the hand's path through all samples in this order [m]."""
    return float(change(recording, order[:-1], order[1:]).sum())


def _contradicting(recording: Recording, order: IntArray, moved: BoolArray) -> BoolArray:
    """Return moved samples that fit their place in the file much better than their place by stamp, shape (T,)."""
    count = recording.sample_count
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    by_rank = np.sort(rank[~moved])
    wrong = np.zeros(count, dtype=bool)
    for i in np.flatnonzero(moved).tolist():
        in_file = deviation(recording, i, tuple(j for j in (i - 1, i + 1) if 0 <= j < count))
        # By stamp, only the samples that keep their order count: other moved ones say nothing.
        place = int(np.searchsorted(by_rank, rank[i]))
        beside = by_rank[max(place - 1, 0) : place + 1]
        by_stamp = deviation(recording, i, tuple(int(order[r]) for r in beside))
        wrong[i] = by_stamp > DEVIATION_RATIO * in_file + NOISE
    return wrong


def _without_repeats(recording: Recording) -> Recording:
    time = recording.time
    repeat = np.concatenate([[False], np.diff(time) < SAME_STAMP])
    if not repeat.any():
        return recording
    # A run of close stamps must not be eaten up one by one: what counts is the distance to the last one kept.
    kept = -np.inf
    for i, stamp in enumerate(time.tolist()):
        repeat[i] = stamp - kept < SAME_STAMP
        kept = kept if repeat[i] else stamp
    pairs = ((getattr(recording, key)[1:], getattr(recording, key)[:-1]) for key in MOTION)
    same = all(np.array_equal(now[repeat[1:]], before[repeat[1:]], equal_nan=True) for now, before in pairs)
    _bound(int(repeat.sum()), recording.sample_count, "repeat the stamp before them")
    how = "with the same values" if same else "with other values, of which the first are kept"
    return _dropped(recording, ~repeat, f"repeat the stamp before them, {how}: left out")


def _one_piece(recording: Recording, max_gap: float) -> Recording:
    time = recording.time
    if time.shape[0] < 2:
        raise TrajectoryError(f"{counted(time.shape[0], 'usable sample')}; expected at least 2 with stamps that differ")
    broken = np.flatnonzero(np.diff(time) > max_gap) + 1
    if not broken.size:
        return recording
    edges = [0, *broken.tolist(), time.shape[0]]
    sizes = np.diff(edges)
    largest = int(np.argmax(sizes))
    if sizes[largest] >= MAIN_PIECE_SHARE * time.shape[0]:
        keep = np.zeros(time.shape[0], dtype=bool)
        keep[edges[largest] : edges[largest + 1]] = True
        return _dropped(recording, keep, f"more than {max_gap:g} s away from the others: left out")
    i = int(broken[0])
    raise TrajectoryError(
        f"no sample for {time[i] - time[i - 1]:.3g} s after {time[i - 1]:.6g} s, "
        f"{counted(broken.size, 'such hole')} of more than {max_gap:g} s: too long to bridge; cut a part out with "
        "--from and --to, or allow it with --max-gap"
    )


def _dropped(recording: Recording, keep: BoolArray, why: str) -> Recording:
    """Return the recording without the samples that are not kept; the next one in the file is flagged."""
    if not keep.any():
        raise TrajectoryError("no usable sample is left; expected at least 2")
    kept = np.flatnonzero(keep)
    after = np.concatenate([[keep[: kept[0]].size > 0], np.diff(kept) > 1])
    left = recording.chosen(keep)
    mark(left.flags, after, SampleFlag.CUT_BEFORE)
    return left.found(finding_of(recording.time[~keep], SampleFlag.CUT_BEFORE, why))


def _bound(count: int, total: int, what: str) -> None:
    if count > MOST_DROPPED * total:
        raise TrajectoryError(f"{count} of {total} samples {what}; expected a stamp of its own for each")
