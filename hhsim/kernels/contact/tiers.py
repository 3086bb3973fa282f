"""Lists of pairs in tiers of distance: only the tiers that a body may have reached are measured."""

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_inline

TIERS = 8
"""Tiers of a list, equally deep, from contact to the list's reach."""


NO_DEPTH = 1e-12
"""Depth [m] of the tiers of a list that holds only pairs that penetrate: all are in the first one."""


@jit_inline
def tier_depth(reach: float) -> float:
    """Compute the depth of the tiers of a list that reaches so far [m]."""
    return max(reach / TIERS, NO_DEPTH)


@jit_inline
def tier_of(near: float, depth: float) -> int:
    """Return the tier of a pair that is `near` [m] away, in a list with tiers `depth` [m] deep."""
    return int(min(max(near / depth, 0.0), TIERS - 0.5))


@jit
def start_tiers(near: Array, count: int, depth: float, end_out: Indices) -> None:
    """Write where each tier starts, shape (TIERS,), of `count` distances `near` [m] or bounds, in tiers of `depth` [m].

    Who fills the list in order raises these places to where the tiers end.
    """
    for t in range(TIERS):
        end_out[t] = 0
    for i in range(count):
        end_out[tier_of(near[i], depth)] += 1
    before = 0
    for t in range(TIERS):
        before += end_out[t]
        end_out[t] = before - end_out[t]


@jit_inline
def next_tier(tier: int, depth: float, moved: float, needed: float, least: float) -> int:
    """Return the tier up to which to measure next; `tier` itself where nothing beyond it can matter.

    Those below `tier` are measured, with the least distance `least`; the body has moved by at most `moved` since it was
    listed; pairs up to `needed` are to be measured; all [m].
    """
    left = tier * depth - moved
    if tier == TIERS or (left > needed and left >= least):
        return tier
    tier += 1
    while tier < TIERS and tier * depth - moved <= needed:
        tier += 1
    return tier


@jit_inline
def moved_since(gathered: float, slack: float) -> float:
    """Compute how far a body has moved at most [m] since its slack was `gathered`; infinite where that is infinite."""
    return gathered - slack if gathered < np.inf else np.inf
