"""Contact detection on any surface, and the addresses by which ticks call it.

*Gathering* walks the object's hierarchy for a body with a margin plus a skin and copies what it finds into contiguous
arrays. *Evaluation* computes the signed distances of all gathered pairs on the vector unit, every time the hand moves.

No pair is missed. When a body is gathered, every piece that is not listed is at least `gathered_slack` away. From there
no point of the body moves farther than an end of its axis, or a corner of a box around the palm: points between are
means of them. So these pieces are still at least slack = gathered_slack - that distance away. A body is gathered anew
before its slack falls below what the next step needs, less an allowed deficit; a step that is longer than the slack
gathers it first, or is cut short.

Ticks know a surface by the addresses of the machine code that looks at it, and of its arrays: so a tick is compiled
once for all surfaces, and each surface's own code once for all ticks. It is called a few times a program, with all
bodies of a hand at once.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.lists import gather_pairs, measure_pairs
from hhsim.kernels.contact.surface import COUNT_GATHERS, COUNT_PAIR_TESTS, Walk, pairs_within, record_pairs
from hhsim.kernels.hand.kinematics import BODY_COUNT, BOX_CORNERS, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Indices, Record, Triple, as_int64, generic, jit, jit_inline, jit_noinline
from hhsim.kernels.machine_code import call_code

CONTACT_ROWS = 4088
"""Most contacts; the paper's heaviest scenes have a few hundred. An odd number of cache lines, as the size of every
list: columns whole pages apart would evict each other in the cache."""

FULL = 1
"""Status: more pairs are near than the arrays hold, even without a skin."""


CONTACTS = np.dtype(
    [
        # 0 to 14 phalanx, 15 palm; in the joined records of `kernels.world`, BODY_COUNT times the pair is added
        ("body", np.int64, (CONTACT_ROWS,)),
        ("key", np.int64, (CONTACT_ROWS,)),  # identifies a pair across ticks, for warm starts
        ("point", np.float64, (3, CONTACT_ROWS)),  # on the hand's surface [m], in the frame of the pose
        ("normal", np.float64, (3, CONTACT_ROWS)),  # unit, from the object to the hand
        ("straight", np.float64, (3, CONTACT_ROWS)),  # unit vector along which the object is straight; zero for none
        ("distance", np.float64, (CONTACT_ROWS,)),  # signed [m], negative inside
        ("hand_radius", np.float64, (CONTACT_ROWS,)),  # of curvature at the contact [m], infinite on a face
        ("object_radius", np.float64, (CONTACT_ROWS,)),
        ("slides", np.int8, (CONTACT_ROWS,)),  # 1 if the phalanx's nearest point can slide along its axis
        ("start", np.int64, (FINGER_COUNT + 2,)),  # first record of the palm, of each finger, and the end
        ("phalanx_end", np.int64, (FINGER_COUNT, PHALANX_COUNT)),  # end of the records of each phalanx
    ],
    align=True,
)
"""Contact records: the solver's view of the object, for every kind of surface."""


FAR_SLACK = 4.0
"""Multiple of a walk's reach: a body with more slack when gathered has no lists that another walk would discard."""


