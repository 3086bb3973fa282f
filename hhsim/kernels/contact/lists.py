"""Lists of the pieces of a surface near the probes of a hand, in tiers of distance: gathered, measured, and recorded.

A probe is a phalanx or a sphere of the palm; each has its own stretch of the candidates, with a list for each kind of
piece that the surface has. Only the tiers that a probe may have reached are measured. Of the palm's spheres those are
gathered whose slack is used up, and a few that soon will be: the others' lists stay valid, and all of them at once
would take many times another tick.
"""

from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.contact.surface import (
    COUNT_NODE_TESTS,
    SHARED_CANDIDATES,
    Walk,
    holds,
    list_pieces,
    measure_pieces,
    pairs_within,
    record_pairs,
    record_pieces,
)
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT, HandArrays, phalanx_cone, placed_sphere
from hhsim.kernels.jit import Indices, Record, as_int64, jit, jit_inline
from hhsim.kernels.round_cone import RoundCone, count_within, least_distance
from hhsim.kernels.sphere_tree import STACK_SIZE, gather_pieces, tree_of

PALM_SPHERES = 1024
PROBES = PALM_BODY + PALM_SPHERES
"""Number of bodies with lists of their own: the phalanges, then the palm's spheres."""
PHALANX_CAPACITY = 4088
PALM_CAPACITY = 32768
CAPACITY = PALM_BODY * PHALANX_CAPACITY + PALM_CAPACITY
"""Most pieces of a kind near a phalanx, near the palm, and in all; the paper's heaviest scenes have a few hundred. Odd
numbers of cache lines, see `CONTACT_ROWS`."""
FOUND_CAPACITY = 4 * PHALANX_CAPACITY
"""Most pieces whose leaves are near a probe: more than are near themselves, if they are small."""
LINE = 8
"""Values in a cache line."""
LOOK_OUT = 3.0
"""Multiple of its reach up to which a probe that is near nothing searches, for a slack that lasts."""
SOON = 0.7
"""A sphere of the palm is soon due if its slack exceeds what is needed by less than this share of reach - needed."""
AHEAD_TESTS = 300
"""Node tests after which a tick with nothing else to gather gathers no more such spheres ahead of need."""
REACH_RATIO = 2.5
"""Least reach of a list as a multiple of what is needed, so that a fast hand's lasts for some ticks too."""
LONG_LIST, LONG_PALM_LIST = 512, 128
"""Most pieces of a kind in a list with a wide skin, of a phalanx and of a sphere of the palm: gathering stays fast on a
fine surface, and measuring."""
SKIN_SHARES = (1.0, 0.3, 0.1, 0.03, 0.01)
"""Reaches of a probe's list, tried in turn until it is no longer than that: shares of the way from what is needed to
the full reach. With the last one the list may be as long as fits."""
NEEDED_SHARES = (0.25, 0.06, 0.015)
"""Shares of what is needed, tried if even that does not fit; the steps are then as short."""
FEW = 8
"""After a list of less than a long one's pieces / FEW the next one tries the share before its last one."""
TIERS = 16
"""Tiers of a list, equally deep, from contact to the list's reach."""
NOWHERE = 1e300
"""Distance [m] of pieces of which none is nearest where the probe is."""
NO_DEPTH = 1e-12
"""Depth [m] of the tiers of a list that holds only pieces that are penetrated: all are in the first one."""


def list_fields(kinds: int) -> list[Any]:
    """Return the fields of the candidates of a surface with pieces of so many kinds."""
    return [
        *SHARED_CANDIDATES,
        ("piece", np.int64, (kinds, CAPACITY)),  # pieces near the probes, by their numbers
        ("distance", np.float64, (kinds, CAPACITY)),  # signed [m]; while a list is made the least motion to each piece
        ("parameter", np.float64, (kinds, CAPACITY)),  # where on a phalanx's axis the nearest sphere is
        ("start", np.int64, (PROBES,)),  # of each probe's stretch
        ("listed", np.int64, (PROBES,)),  # number of pieces of all kinds in the lists of each probe
        ("tier_end", np.int64, (PROBES, kinds, TIERS)),  # number of pieces up to each tier's end
        ("tier_depth", np.float64, (PROBES,)),  # depth of a tier [m]
        ("measured", np.int64, (PROBES, kinds)),  # number of pieces measured: the first ones
        ("own", np.float64, (PROBES,)),  # slack of each probe when it was gathered [m]
        ("extra_slack", np.float64, (PROBES,)),  # slack of each of the palm's spheres beyond that of the palm [m]
        ("least", np.float64, (PROBES,)),  # least distance of each probe [m]
        ("skin_share", np.int64, (PROBES,)),  # index in `SKIN_SHARES` of each probe's last gathering
        ("scratch", np.int64, (2 * FOUND_CAPACITY,)),  # workspace of a walk, as the next
        ("stack", np.int64, (STACK_SIZE,)),
    ]


class Probe(NamedTuple):
    """A phalanx or a sphere of the palm, for which pieces are listed."""

    number: int
    cone: RoundCone
    start: int  # of its stretch of the candidates


