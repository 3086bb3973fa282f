"""Interface of an object's surface: kernels, declared for the type of its arrays.

A surface is pieces, of one kind or several, with a tree of spheres over them (`tree_of`), and lists of those near each
probe of a hand, see `kernels.contact.lists`. Ticks need `list_pieces`, `measure_pieces` and `record_pieces`,
measurements `cone_contacts` and `cone_distance`, a solid also `holds`. Its candidates are a record of its
own type with the fields of `list_fields`; its arrays are a NamedTuple `by_reference`. A pair is a body and a piece.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import BODY_COUNT, BOX_CORNERS, HandArrays
from hhsim.kernels.jit import Indices, Record, Triple, generic, jit_inline
from hhsim.kernels.round_cone import RoundCone

COUNT_NODE_TESTS = 0
COUNT_PAIR_TESTS = 1
COUNT_GATHERS = 2
"""Indices of the work counters."""

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
def list_pieces(
    surface: Any, probe: Any, most: int, most_found: int, reach: float, look_out: float, candidates: Record, walk: Walk
) -> float:
    """List the pieces up to `reach` [m] from a probe, each kind by `put_in_order`; return its slack [m].

    That is a lower bound on the motion to any other piece; those up to `look_out` [m] are looked at for it. A negative
    infinity if there are more than `most` of a kind, or `most_found` whose leaves are near.
    """


@generic
def measure_pieces(surface: Any, kind: int, cone: RoundCone, start: int, stop: int, candidates: Record) -> None:
    """Write the signed distances [m] of a probe to the pieces [start, stop) of a kind."""


@generic
def holds(surface: Any, probe: Any, candidates: Record) -> bool:
    """Return True if a point is inside, by its measured pieces, whose distances do not tell."""


@holds.of(object)
@jit_inline
def _holds_nothing(surface: Any, probe: Any, candidates: Record) -> bool:
    return False


@generic
def record_pieces(
    surface: Any, probe: Any, pose: Record, candidates: Record, limit: float, row: int, contacts: Record
) -> int:
    """Write contact records of a probe's measured pieces up to `limit` [m] from `row` on; return the row after, or -1.

    The body of each is written by the caller.
    """


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


@jit_inline
def write_contact(
    contacts: Record, row: int, point: Triple, normal: Triple, distance: float, radii: tuple[float, float], key: int
) -> None:
    """Write a contact record but for its body: the point on the hand, and the radii [m] of the hand and the object."""
    contacts.key[row] = key
    for j in range(3):
        contacts.point[j, row] = point[j]
        contacts.normal[j, row] = normal[j]
        contacts.straight[j, row] = 0.0
    contacts.distance[row] = distance
    contacts.hand_radius[row], contacts.object_radius[row] = radii
    contacts.slides[row] = 0


@jit_inline
def at_distance(place: Triple, direction: Triple, distance: float) -> Triple:
    """Return the point at a distance [m] from a place along a unit vector."""
    x, y, z = direction
    return place[0] + distance * x, place[1] + distance * y, place[2] + distance * z