@jit_inline
def _point(hand: HandArrays, pose: Record, body: int, i: int) -> Triple:
    """Return end i of a phalanx, or corner i of the palm's box [m], world."""
    if body < PALM_BODY:
        joint = pose.joints[body // PHALANX_COUNT, body % PHALANX_COUNT + i]
        return (joint[0], joint[1], joint[2])
    position, rotation, box = pose.position, pose.rotation, hand.palm_box
    x, y, z = box[i, 0], box[i, 1], box[i, 2]
    return (
        position[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        position[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        position[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@jit_inline
def follow_motion(hand: HandArrays, pose: Record, candidates: Record) -> None:
    """Reduce the slack of each body by its distance from where it was gathered."""
    for body in range(BODY_COUNT):
        gathered, before = candidates.gathered_slack[body], candidates.slack[body]
        candidates.slack_change[body] = np.inf
        if not -np.inf < gathered < np.inf:
            candidates.slack[body] = gathered
            continue
        most = 0.0
        for i in range(2 if body < PALM_BODY else BOX_CORNERS):
            x, y, z = _point(hand, pose, body, i)
            anchor = candidates.anchor[body, i]
            most = max(most, (x - anchor[0]) ** 2 + (y - anchor[1]) ** 2 + (z - anchor[2]) ** 2)
        candidates.slack[body] = gathered - math.sqrt(most)
        candidates.slack_change[body] = abs(candidates.slack[body] - before)


class ListDistances(NamedTuple):
    """Distances up to which pairs are to be known [m]."""

    needed: float  # now, less the allowed deficit
    margin: float  # the most that is ever needed
    skin: float  # added to the margin, so that lists last for several ticks


AHEAD = 0.5
"""A body may be gathered ahead once slack - needed is below this share of the skin, and of its slack when gathered."""
MANY_PAIRS = 64.0
STALE = 0.5
LASTING = 50.0
"""A body with more than MANY_PAIRS measured pairs may also be gathered ahead once it has moved by STALE of what is
needed, if it takes more than LASTING evaluations to move as far again: a fresh list has fewer pairs to measure."""


@jit_inline
def choose_gathers(reach: ListDistances, candidates: Record, work: Indices) -> None:
    """Mark the bodies to gather: those that must be; if none must, at most one ahead of need, due soonest or slow.

    Otherwise bodies that move together would be gathered in one tick, which would take many times as long as others. A
    tick that has gathered already gathers nothing ahead of need.
    """
    needed, margin, skin = reach
    candidates.needed = needed
    must = needed - candidates.allowed_deficit
    soonest, least = -1, np.inf
    stale, longest = -1, MANY_PAIRS
    for body in range(BODY_COUNT):
        # Far from the object a long step leaves little slack, which would bound the next one; a walk there is cheap.
        slack, gathered = candidates.slack[body], candidates.gathered_slack[body]
        due = slack < must or (gathered > FAR_SLACK * (margin + skin) and slack < 0.5 * gathered)
        candidates.due[body] = 1 if due else 0
        moved, count = gathered - slack, candidates.count[body]
        if due:
            least, longest = -np.inf, np.inf
        elif slack < least and moved > 0.0 and slack < needed + AHEAD * min(skin, gathered - needed):
            soonest, least = body, slack
        elif count > longest and moved > STALE * needed and LASTING * candidates.slack_change[body] < STALE * needed:
            stale, longest = body, count
    if work[COUNT_GATHERS] > 0:
        return
    if soonest >= 0 and least > -np.inf:
        candidates.due[soonest] = 2
    elif stale >= 0 and longest < np.inf:
        candidates.due[stale] = 2


@generic
def evaluate_pairs(
    surface: Any, hand: HandArrays, pose: Record, reach: ListDistances, candidates: Record, work: Indices
) -> int:
    """Do what `evaluate` says for a kind of surface; those that declare nothing are one rigid piece."""


@evaluate_pairs.of(object)
@jit_inline
def evaluate_rigid(
    surface: Any, hand: HandArrays, pose: Record, reach: ListDistances, candidates: Record, work: Indices
) -> int:
    """Do what `evaluate` says for a surface that is rigid."""
    follow_motion(hand, pose, candidates)
    choose_gathers(reach, candidates, work[:])
    walk, counted = Walk(candidates.stack[:], candidates.scratch[:], work[:]), work[:]
    status = 0
    for body in range(BODY_COUNT):
        if candidates.due[body] == 0:
            continue
        counted[COUNT_GATHERS] += 1
        if not gather_pairs(surface, hand, pose, body, reach.margin + reach.skin, candidates, walk):
            # The others continue, so that the outcome does not depend on the order.
            candidates.gathered_slack[body] = -np.inf
            status = FULL
            continue
        candidates.gathered_slack[body] = candidates.slack[body]
        for i in range(2 if body < PALM_BODY else BOX_CORNERS):
            anchor = candidates.anchor[body, i]
            anchor[0], anchor[1], anchor[2] = _point(hand, pose, body, i)
    for body in range(BODY_COUNT):
        if candidates.count[body] == 0:
            candidates.nearest[body] = np.inf
        else:
            candidates.nearest[body] = measure_pairs(surface, hand, pose, body, candidates)
            counted[COUNT_PAIR_TESTS] += candidates.count[body]
    return status


@jit_noinline
def evaluate(
    hand: HandArrays, pose: Record, surface: Any, reach: ListDistances, candidates: Record, work: Indices
) -> int:
    """Compute the distances of all near pairs at `pose`, whose kinematics are up to date; return 0, or FULL.

    Bodies whose slack is used up are gathered. Node tests, pair tests and gathers are counted in `work`.
    """
    return int(evaluate_pairs(surface, hand, pose, reach, candidates, work))


@jit
def count_pairs(surface: Any, hand: HandArrays, candidates: Record, limit: float) -> int:
    """Count the evaluated pairs that are at most `limit` [m] apart."""
    pairs = 0
    for body in range(BODY_COUNT):
        if candidates.nearest[body] <= limit:
            pairs += pairs_within(surface, hand, candidates, body, limit)
    return pairs


@jit_noinline
def find_contacts(
    surface: Any, hand: HandArrays, pose: Record, candidates: Record, margin: float, contacts: Record
) -> int:
    """Write contact records of all evaluated pairs within `margin` [m], palm first; return 0, or FULL."""
    row = as_int64(0)
    contacts.start[0] = 0
    if candidates.nearest[PALM_BODY] <= margin:
        row = record_pairs(surface, hand, pose, as_int64(PALM_BODY), candidates, margin, row, contacts)
        if row < 0:
            return FULL
    contacts.start[1] = row
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            body = PHALANX_COUNT * f + k
            contacts.phalanx_end[f, k] = row
            if candidates.nearest[body] > margin:
                continue
            row = record_pairs(surface, hand, pose, body, candidates, margin, row, contacts)
            if row < 0:
                return FULL
            contacts.phalanx_end[f, k] = row
        contacts.start[f + 2] = row
    return 0


@by_reference
class SurfaceCode(NamedTuple):
    """Machine code of `kernels.contact.detection` for a surface, by `code_of`, and the arrays that it is called with.

    Candidates are known by `SHARED_CANDIDATES` alone: those of each kind of surface begin with them.
    """

    evaluating: int  # of `evaluate`
    finding: int  # of `find_contacts`
    counting: int  # of `count_pairs`
    arrays: Any  # address of the arrays; where nothing is compiled the arrays themselves


@jit_noinline
def evaluate_surface(
    hand: HandArrays, pose: Record, surface: SurfaceCode, reach: ListDistances, candidates: Record, work: Indices
) -> int:
    """Do what `evaluate` does."""
    return call_code(surface.evaluating, (hand, pose, surface.arrays, reach, candidates, work[:]))


@jit_noinline
def find_surface_contacts(
    surface: SurfaceCode, hand: HandArrays, pose: Record, candidates: Record, margin: float, contacts: Record
) -> int:
    """Do what `find_contacts` does."""
    return call_code(surface.finding, (surface.arrays, hand, pose, candidates, margin, contacts))


@jit_inline
def pairs_near(surface: SurfaceCode, hand: HandArrays, candidates: Record, limit: float) -> tuple[int, int]:
    """Count the bodies and the pairs that are at most `limit` [m] from the surface."""
    bodies = 0
    for body in range(BODY_COUNT):
        if candidates.nearest[body] <= limit:
            bodies += 1
    return bodies, call_code(surface.counting, (surface.arrays, hand, candidates, limit)) if bodies > 0 else 0
