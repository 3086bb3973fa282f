"""Choice of one track at each frame, by dynamic programming."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray

CHANGE_WEIGHT = 20.0
"""Weight of a squared change of the correction from frame to frame, against the squared correction of a frame."""
NO_HAND = 1.0
"""Cost of a frame without a hand [m²]: above that of any correction of less than a metre."""


def choose_tracks(correction: FloatArray, valid: BoolArray) -> IntArray:
    """Return the track of each frame with the least sum of squared corrections and of their weighted squared changes.

    Args:
        correction: Displacement of each point of the hand from the recorded one [m], shape (K, T, P, 3).
        valid: True where a track has a hand that does not penetrate, shape (K, T).

    Returns:
        Indices of tracks, shape (T,); of equal sums the first track's.
    """
    tracks, frames = valid.shape
    off = np.where(valid[..., None, None], correction, 0.0)
    node = np.where(valid, (off**2).sum(axis=-1).mean(axis=-1), NO_HAND)
    before = np.zeros((frames, tracks), dtype=np.int64)
    total = node[:, 0]
    for t in range(1, frames):
        change = ((off[:, None, t] - off[None, :, t - 1]) ** 2).sum(axis=-1).mean(axis=-1)
        change[~(valid[:, None, t] & valid[None, :, t - 1])] = 0.0
        sums = total[None] + CHANGE_WEIGHT * change
        before[t] = sums.argmin(axis=1)
        total = sums.min(axis=1) + node[:, t]
    chosen = np.zeros(frames, dtype=np.int64)
    chosen[-1:] = total.argmin() if frames else 0
    for t in range(frames - 1, 0, -1):
        chosen[t - 1] = before[t, chosen[t]]
    return chosen
