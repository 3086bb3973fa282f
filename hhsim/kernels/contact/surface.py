"""Interface of an object's surface: six kernels, declared for the type of its arrays, and `way_out` for solids.

All but `cone_contacts`, which measures contacts, and `way_out`, which has a default, are needed for ticks. A surface
keeps its near pairs with each hand body in a record of its own type, its candidates, with the fields
`SHARED_CANDIDATES`; its arrays are a NamedTuple `by_reference`. A pair is one body and one piece of the surface: a leaf
sphere, a triangle.

Lists of pairs in tiers of distance: only the tiers that a body may have reached are measured.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import BODY_COUNT, BOX_CORNERS, HandArrays
from hhsim.kernels.jit import Array, Indices, Record, generic, jit, jit_inline
from hhsim.kernels.round_cone import RoundCone

SHARED_CANDIDATES = [
    ("count", np.int64, (BODY_COUNT,)),  # pairs of each body, or those measured
    ("slack", np.float64, (BODY_COUNT,)),  # least distance of a piece not listed [m]; -inf: to be gathered
    ("gathered_slack", np.float64, (BODY_COUNT,)),  # slack when it was gathered [m]; -inf before, inf if it never is
    ("slack_change", np.float64, (BODY_COUNT,)),  # change of the slack since the last evaluation [m]
    ("anchor", np.float64, (BODY_COUNT, BOX_CORNERS, 3)),  # ends of its axis, or corners of the palm's box then [m]
    ("nearest", np.float64, (BODY_COUNT,)),  # least signed distance, infinite without a pair [m]
    ("due", np.int64, (BODY_COUNT,)),  # 1 to gather now, 2 ahead of need, else 0
    ("needed", np.float64),  # slack that no body should have less of now [m]
    ("allowed_deficit", np.float64),  # slack missing before a body must be gathered: it bounds the step then [m]
]
"""Fields of the candidates of every surface, besides two of its own size for a walk, int64: `scratch` and `stack`."""


def shared_first(candidates: "np.dtype[Any] | None" = None) -> "np.dtype[Any]":
    """Return the fields that every surface has, and behind them those that a surface has of its own."""
    shared = np.dtype(SHARED_CANDIDATES, align=True)
    names = () if candidates is None else candidates.names or ()
    own = [(name, candidates[name]) for name in names if candidates is not None and name not in (shared.names or ())]
    return np.dtype([*SHARED_CANDIDATES, *own], align=True)


def seen_as(records: NDArray[np.void], dtype: "np.dtype[Any]") -> Any:
    """Return a view of records by a shorter type that they begin with, by which kernels take those of all surfaces.

    Of several records it is another type for numba than of one.
    """
    return np.ndarray(records.shape, dtype, records, strides=records.strides).view(np.recarray)


class Walk(NamedTuple):
    """Workspace of a walk through a hierarchy; each thread has its own."""

    stack: Indices
    scratch: Indices
    work: Indices  # counters of the work


class Surface(NamedTuple):
    """A kind of surface; a module of `hhsim.kernels.surfaces` declares one as `SURFACE`."""

    summary: str  # one line for help texts
    arrays: type  # NamedTuple that its kernels are declared for, `by_reference`
    candidates: "np.dtype[Any]"
    center: Callable[[Any], NDArray[np.float64]]  # of its arrays, a point [m] (3,) from which a hand inside escapes
    coarser: str = "a coarser object"  # name of one with fewer pieces, for messages
    lists_margin: bool = True  # True if pairs up to the whole margin are listed in every tick, as the paper counts


@generic
def gather_pairs(
    surface: Any, hand: HandArrays, pose: Record, body: int, reach: float, candidates: Record, walk: Walk
) -> bool:
    """List the pairs of one body up to `reach` [m], and set its count and slack; False if there is no room."""


@generic
def measure_pairs(surface: Any, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    """Return a body's least signed distance [m] of at least one pair; those not measured are beyond it and `needed`."""


@generic
def pairs_within(surface: Any, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    """Count the measured pairs of a body that are at most `limit` [m] apart."""


@generic
def record_pairs(
    surface: Any,
    hand: HandArrays,
    pose: Record,
    body: int,
    candidates: Record,
    limit: float,
    row: int,
    contacts: Record,
) -> int:
    """Write contact records of a body's measured pairs up to `limit` [m] from `row` on; return the row after, or -1."""


class ContactPoints(NamedTuple):
    """Touching pairs of a hand body and a piece of the surface, in the order of the ticks."""

    tick: Indices  # of each pair, from 0, (N,)
    body: Indices  # 0 to 14 the phalanges, finger by finger, proximal first; 15 the palm, (N,)
    point: NDArray[np.float64]  # the body's nearest point to the piece [m], world, (N, 3)
    normal: NDArray[np.float64]  # unit, from the object to the hand; zero if it has no direction, (N, 3)


@generic
def cone_contacts(
    surface: Any, cone: RoundCone, limit: float, walk: Walk, row: int, pairs_out: ContactPoints
) -> tuple[int, float]:
    """Write point and normal of each pair of a round cone and a piece up to `limit` [m], from `row` on.

    Returns the row after the last, -1 if there is no room, and a lower bound [m] on the distance of other pieces.
    """


@generic
def cone_distance(surface: Any, cone: RoundCone, limit: float, stack: Indices) -> float:
    """Compute the least signed distance [m] between a round cone and the surface; `limit` if none is below it."""


@generic
def way_out(surface: Any, x: float, y: float, z: float, stack: Indices) -> tuple[float, float, float, float]:
    """Compute a point's signed distance from a solid [m], negative inside, and the outward normal at the nearest point.

    The distance is infinite if the surface has no inside.
    """


@way_out.of(object)
@jit_inline
def _no_way_out(surface: Any, x: float, y: float, z: float, stack: Indices) -> tuple[float, float, float, float]:
    return (np.inf, 0.0, 0.0, 0.0)


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