@jit_inline
def _probe(hand: HandArrays, pose: Record, number: int, candidates: Record) -> Probe:
    start = candidates.start[number]
    if number < PALM_BODY:
        cone = phalanx_cone(hand, pose.joints[:], pose.direction[:], number // PHALANX_COUNT, number % PHALANX_COUNT)
        x, y, z, ux, uy, uz, length, slope, inverse, radius, drop = cone
        length, drop = length if inverse > 0.0 else 0.0, drop if inverse > 0.0 else 0.0
        return Probe(number, RoundCone(x, y, z, ux, uy, uz, length, slope, inverse, radius, drop), start)
    i = number - PALM_BODY
    x, y, z, radius = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i], hand.palm_radius[i]
    return Probe(number, placed_sphere(pose.position[:], pose.rotation[:], x, y, z, radius), start)


@jit_inline
def _probes(hand: HandArrays, body: int) -> tuple[int, int]:
    """Return the first probe of a body, and the one after its last."""
    return body, (body + 1 if body < PALM_BODY else PALM_BODY + hand.palm_radius.shape[0])


@jit_inline
def _tier_of(near: float, depth: float) -> int:
    return int(min(max(near / depth, 0.0), TIERS - 0.5))


@jit
def put_in_order(number: int, kind: int, start: int, stop: int, candidates: Record, scratch: Indices) -> None:
    """Sort the pieces [start, stop) of a kind, listed for a probe by its number, by tiers; write the tiers' ends."""
    near, piece, end = candidates.distance[kind], candidates.piece[kind], candidates.tier_end[number, kind]
    depth = candidates.tier_depth[number]
    for t in range(TIERS):
        end[t] = 0
    for i in range(start, stop):
        end[_tier_of(near[i], depth)] += 1
    before = 0
    for t in range(TIERS):
        before += end[t]
        end[t] = before - end[t]
    for i in range(start, stop):
        scratch[i - start] = piece[i]
    for i in range(start, stop):
        t = _tier_of(near[i], depth)
        piece[start + end[t]] = scratch[i - start]
        end[t] += 1


