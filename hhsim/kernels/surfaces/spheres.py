"""Contacts with the leaf spheres of the object's sphere tree, as in the paper."""

import math
from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
from numba import from_dtype
from numba.extending import intrinsic

from hhsim.kernels.contact.detection import COUNT_NODE_TESTS
from hhsim.kernels.contact.surface import (
    SHARED_CANDIDATES,
    TIERS,
    ContactPoints,
    Surface,
    Walk,
    cone_contacts,
    cone_distance,
    gather_pairs,
    measure_pairs,
    moved_since,
    next_tier,
    pairs_within,
    record_pairs,
    start_tiers,
    tier_depth,
    tier_of,
)
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT, HandArrays, phalanx_cone, placed_sphere
from hhsim.kernels.jit import Array, Indices, Record, as_index, as_int64, jit, jit_inline
from hhsim.kernels.round_cone import (
    RoundCone,
    Spheres,
    count_within,
    least_distance,
    round_cone_distances,
    round_cone_parameter,
    sphere_pair_distances,
)
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_pieces, nearest_piece, node_distance

Triple: TypeAlias = tuple[float, float, float]

PHALANX_PAIRS = 4088
PALM_SLOTS = 8
SLOT_PAIRS = 4088
PALM_PAIRS = PALM_SLOTS * SLOT_PAIRS
"""Most near pairs of a phalanx, and of the palm; the paper's heaviest scenes have a few hundred. The palm's spheres are
gathered by slots, each when its own slack is used up: all of them at once would take many times another tick."""
LISTS = PALM_BODY + PALM_SLOTS
"""Number of lists of pairs: of the phalanges, then of the palm's slots, each with its own stretch of the arrays."""
NODES = 1 << 32
"""More than the nodes of any tree: sphere and node of a palm pair are one integer while its slot is gathered."""
LONG_LIST = 1024
"""Most pairs of a slot's list that has a wide skin: long lists take long to measure."""
SKIN_SHARES = (1.0, 0.5, 0.25, 0.0)
"""Reaches of a slot's list, tried in turn until it is no longer than LONG_LIST: shares of the way from what is needed
to the full reach. From the last but one on the list may be as long as fits: without a skin the next tick uses it up."""
FEW = 4
"""A slot with at most LONG_LIST / FEW pairs tries the share before its last one the next time."""

