"""Low-pass of corrections that leaves hands free of penetration."""

from collections.abc import Callable

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.repair.hand_change import REACH, change_between, changed_hand, low_pass, mean_acceleration
from hhsim.repair.hand_judge import farthest
from hhsim.system.progress import Progress

ROUNDS = 8
STEADY = 1.05
"""Ratio of mean accelerations, repaired to recorded, at which smoothing ends."""

WORTH = 0.97
"""A further round is kept if it lowers the mean acceleration to this share: each moves hands farther from the recorded
ones."""

Measure = Callable[[HandConfiguration], FloatArray]
MadeFree = Callable[[HandConfiguration, HandConfiguration], HandConfiguration]


def smoothed(
    recorded: HandConfiguration,
    found: HandConfiguration,
    limit: float,
    points: Measure,
    clearance: Measure,
    made_free: MadeFree,
    progress: Progress,
    open_frames: BoolArray | None = None,
) -> HandConfiguration:
    """Return hands whose corrections are low-passed, and which penetrate nowhere where the hands found did not.

    A smoothed hand that penetrates is replaced by a free one near it. Each is accepted by its own clearance.

    Args:
        recorded, found: Hands of T frames before and after the correction.
        limit: Largest move of a point [m] that smoothing may lead to beyond the moves of neighbouring frames.
        points: Points of hands by which they are compared [m], shape (T, P, 3).
        clearance: Signed distance of hands from the object [m], shape (T,).
        made_free: Free hands near the second argument's, reached from the first's, which are free.
        open_frames: True for frames that smoothing may change, shape (T,); None: all.
    """
    origin = points(recorded)
    steady, before = STEADY * mean_acceleration(origin), np.inf
    for number in range(ROUNDS):
        change = change_between(recorded, found)
        at = points(found)
        if not change.any() or (number and before <= steady):
            break
        progress("smoothing", number, ROUNDS)
        wanted = low_pass(change)
        if open_frames is not None:
            wanted[~open_frames] = 0.0
        better = made_free(found, changed_hand(recorded, wanted))
        # A frame may move as far as its neighbours do: refused one by one, frames would jump.
        moved = np.pad(farthest(at, origin), REACH, mode="edge")
        largest = np.lib.stride_tricks.sliding_window_view(moved, 2 * REACH + 1).max(axis=1)
        accepted = farthest(points(better), origin) <= np.maximum(limit, largest)
        accepted &= (clearance(better) >= 0.0) & (clearance(found) >= 0.0)
        calmer = HandConfiguration(
            *(np.where(accepted.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in zip(better, found))
        )
        now = mean_acceleration(points(calmer))
        if now > WORTH * before:
            break
        found, before = calmer, now
    return found