@jit_inline
def _gather_probe(
    surface: Any, hand: HandArrays, pose: Record, number: int, reach: float, candidates: Record, walk: Walk
) -> float:
    """List the pieces of a probe as far as they fit; return its slack [m], a negative infinity if none do."""
    capacity = PHALANX_CAPACITY
    if number >= PALM_BODY:
        capacity = LINE * ((min(PHALANX_CAPACITY, PALM_CAPACITY // hand.palm_radius.shape[0]) // LINE - 1) | 1)
    candidates.start[number] = min(number, PALM_BODY) * PHALANX_CAPACITY + max(number - PALM_BODY, 0) * capacity
    probe = _probe(hand, pose, number, candidates)
    needed, last = candidates.needed, len(SKIN_SHARES) - 1
    long = LONG_LIST if number < PALM_BODY else LONG_PALM_LIST
    reach = max(reach, REACH_RATIO * needed)
    is_far = candidates.listed[number] == 0
    slack = -np.inf
    for k in range(candidates.skin_share[number], len(SKIN_SHARES) + len(NEEDED_SHARES)):
        if k <= last:
            goal = needed + SKIN_SHARES[k] * max(reach - needed, 0.0)
        else:
            goal = NEEDED_SHARES[k - len(SKIN_SHARES)] * needed
        most, found = (min(long, capacity), 2 * long) if k < last else (capacity, FOUND_CAPACITY)
        look_out = LOOK_OUT * goal if is_far and candidates.own[number] > goal else goal
        candidates.tier_depth[number] = max(goal / TIERS, NO_DEPTH)
        slack = list_pieces(surface, probe, most, found, goal, look_out, candidates, walk)
        if slack > -np.inf:
            pieces = 0
            for kind in range(candidates.tier_end.shape[1]):
                pieces += candidates.tier_end[number, kind, TIERS - 1]
            candidates.listed[number] = pieces
            # After a short list the reach may be longer the next time.
            candidates.skin_share[number] = max(k - 1, 0) if FEW * pieces < long else k
            candidates.own[number], candidates.least[number] = slack, np.inf
            break
    return slack


@jit_inline
def gather_pairs(
    surface: Any, hand: HandArrays, pose: Record, body: int, reach: float, candidates: Record, walk: Walk
) -> bool:
    """List the pieces near one body up to `reach` [m], and set its count and slack; False if there is no room."""
    if hand.palm_radius.shape[0] > PALM_SPHERES:
        return False
    is_palm, palm, groups = body == PALM_BODY, hand.palm_group, hand.palm_group_start
    extra, used, needed = candidates.extra_slack, candidates.slack[body], candidates.needed
    must = needed - candidates.allowed_deficit
    if not is_palm or (candidates.due[body] == 1 and used >= must):
        # A palm that is due before its slack is used up is far from the object, where a walk is cheap.
        must = np.inf
    soon = needed + SOON * (reach - needed)
    spent = walk.work
    last_test = spent[COUNT_NODE_TESTS] + (AHEAD_TESTS if is_palm and candidates.due[body] == 2 else 0)
    total = 0
    slack = np.inf
    for group in range(groups.shape[0] - 1 if is_palm else 1):
        first, last = PALM_BODY + groups[group], PALM_BODY + groups[group + 1]
        if not is_palm:
            first, last = body, body + 1
        due, near, clear = 0, 0, -np.inf
        for number in range(first, last):
            due += 0 if used + extra[number] > (soon if spent[COUNT_NODE_TESTS] < last_test else must) else 1
            near += candidates.listed[number]
        if due > 1 and near == 0:
            # If the sphere around a group is near nothing, nor is any of them; the walk ends at the first piece.
            x, y, z, radius = palm[0, group], palm[1, group], palm[2, group], palm[3, group]
            cone, none = placed_sphere(pose.position[:], pose.rotation[:], x, y, z, radius), walk.scratch[:0]
            tree, far = tree_of(surface), LOOK_OUT * reach
            count, clearance, tests = gather_pieces(tree, cone, reach, far, walk.stack, none)
            walk.work[COUNT_NODE_TESTS] += tests
            clear = clearance if count == 0 else -np.inf
        for number in range(first, last):
            own = used + extra[number]
            if clear > -np.inf:
                own = own if own > clear else clear
            elif not own > (soon if spent[COUNT_NODE_TESTS] < last_test else must):
                own = _gather_probe(surface, hand, pose, number, reach, candidates, walk)
                if own == -np.inf:
                    # Slacks of spheres gathered anew and before are relative to different references.
                    candidates.slack[body] = -np.inf
                    return False
            extra[number] = own
            slack = min(slack, own)
            total += candidates.listed[number]
    first, last = _probes(hand, body)
    for number in range(first, last):
        extra[number] = extra[number] - slack if extra[number] < np.inf else np.inf
    candidates.count[body] = total
    candidates.slack[body] = slack
    return True


@jit_inline
def _measure_probe(surface: Any, probe: Probe, slack: float, enough: float, candidates: Record) -> float:
    """Measure what may be within what is needed, and on until nothing else can be nearer, or than `enough` [m].

    Returns the least distance [m].
    """
    number, cone, start = probe
    own, needed, depth = candidates.own[number], candidates.needed, candidates.tier_depth[number]
    # How far the probe has moved at most since it was listed.
    moved = own - slack if own < np.inf else np.inf
    ends, measured = candidates.tier_end[number], candidates.measured[number]
    for kind in range(measured.shape[0]):
        measured[kind] = 0
    least, tier, goal = np.inf, as_int64(0), needed
    while True:
        tier = max(tier + 1, int(min((goal + moved) / depth, TIERS - 1.0)) + 1)
        for kind in range(measured.shape[0]):
            first, stop = start + measured[kind], start + ends[kind, tier - 1]
            if first < stop:
                measure_pieces(surface, kind, cone, first, stop, candidates)
                least = min(least, least_distance(candidates.distance[kind], first, stop))
            measured[kind] = ends[kind, tier - 1]
        left, nearest = tier * depth - moved, min(least, enough)
        if tier == TIERS or (left > needed and left >= nearest):
            return least
        goal = max(needed, nearest) if nearest < NOWHERE else needed


@jit_inline
def measure_pairs(surface: Any, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    """Return a body's least signed distance [m]; pieces that are not measured are beyond it and `needed`."""
    least, count = np.inf, 0
    first, last = _probes(hand, body)
    for number in range(first, last):
        if candidates.listed[number] > 0:
            probe = _probe(hand, pose, number, candidates)
            slack = candidates.slack[body] + candidates.extra_slack[number]
            # A point may be inside, which its nearest piece tells; a body's axis never comes there.
            is_point = probe.cone.radius == 0.0
            nearest = _measure_probe(surface, probe, slack, np.inf if is_point else least, candidates)
            if is_point and holds(surface, probe, candidates):
                nearest = -nearest
            candidates.least[number] = nearest
            for kind in range(candidates.measured.shape[1]):
                count += candidates.measured[number, kind]
            least = min(least, nearest)
    candidates.count[body] = count
    return least


@pairs_within.of(object)
@jit_inline
def _within(surface: Any, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    within = 0
    first, last = _probes(hand, body)
    for number in range(first, last):
        if candidates.least[number] <= limit:
            start = candidates.start[number]
            for kind in range(candidates.measured.shape[1]):
                stop = start + candidates.measured[number, kind]
                within += count_within(candidates.distance[kind], start, stop, limit)
    return within


@record_pairs.of(object)
@jit_inline
def _record(
    surface: Any,
    hand: HandArrays,
    pose: Record,
    body: int,
    candidates: Record,
    limit: float,
    row: int,
    contacts: Record,
) -> int:
    first, last = _probes(hand, body)
    for number in range(first, last):
        if candidates.least[number] <= limit:
            begin = row
            probe = _probe(hand, pose, number, candidates)
            row = record_pieces(surface, probe, pose, candidates, limit, row, contacts)
            if row < 0:
                return -1
            for i in range(begin, row):
                contacts.body[i] = body
    return row
