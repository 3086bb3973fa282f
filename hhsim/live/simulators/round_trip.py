"""How long a sample takes through a session, by the clock of the peer that sent it and got the command back."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Times = NDArray[np.int64]

BEFORE = 20_000
"""A command can reach a peer on another processor this much before the sender looks at its clock [ns]."""


def added_latencies(sent: ArrayLike, received: ArrayLike, told: ArrayLike, of: ArrayLike) -> Times:
    """From each sample sent to the first command that used it, both as the peer saw them.

    The session says which command used which sample first, and when it was sent; the peer says when it came.

    Args:
        sent: when the peer sent each sample, CLOCK_MONOTONIC [ns], by the sample's number.
        received: when commands came to the peer [ns], ascending.
        told: when the session sent each command that used a sample for the first time [ns].
        of: the number of that sample.

    Returns:
        [ns], for those of `told` whose command came and whose sample is known; a command is taken for the first one
        that came after it was sent, so that a doubt makes it longer, never shorter.
    """
    sent_, received_, told_ = (np.asarray(values, np.int64) for values in (sent, received, told))
    number = np.asarray(of, np.int64)
    known = (number >= 0) & (number < sent_.size)
    told_, number = told_[known], number[known]
    place = np.searchsorted(received_, told_ - BEFORE)
    came = place < received_.size
    return np.asarray(received_[place[came]] - sent_[number[came]], np.int64)
