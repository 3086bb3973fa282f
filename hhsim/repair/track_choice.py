"""Choice of one track at each frame, by dynamic programming."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray

NO_HAND = 1.0
"""Cost of a frame without a hand [m²]: above that of any correction of less than a metre."""


def choose_tracks(
    first: Sequence[int], correction: Sequence[FloatArray], valid: Sequence[BoolArray], weight: float
) -> IntArray:
    """Return the track of each frame with the least sum of squared corrections and of their weighted squared changes.

    Args:
        first: First frame of each track; track 0 has all frames.
        correction: Displacement of each point of the hand from the recorded one [m], shape (n, P, 3), of each track.
        valid: True where a track has a hand that does not penetrate, shape (n,), of each track. A frame without any
            gets track 0, from and to which changes are free.
        weight: Weight of a squared change of the correction from frame to frame, against a squared correction.

    Returns:
        Indices of tracks, shape (T,); of equal sums the first track's.
    """
    frames = len(valid[0])
    at: list[list[int]] = [[] for _ in range(frames)]
    for k, own in enumerate(valid):
        for t in (first[k] + np.flatnonzero(own)).tolist():
            at[t].append(k)
    before: list[IntArray] = []
    total, last = np.zeros(1), np.zeros((0, 1, 3))
    for t, tracks in enumerate(at):
        off = np.array([correction[k][t - first[k]] for k in tracks])
        if len(off) and len(last):
            change = ((off[:, None] - last[None]) ** 2).sum(axis=-1).mean(axis=-1)
        else:
            change = np.zeros((max(1, len(off)), len(total)))
        sums = total[None] + weight * change
        before.append(sums.argmin(axis=1))
        node = (off**2).sum(axis=-1).mean(axis=-1) if len(off) else np.array([NO_HAND])
        total, last = sums.min(axis=1) + node, off
    chosen = np.zeros(frames, dtype=np.int64)
    place = int(total.argmin())
    for t in range(frames - 1, -1, -1):
        chosen[t] = at[t][place] if at[t] else 0
        place = int(before[t][place])
    return chosen