CANDIDATES = np.dtype(
    [
        *SHARED_CANDIDATES,
        ("x", np.float64, (PALM_BODY, PHALANX_PAIRS)),  # object spheres near each phalanx [m], world
        ("y", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("z", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("radius", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("leaf", np.int64, (PALM_BODY, PHALANX_PAIRS)),  # their node in the tree
        ("distance", np.float64, (PALM_BODY, PHALANX_PAIRS)),  # signed [m]
        ("parameter", np.float64, (PALM_BODY, PHALANX_PAIRS)),  # on the axis, of the nearest sphere
        ("hand_x", np.float64, (PALM_PAIRS,)),  # palm sphere of each palm pair [m], palm frame
        ("hand_y", np.float64, (PALM_PAIRS,)),
        ("hand_z", np.float64, (PALM_PAIRS,)),
        ("hand_radius", np.float64, (PALM_PAIRS,)),
        ("object_x", np.float64, (PALM_PAIRS,)),  # object sphere of each palm pair [m], world
        ("object_y", np.float64, (PALM_PAIRS,)),
        ("object_z", np.float64, (PALM_PAIRS,)),
        ("object_radius", np.float64, (PALM_PAIRS,)),
        ("palm_sphere", np.int64, (PALM_PAIRS,)),  # their indices
        ("palm_leaf", np.int64, (PALM_PAIRS,)),
        ("palm_distance", np.float64, (PALM_PAIRS,)),  # signed [m]
        ("tier_end", np.int64, (LISTS, TIERS)),  # number of pairs up to each tier's end
        ("tier_depth", np.float64, (LISTS,)),  # depth of a tier [m]
        ("measured", np.int64, (LISTS,)),  # number of pairs measured: the first ones
        ("palm_own", np.float64, (PALM_SLOTS,)),  # slack of each slot when it was gathered [m]
        ("palm_extra_slack", np.float64, (PALM_SLOTS,)),  # slack of each slot beyond that of the palm [m]
        ("palm_least", np.float64, (PALM_SLOTS,)),  # least distance of each slot [m]
        ("palm_skin_share", np.int64, (PALM_SLOTS,)),  # index in `SKIN_SHARES` of each slot's last gathering
        ("scratch", np.int64, (PHALANX_PAIRS,)),  # workspace of a walk, as the next
        ("stack", np.int64, (STACK_SIZE,)),
    ],
    align=True,
)
"""Gathered pairs and their distances."""


def _declare(typing: Any, shared: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.bitcast(given[0], context.get_value_type(signature.return_type))

    return from_dtype(CANDIDATES)(shared), generate


sphere_candidates = cast(Callable[[Record], Record], intrinsic(_declare))
"""Return the `CANDIDATES` that begin with these, of a tick's state, which every kind of surface has."""


@jit_inline
def _leaf_distances(tree: TreeArrays, cone: RoundCone, leaves: Indices, count: int, distance_out: Array) -> None:
    for i in range(count):
        distance_out[i] = node_distance(tree, cone, as_index(leaves[i]))


@jit_inline
def _listed(candidates: Record, which: int) -> int:
    return int(candidates.tier_end[which, TIERS - 1])


@jit_inline
def write_palm_pair(
    candidates: Record, place: int, x: float, y: float, z: float, radius: float, tree: TreeArrays, node: int
) -> None:
    """Write a pair of a sphere of the palm, by its centre and radius [m], palm frame, and a node of the tree."""
    candidates.hand_x[place], candidates.hand_y[place], candidates.hand_z[place] = x, y, z
    candidates.hand_radius[place] = radius
    candidates.object_x[place] = tree.x[node]
    candidates.object_y[place] = tree.y[node]
    candidates.object_z[place] = tree.z[node]
    candidates.object_radius[place] = tree.radius[node]


@jit
def _list_slot(
    tree: TreeArrays,
    hand: HandArrays,
    slot: int,
    total: int,
    depth: float,
    near: Array,
    pair: Indices,
    candidates: Record,
    scratch: Indices,
) -> None:
    """Write the pairs of a slot in the order of their tiers."""
    ends = candidates.tier_end[PALM_BODY + slot]
    start_tiers(near, total, depth, ends)
    for i in range(total):
        scratch[i] = pair[i]
    for i in range(total):
        sphere, node, tier = scratch[i] // NODES, scratch[i] % NODES, tier_of(near[i], depth)
        place = slot * SLOT_PAIRS + ends[tier]
        ends[tier] += 1
        hx, hy, hz, radius = hand.palm_x[sphere], hand.palm_y[sphere], hand.palm_z[sphere], hand.palm_radius[sphere]
        write_palm_pair(candidates, place, hx, hy, hz, radius, tree, node)
        candidates.palm_sphere[place] = sphere
        candidates.palm_leaf[place] = node
    candidates.tier_depth[PALM_BODY + slot] = depth


@jit_inline
def _gather_slot(
    tree: TreeArrays, hand: HandArrays, pose: Record, slot: int, reach: float, most: int, candidates: Record, walk: Walk
) -> float:
    """List the pairs of a slot; return its slack [m], a negative infinity if they do not fit."""
    spheres, start = hand.palm_radius.shape[0], slot * SLOT_PAIRS
    near, pair = candidates.palm_distance[start : start + SLOT_PAIRS], candidates.palm_leaf[start : start + SLOT_PAIRS]
    total, slack = as_int64(0), np.inf
    for sphere in range(slot * spheres // PALM_SLOTS, (slot + 1) * spheres // PALM_SLOTS):
        hx, hy, hz = hand.palm_x[sphere], hand.palm_y[sphere], hand.palm_z[sphere]
        cone = placed_sphere(pose.position[:], pose.rotation[:], hx, hy, hz, hand.palm_radius[sphere])
        count, clearance, tests = gather_pieces(tree, cone, reach, reach, walk.stack, walk.scratch)
        walk.work[COUNT_NODE_TESTS] += tests
        slack = min(slack, clearance)
        if count < 0 or total + count > most:
            return -np.inf
        _leaf_distances(tree, cone, walk.scratch, count, near[total:])
        for i in range(count):
            pair[total + i] = sphere * NODES + walk.scratch[i]
        total += count
    _list_slot(tree, hand, slot, total, tier_depth(reach), near, pair, candidates, walk.scratch)
    return slack


@jit
def _gather_palm(
    tree: TreeArrays, hand: HandArrays, pose: Record, reach: float, candidates: Record, walk: Walk
) -> bool:
    """Gather the slots that need it, or that soonest will; far from the object, where a walk is cheap, all."""
    extra, used, share = candidates.palm_extra_slack, candidates.slack[PALM_BODY], candidates.palm_skin_share
    needed, least = candidates.needed - candidates.allowed_deficit, min(candidates.needed, reach)
    soonest = as_int64(-1)
    if candidates.due[PALM_BODY] == 2:
        soonest = as_int64(0)
        for slot in range(PALM_SLOTS):
            soonest = slot if extra[slot] < extra[soonest] else soonest
    every = soonest < 0 and used >= needed
    total = 0
    slack = np.inf
    for slot in range(PALM_SLOTS):
        own = used + extra[slot]
        if every or slot == soonest or not own >= needed:
            own = -np.inf
            for k in range(share[slot], len(SKIN_SHARES)):
                most = LONG_LIST if k < len(SKIN_SHARES) - 2 else SLOT_PAIRS
                limit = least + SKIN_SHARES[k] * (reach - least)
                own = _gather_slot(tree, hand, pose, slot, limit, most, candidates, walk)
                if own > -np.inf:
                    share[slot] = max(k - 1, 0) if FEW * _listed(candidates, PALM_BODY + slot) <= LONG_LIST else k
                    candidates.palm_own[slot] = own
                    break
            if own == -np.inf:
                # Slacks of slots gathered anew and before are relative to different references.
                candidates.slack[PALM_BODY] = -np.inf
                return False
        extra[slot] = own
        slack = min(slack, own)
        total += _listed(candidates, PALM_BODY + slot)
    for slot in range(PALM_SLOTS):
        extra[slot] = extra[slot] - slack if extra[slot] < np.inf else np.inf
    candidates.count[PALM_BODY] = total
    candidates.slack[PALM_BODY] = slack
    return True


@gather_pairs.of(TreeArrays)
@jit_inline
def _gather(
    tree: TreeArrays, hand: HandArrays, pose: Record, body: int, reach: float, candidates: Record, walk: Walk
) -> bool:
    if body >= PALM_BODY:
        return _gather_palm(tree, hand, pose, reach, candidates, walk)
    cone = phalanx_cone(hand, pose.joints[:], pose.direction[:], body // PHALANX_COUNT, body % PHALANX_COUNT)
    count, clearance, tests = gather_pieces(tree, cone, reach, reach, walk.stack, walk.scratch)
    walk.work[COUNT_NODE_TESTS] += tests
    if count < 0:
        return False
    near, depth, ends = candidates.distance[body], tier_depth(reach), candidates.tier_end[body]
    _leaf_distances(tree, cone, walk.scratch, count, near)
    start_tiers(near, count, depth, ends)
    for i in range(count):
        node, tier = walk.scratch[i], tier_of(near[i], depth)
        place = ends[tier]
        ends[tier] += 1
        candidates.leaf[body, place] = node
        candidates.x[body, place] = tree.x[node]
        candidates.y[body, place] = tree.y[node]
        candidates.z[body, place] = tree.z[node]
        candidates.radius[body, place] = tree.radius[node]
    candidates.tier_depth[body] = depth
    candidates.count[body] = count
    candidates.slack[body] = clearance
    return True


@jit
def _measure_phalanx(hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    cone = phalanx_cone(hand, pose.joints[:], pose.direction[:], body // PHALANX_COUNT, body % PHALANX_COUNT)
    x, y, z, radius = candidates.x[body], candidates.y[body], candidates.z[body], candidates.radius[body]
    distance, parameter = candidates.distance[body], candidates.parameter[body]
    moved = moved_since(candidates.gathered_slack[body], candidates.slack[body])
    first, tier, least = as_int64(0), as_int64(0), np.inf
    while True:
        after = next_tier(tier, candidates.tier_depth[body], moved, candidates.needed, least)
        if after == tier:
            break
        tier, stop = after, candidates.tier_end[body, after - 1]
        if first < stop:
            near = Spheres(x[first:stop], y[first:stop], z[first:stop], radius[first:stop])
            round_cone_distances(near, stop - first, cone, distance[first:stop], parameter[first:stop])
            least = min(least, least_distance(distance, first, stop))
        first = stop
    candidates.measured[body] = candidates.count[body] = first
    return least


@jit
def _measure_slot(pose: Record, slot: int, slack: float, candidates: Record) -> float:
    which, start = PALM_BODY + slot, slot * SLOT_PAIRS
    moved = moved_since(candidates.palm_own[slot], slack)
    first, tier, least = as_int64(0), as_int64(0), np.inf
    while True:
        after = next_tier(tier, candidates.tier_depth[which], moved, candidates.needed, least)
        if after == tier:
            break
        tier, stop = after, candidates.tier_end[which, after - 1]
        if first < stop:
            a, b = start + first, start + stop
            x, y, z = candidates.hand_x[a:b], candidates.hand_y[a:b], candidates.hand_z[a:b]
            palm = Spheres(x, y, z, candidates.hand_radius[a:b])
            x, y, z = candidates.object_x[a:b], candidates.object_y[a:b], candidates.object_z[a:b]
            leaves = Spheres(x, y, z, candidates.object_radius[a:b])
            distance = candidates.palm_distance[a:b]
            sphere_pair_distances(palm, leaves, stop - first, pose.position[:], pose.rotation[:], distance)
            least = min(least, least_distance(distance, as_int64(0), stop - first))
        first = stop
    candidates.measured[which] = first
    candidates.palm_least[slot] = least
    return least


@measure_pairs.of(TreeArrays)
@jit_inline
def _measure(tree: TreeArrays, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    if body < PALM_BODY:
        return _measure_phalanx(hand, pose, body, candidates)
    least, count = np.inf, as_int64(0)
    for slot in range(PALM_SLOTS):
        slack = candidates.slack[PALM_BODY] + candidates.palm_extra_slack[slot]
        least = min(least, _measure_slot(pose, slot, slack, candidates))
        count += candidates.measured[PALM_BODY + slot]
    candidates.count[PALM_BODY] = count
    return least


@pairs_within.of(TreeArrays)
@jit_inline
def _within(tree: TreeArrays, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    if body < PALM_BODY:
        return count_within(candidates.distance[body], as_int64(0), candidates.measured[body], limit)
    within = 0
    for slot in range(PALM_SLOTS):
        if candidates.palm_least[slot] <= limit:
            start = slot * SLOT_PAIRS
            stop = start + candidates.measured[PALM_BODY + slot]
            within += count_within(candidates.palm_distance[:], start, stop, limit)
    return within


@jit_inline
def write_contact(
    contacts: Record, row: int, center: Triple, radius: float, normal: Triple, distance: float, hand_radius: float
) -> None:
    """Write the geometry of a contact with a sphere of the object, by its centre and radius [m]."""
    reach = radius + distance
    for j in range(3):
        contacts.normal[j, row] = normal[j]
        contacts.point[j, row] = center[j] + reach * normal[j]
        contacts.straight[j, row] = 0.0
    contacts.distance[row] = distance
    contacts.hand_radius[row] = hand_radius
    contacts.object_radius[row] = radius


@jit
def _palm_contacts(
    tree: TreeArrays, pose: Record, slot: int, candidates: Record, margin: float, row: int, contacts: Record
) -> int:
    hand_x, hand_y, hand_z = candidates.hand_x, candidates.hand_y, candidates.hand_z
    object_x, object_y, object_z = candidates.object_x, candidates.object_y, candidates.object_z
    hand_radius, object_radius = candidates.hand_radius, candidates.object_radius
    distance, sphere, leaf = candidates.palm_distance, candidates.palm_sphere, candidates.palm_leaf
    position, rotation, leaf_total = pose.position, pose.rotation, tree.radius.shape[0]
    px, py, pz = position[0], position[1], position[2]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    start = slot * SLOT_PAIRS
    for i in range(start, start + candidates.measured[PALM_BODY + slot]):
        d = distance[i]
        if d > margin:
            continue
        if row >= contacts.key.shape[0]:
            return -1
        hx, hy, hz = hand_x[i], hand_y[i], hand_z[i]
        nx = px + r00 * hx + r01 * hy + r02 * hz - object_x[i]
        ny = py + r10 * hx + r11 * hy + r12 * hz - object_y[i]
        nz = pz + r20 * hx + r21 * hy + r22 * hz - object_z[i]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0.0:
            scale = 1.0 / length
            nx, ny, nz = nx * scale, ny * scale, nz * scale
        else:
            # Concentric spheres: any direction is as good, and the hand can retreat out of its back.
            nx, ny, nz = r02, r12, r22
        center, normal = (object_x[i], object_y[i], object_z[i]), (nx, ny, nz)
        write_contact(contacts, row, center, object_radius[i], normal, d, hand_radius[i])
        contacts.body[row] = PALM_BODY
        contacts.key[row] = (PALM_BODY + sphere[i]) * leaf_total + leaf[i]
        contacts.slides[row] = 0
        row += 1
    return row


@record_pairs.of(TreeArrays)
@jit_inline
def _record(
    tree: TreeArrays,
    hand: HandArrays,
    pose: Record,
    body: int,
    candidates: Record,
    limit: float,
    row: int,
    contacts: Record,
) -> int:
    if body == PALM_BODY:
        for slot in range(PALM_SLOTS):
            if candidates.palm_least[slot] <= limit:
                row = _palm_contacts(tree, pose, slot, candidates, limit, row, contacts)
                if row < 0:
                    return -1
        return row
    f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
    x, y, z, radius = candidates.x[body], candidates.y[body], candidates.z[body], candidates.radius[body]
    distance, parameter, leaf = candidates.distance[body], candidates.parameter[body], candidates.leaf[body]
    joint, direction = pose.joints[f, k], pose.direction[f, k]
    rotation, leaf_total = pose.rotation, tree.radius.shape[0]
    length, radius_a = hand.length[f, k], hand.radius[f, k]
    radius_drop = hand.radius[f, k] - hand.radius[f, k + 1]
    jx, jy, jz = joint[0], joint[1], joint[2]
    ux, uy, uz = length * direction[0], length * direction[1], length * direction[2]
    for i in range(candidates.measured[body]):
        d = distance[i]
        if d > limit:
            continue
        if row >= contacts.key.shape[0]:
            return -1
        s = parameter[i]
        cx, cy, cz = x[i], y[i], z[i]
        nx, ny, nz = jx + s * ux - cx, jy + s * uy - cy, jz + s * uz - cz
        square = nx * nx + ny * ny + nz * nz
        if square > 0.0:
            scale = 1.0 / math.sqrt(square)
            nx, ny, nz = nx * scale, ny * scale, nz * scale
        else:
            nx, ny, nz = rotation[0, 2], rotation[1, 2], rotation[2, 2]
        write_contact(contacts, row, (cx, cy, cz), radius[i], (nx, ny, nz), d, radius_a - s * radius_drop)
        contacts.body[row] = body
        contacts.key[row] = body * leaf_total + leaf[i]
        contacts.slides[row] = 1 if 0.0 < s < 1.0 else 0
        row += 1
    return row


@cone_contacts.of(TreeArrays)
@jit
def _cone_contacts(
    tree: TreeArrays, cone: RoundCone, limit: float, walk: Walk, row: int, pairs_out: ContactPoints
) -> tuple[int, float]:
    found, clearance, _ = gather_pieces(tree, cone, limit, limit, walk.stack, walk.scratch)
    if found < 0 or row + found > pairs_out.tick.shape[0]:
        return -1, 0.0
    for i in range(found):
        leaf = walk.scratch[i]
        dx, dy, dz = tree.x[leaf] - cone.x, tree.y[leaf] - cone.y, tree.z[leaf] - cone.z
        s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
        qx, qy, qz = dx - s * cone.length * cone.ux, dy - s * cone.length * cone.uy, dz - s * cone.length * cone.uz
        away = math.sqrt(qx * qx + qy * qy + qz * qz)
        # A leaf centred on the axis has no nearest point; any is as good.
        inverse = 1.0 / away if away > 0.0 else 0.0
        share = (cone.radius - s * cone.drop) * inverse
        pairs_out.point[row, 0] = tree.x[leaf] - qx + share * qx
        pairs_out.point[row, 1] = tree.y[leaf] - qy + share * qy
        pairs_out.point[row, 2] = tree.z[leaf] - qz + share * qz
        pairs_out.normal[row, 0] = -inverse * qx
        pairs_out.normal[row, 1] = -inverse * qy
        pairs_out.normal[row, 2] = -inverse * qz
        row += 1
    return row, clearance


@cone_distance.of(TreeArrays)
@jit
def _cone_distance(tree: TreeArrays, cone: RoundCone, limit: float, stack: Indices) -> float:
    return nearest_piece(tree, cone, limit, stack)[0]


def _center(tree: TreeArrays) -> Array:
    return np.array([tree.x[0], tree.y[0], tree.z[0]])


SURFACE = Surface(
    summary="the leaf spheres of the object's sphere tree",
    arrays=TreeArrays,
    candidates=CANDIDATES,
    center=_center,
    coarser="a coarser sphere tree",
)
