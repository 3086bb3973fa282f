"""What the surface of an object is to a tick: six kernels, declared for the type of its arrays.

A surface keeps its near pairs with each hand body in a record of its own type, its candidates; what detection needs of
them all is in `SHARED_CANDIDATES`. A pair is one body and one piece of the surface: a leaf sphere, a triangle.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import BODY_COUNT, BOX_CORNERS, HandArrays
from hhsim.kernels.jit import Indices, Record, generic
from hhsim.kernels.round_cone_distance import RoundCone

SHARED_CANDIDATES = [
    ("count", np.int64, (BODY_COUNT,)),
    ("slack", np.float64, (BODY_COUNT,)),
    ("fresh", np.float64, (BODY_COUNT,)),
    ("pace", np.float64, (BODY_COUNT,)),
    ("anchor", np.float64, (BODY_COUNT, BOX_CORNERS, 3)),
    ("nearest", np.float64, (BODY_COUNT,)),
    ("due", np.int64, (BODY_COUNT,)),
    ("needed", np.float64),
    ("leeway", np.float64),
]
"""Fields of the candidates of every surface.

| field | meaning |
|---|---|
| count | pairs of each body; where not all of them had to be measured, those that were |
| slack | least distance that any piece left out can still have [m]; negative infinity: to be gathered |
| fresh | slack when the body was gathered [m]; negative infinity before that, infinity where it never is |
| pace | by how much the slack has changed since the last evaluation [m] |
| anchor | where the body was then: the ends of its axis, or the corners of a box around the palm's centres [m] |
| due | 1 where the body is to be gathered now, 2 where ahead of need, else 0 |
| needed | slack that no body should have less of now [m] |
| leeway | by how much a body may have less before it must be gathered: its step is then bounded by its slack [m] |
| nearest | least signed distance of each body, infinite where it has no pair [m] |

And two of the surface's own size, int64: `scratch` and `stack`, for a walk.
"""


class Walk(NamedTuple):
    """What a walk through a hierarchy works in; each thread has its own."""

    stack: Indices
    scratch: Indices


class Surface(NamedTuple):
    """A surface that objects can have; a module of `hhsim.kernels.surfaces` declares one as `SURFACE`.

    | field | meaning |
    |---|---|
    | summary | one line for help texts |
    | arrays | the NamedTuple that its kernels are declared for |
    | candidates | dtype of its candidates |
    | center | a point [m] (3,) that a hand inside gets away from, of such arrays |
    | coarser | what has fewer pieces, for messages |
    | lists_margin | whether pairs up to the whole margin are listed in every tick, as the paper counts them |
    """

    summary: str
    arrays: type
    candidates: "np.dtype[Any]"
    center: Callable[[Any], NDArray[np.float64]]
    coarser: str = "a coarser object"
    lists_margin: bool = True


@generic
def gather_pairs(
    surface: Any, hand: HandArrays, pose: Record, body: int, reach: float, candidates: Record, walk: Walk, work: Indices
) -> bool:
    """List the pairs of one body up to `reach` [m], and set its count and slack; False where there is no room."""


@generic
def measure_pairs(surface: Any, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    """Signed distances of the listed pairs of a body, which has at least one; returns the least [m].

    At least of those up to `candidates.needed`: what is not measured is farther than that, and than the least.
    """


@generic
def pairs_within(surface: Any, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    """How many measured pairs of a body are at most `limit` [m] apart."""


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
    """Write contact records of a body's measured pairs up to `limit` [m], from `row` on.

    Returns the row after the last, -1 where there is no room.
    """


class ContactPoints(NamedTuple):
    """Touching pairs of a hand body and a piece of the surface, in the order of the ticks.

    | field | meaning | shape |
    |---|---|---|
    | tick | of each pair, from 0 | (N,) |
    | body | 0 to 14 the phalanges, finger by finger, proximal first; 15 the palm | (N,) |
    | point | the body's nearest point to the piece [m], world | (N, 3) |
    | normal | unit, from the object to the hand; zero where it has no direction | (N, 3) |
    """

    tick: Indices
    body: Indices
    point: NDArray[np.float64]
    normal: NDArray[np.float64]


@generic
def cone_contacts(
    surface: Any, cone: RoundCone, limit: float, walk: Walk, row: int, pairs_out: ContactPoints
) -> tuple[int, float]:
    """Where a round cone is no more than `limit` [m] from pieces of the surface, or inside of them.

    Writes point and normal of each pair, from `row` on. Returns the row after the last, -1 where there is no room, and
    a distance [m] that no piece without a pair is nearer than.
    """


@generic
def cone_distance(surface: Any, cone: RoundCone, limit: float, stack: Indices) -> float:
    """Least signed distance [m] between a round cone and the surface; `limit` where none is below it."""
