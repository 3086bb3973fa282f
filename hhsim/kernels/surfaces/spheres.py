"""The leaf spheres of the object's sphere tree, as in the paper."""

import math

import numpy as np

from hhsim.kernels.contact.detection import COUNT_NODE_TESTS
from hhsim.kernels.contact.surface import (
    SHARED_CANDIDATES,
    ContactPoints,
    Surface,
    Walk,
    cone_contacts,
    cone_distance,
    gather_pairs,
    measure_pairs,
    pairs_within,
    record_pairs,
)
from hhsim.kernels.contact.tiers import TIERS, moved_since, next_tier, start_tiers, tier_depth, tier_of
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline, jit_once, jit_vector
from hhsim.kernels.round_cone_distance import (
    RoundCone,
    Spheres,
    round_cone_distances,
    round_cone_parameter,
    sphere_cone,
    sphere_pair_distances,
)
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_round_cone, nearest_leaf_round_cone, node_distance

PHALANX_PAIRS = 4088
PALM_SLOTS = 8
SLOT_PAIRS = 4088
PALM_PAIRS = PALM_SLOTS * SLOT_PAIRS
"""Room for the near pairs of a phalanx, and of the palm; the paper's heaviest scenes have a few hundred.

The palm's spheres are gathered by slots, each when its own slack is used up: all of them at once would take many times
another tick.
"""
LISTS = PALM_BODY + PALM_SLOTS
"""Lists of pairs: the phalanges', then those of the palm's slots."""
CROWD = 1024
SHARES = (1.0, 0.5, 0.25, 0.0)
"""Where more pairs of a slot than a crowd are within the reach, those up to the next share of the way from what is
needed to that reach are listed: a crowd takes long to measure. From the last but one on there may be as many as there
is room for: what reaches no further than what is needed is used up by the next tick."""
NODES = 1 << 32
"""More than the nodes of any tree: a pair's sphere and node are one number while its slot is gathered."""
FEW = 4
"""A slot with no more pairs than this part of a crowd may reach further the next time."""

CANDIDATES = np.dtype(
    [
        ("x", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("y", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("z", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("radius", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("leaf", np.int64, (PALM_BODY, PHALANX_PAIRS)),
        ("distance", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("parameter", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("hand_x", np.float64, (PALM_PAIRS,)),
        ("hand_y", np.float64, (PALM_PAIRS,)),
        ("hand_z", np.float64, (PALM_PAIRS,)),
        ("hand_radius", np.float64, (PALM_PAIRS,)),
        ("object_x", np.float64, (PALM_PAIRS,)),
        ("object_y", np.float64, (PALM_PAIRS,)),
        ("object_z", np.float64, (PALM_PAIRS,)),
        ("object_radius", np.float64, (PALM_PAIRS,)),
        ("palm_sphere", np.int64, (PALM_PAIRS,)),
        ("palm_leaf", np.int64, (PALM_PAIRS,)),
        ("palm_distance", np.float64, (PALM_PAIRS,)),
        ("tier_end", np.int64, (LISTS, TIERS)),
        ("tier_depth", np.float64, (LISTS,)),
        ("measured", np.int64, (LISTS,)),
        ("palm_own", np.float64, (PALM_SLOTS,)),
        ("palm_spare", np.float64, (PALM_SLOTS,)),
        ("palm_least", np.float64, (PALM_SLOTS,)),
        ("palm_share", np.int64, (PALM_SLOTS,)),
        *SHARED_CANDIDATES,
        ("scratch", np.int64, (PHALANX_PAIRS,)),
        ("stack", np.int64, (STACK_SIZE,)),
    ],
    align=True,
)
"""Gathered pairs and their distances.

| field | meaning |
|---|---|
| x, y, z, radius | object spheres near each phalanx [m], world |
| leaf | their node in the tree |
| distance, parameter | signed distance [m] and axis parameter of the nearest sphere |
| hand_x, hand_y, hand_z, hand_radius | palm sphere of each palm pair [m], palm frame |
| object_x, object_y, object_z, object_radius | object sphere of each palm pair [m], world |
| palm_sphere, palm_leaf | their indices |
| palm_distance | signed distance [m] |
| tier_end, tier_depth | where each tier of a list ends, and how deep its tiers are [m] |
| measured | pairs of each list that are measured: the first ones |
| palm_own | slack of each slot of the palm when it was gathered [m]; each slot has its own stretch of the room |
| palm_spare | slack of each slot beyond that of the palm [m] |
| palm_least | least distance of each slot [m] |
| palm_share | which of `SHARES` each slot was last gathered with |
| scratch, stack | of a walk |
"""


@jit_inline
def _phalanx(hand: HandArrays, pose: Record, f: int, k: int) -> RoundCone:
    return RoundCone(
        pose.joints[f, k, 0],
        pose.joints[f, k, 1],
        pose.joints[f, k, 2],
        pose.direction[f, k, 0],
        pose.direction[f, k, 1],
        pose.direction[f, k, 2],
        hand.length[f, k],
        hand.tan_slope[f, k],
        hand.inverse_length[f, k],
        hand.radius[f, k],
        hand.radius[f, k] - hand.radius[f, k + 1],
    )


@jit_vector
def _leaf_distances(tree: TreeArrays, cone: RoundCone, leaves: Indices, count: int, distance_out: Array) -> None:
    for i in range(count):
        distance_out[i] = node_distance(tree, cone, np.uint64(leaves[i]))


@jit_once
def _gather_phalanx(
    tree: TreeArrays,
    hand: HandArrays,
    pose: Record,
    body: int,
    reach: float,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> bool:
    f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
    cone = _phalanx(hand, pose, f, k)
    count, clearance, tests = gather_round_cone(tree, cone, reach, walk.stack, walk.scratch)
    work[COUNT_NODE_TESTS] += tests
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
def _gather_slot_up_to(
    tree: TreeArrays,
    hand: HandArrays,
    pose: Record,
    slot: int,
    reach: float,
    room: int,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> float:
    # Returns the slot's slack; a negative infinity where there is no room.
    rotation, position = pose.rotation, pose.position
    spheres, start = hand.palm_radius.shape[0], slot * SLOT_PAIRS
    near, pair = candidates.palm_distance[start : start + SLOT_PAIRS], candidates.palm_leaf[start : start + SLOT_PAIRS]
    total, slack = as_int64(0), np.inf
    for sphere in range(slot * spheres // PALM_SLOTS, (slot + 1) * spheres // PALM_SLOTS):
        hx, hy, hz = hand.palm_x[sphere], hand.palm_y[sphere], hand.palm_z[sphere]
        cone = sphere_cone(
            position[0] + rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz,
            position[1] + rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz,
            position[2] + rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz,
            hand.palm_radius[sphere],
        )
        count, clearance, tests = gather_round_cone(tree, cone, reach, walk.stack, walk.scratch)
        work[COUNT_NODE_TESTS] += tests
        slack = min(slack, clearance)
        if count < 0 or total + count > room:
            return -np.inf
        _leaf_distances(tree, cone, walk.scratch, count, near[total:])
        for i in range(count):
            pair[total + i] = sphere * NODES + walk.scratch[i]
        total += count
    _list_slot(tree, hand, slot, total, tier_depth(reach), near, pair, candidates, walk.scratch)
    return slack


@jit_once
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
    # Writes the pairs in the order of their tiers.
    ends = candidates.tier_end[PALM_BODY + slot]
    start_tiers(near, total, depth, ends)
    for i in range(total):
        scratch[i] = pair[i]
    for i in range(total):
        sphere, node, tier = scratch[i] // NODES, scratch[i] % NODES, tier_of(near[i], depth)
        place = slot * SLOT_PAIRS + ends[tier]
        ends[tier] += 1
        candidates.hand_x[place] = hand.palm_x[sphere]
        candidates.hand_y[place] = hand.palm_y[sphere]
        candidates.hand_z[place] = hand.palm_z[sphere]
        candidates.hand_radius[place] = hand.palm_radius[sphere]
        candidates.object_x[place] = tree.x[node]
        candidates.object_y[place] = tree.y[node]
        candidates.object_z[place] = tree.z[node]
        candidates.object_radius[place] = tree.radius[node]
        candidates.palm_sphere[place] = sphere
        candidates.palm_leaf[place] = node
    candidates.tier_depth[PALM_BODY + slot] = depth


@jit_inline
def _listed(candidates: Record, which: int) -> int:
    return int(candidates.tier_end[which, TIERS - 1])


@jit_once
def _gather_slot(
    tree: TreeArrays,
    hand: HandArrays,
    pose: Record,
    slot: int,
    reach: float,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> float:
    least, share, slack = min(candidates.needed, reach), candidates.palm_share, -np.inf
    for k in range(share[slot], len(SHARES)):
        room = CROWD if k < len(SHARES) - 2 else SLOT_PAIRS
        own = least + SHARES[k] * (reach - least)
        slack = _gather_slot_up_to(tree, hand, pose, slot, own, room, candidates, walk, work)
        if slack > -np.inf:
            share[slot] = max(k - 1, 0) if FEW * _listed(candidates, PALM_BODY + slot) <= CROWD else k
            candidates.palm_own[slot] = slack
            break
    return slack


@jit_once
def _gather_palm(
    tree: TreeArrays, hand: HandArrays, pose: Record, reach: float, candidates: Record, walk: Walk, work: Indices
) -> bool:
    # The slots that need it; far from the object, where a walk is cheap, all; ahead of need the one that soonest will.
    spare, used, needed = candidates.palm_spare, candidates.slack[PALM_BODY], candidates.needed - candidates.leeway
    soonest = as_int64(-1)
    if candidates.due[PALM_BODY] == 2:
        soonest = as_int64(0)
        for slot in range(PALM_SLOTS):
            soonest = slot if spare[slot] < spare[soonest] else soonest
    every = soonest < 0 and used >= needed
    total = 0
    slack = np.inf
    for slot in range(PALM_SLOTS):
        own = used + spare[slot]
        if every or slot == soonest or not own >= needed:
            own = _gather_slot(tree, hand, pose, slot, reach, candidates, walk, work)
            if own == -np.inf:
                # What has been gathered anew has no common measure with what has not.
                candidates.slack[PALM_BODY] = -np.inf
                return False
        spare[slot] = own
        slack = min(slack, own)
        total += _listed(candidates, PALM_BODY + slot)
    for slot in range(PALM_SLOTS):
        spare[slot] = spare[slot] - slack if spare[slot] < np.inf else np.inf
    candidates.count[PALM_BODY] = total
    candidates.slack[PALM_BODY] = slack
    return True


@gather_pairs.of(TreeArrays)
@jit
def _gather(
    tree: TreeArrays,
    hand: HandArrays,
    pose: Record,
    body: int,
    reach: float,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> bool:
    if body < PALM_BODY:
        return _gather_phalanx(tree, hand, pose, body, reach, candidates, walk, work)
    return _gather_palm(tree, hand, pose, reach, candidates, walk, work)


@jit_vector
def _least(values: Array, count: int) -> float:
    least = 1e300
    for i in range(count):
        v = values[i]
        least = v if v < least else least
    return least


@jit_vector
def _count_within(distance: Array, count: int, limit: float) -> int:
    within = 0
    for i in range(count):
        within += 1 if distance[i] <= limit else 0
    return within


@jit_once
def _measure_phalanx(hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    cone = _phalanx(hand, pose, body // PHALANX_COUNT, body % PHALANX_COUNT)
    x, y, z, radius = candidates.x[body], candidates.y[body], candidates.z[body], candidates.radius[body]
    distance, parameter = candidates.distance[body], candidates.parameter[body]
    moved = moved_since(candidates.fresh[body], candidates.slack[body])
    first, tier, least = as_int64(0), as_int64(0), np.inf
    while True:
        after = next_tier(tier, candidates.tier_depth[body], moved, candidates.needed, least)
        if after == tier:
            break
        tier, stop = after, candidates.tier_end[body, after - 1]
        if first < stop:
            near = Spheres(x[first:stop], y[first:stop], z[first:stop], radius[first:stop])
            round_cone_distances(near, stop - first, cone, distance[first:stop], parameter[first:stop])
            least = min(least, _least(distance[first:stop], stop - first))
        first = stop
    candidates.measured[body] = candidates.count[body] = first
    return least


@jit_once
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
            least = min(least, _least(distance, stop - first))
        first = stop
    candidates.measured[which] = first
    candidates.palm_least[slot] = least
    return least


@measure_pairs.of(TreeArrays)
@jit
def _measure(tree: TreeArrays, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    if body < PALM_BODY:
        return _measure_phalanx(hand, pose, body, candidates)
    least, count = np.inf, as_int64(0)
    for slot in range(PALM_SLOTS):
        slack = candidates.slack[PALM_BODY] + candidates.palm_spare[slot]
        least = min(least, _measure_slot(pose, slot, slack, candidates))
        count += candidates.measured[PALM_BODY + slot]
    candidates.count[PALM_BODY] = count
    return least


@pairs_within.of(TreeArrays)
@jit
def _within(tree: TreeArrays, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    if body < PALM_BODY:
        return _count_within(candidates.distance[body], candidates.measured[body], limit)
    within = 0
    for slot in range(PALM_SLOTS):
        if candidates.palm_least[slot] <= limit:
            start, count = slot * SLOT_PAIRS, candidates.measured[PALM_BODY + slot]
            within += _count_within(candidates.palm_distance[start : start + count], count, limit)
    return within


@jit_once
def _palm_contacts(
    tree: TreeArrays, pose: Record, slot: int, candidates: Record, margin: float, row: int, contacts: Record
) -> int:
    # Arrays are read out of their records before the loop: within it that costs a reference count each time.
    hand_x, hand_y, hand_z = candidates.hand_x, candidates.hand_y, candidates.hand_z
    object_x, object_y, object_z = candidates.object_x, candidates.object_y, candidates.object_z
    hand_radius, object_radius = candidates.hand_radius, candidates.object_radius
    distance, sphere, leaf = candidates.palm_distance, candidates.palm_sphere, candidates.palm_leaf
    body_out, key_out, point_out, normal_out = contacts.body, contacts.key, contacts.point, contacts.normal
    distance_out, slides_out, straight_out = contacts.distance, contacts.slides, contacts.straight
    hand_radius_out, object_radius_out = contacts.hand_radius, contacts.object_radius
    position, rotation, leaf_total = pose.position, pose.rotation, tree.radius.shape[0]
    px, py, pz = position[0], position[1], position[2]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    capacity = body_out.shape[0]
    start = slot * SLOT_PAIRS
    for i in range(start, start + candidates.measured[PALM_BODY + slot]):
        d = distance[i]
        if d > margin:
            continue
        if row >= capacity:
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
            # Concentric spheres: every direction is as good; out of the back of the hand is where it can retreat.
            nx, ny, nz = r02, r12, r22
        reach = object_radius[i] + d
        body_out[row] = PALM_BODY
        key_out[row] = (PALM_BODY + sphere[i]) * leaf_total + leaf[i]
        normal_out[0, row] = nx
        normal_out[1, row] = ny
        normal_out[2, row] = nz
        point_out[0, row] = object_x[i] + reach * nx
        point_out[1, row] = object_y[i] + reach * ny
        point_out[2, row] = object_z[i] + reach * nz
        straight_out[0, row] = straight_out[1, row] = straight_out[2, row] = 0.0
        distance_out[row] = d
        hand_radius_out[row] = hand_radius[i]
        object_radius_out[row] = object_radius[i]
        slides_out[row] = 0
        row += 1
    return row


@jit_once
def _phalanx_contacts(
    tree: TreeArrays,
    hand: HandArrays,
    pose: Record,
    body: int,
    candidates: Record,
    margin: float,
    row: int,
    contacts: Record,
) -> int:
    f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
    x, y, z, radius = candidates.x[body], candidates.y[body], candidates.z[body], candidates.radius[body]
    distance, parameter, leaf = candidates.distance[body], candidates.parameter[body], candidates.leaf[body]
    body_out, key_out, point_out, normal_out = contacts.body, contacts.key, contacts.point, contacts.normal
    distance_out, slides_out, straight_out = contacts.distance, contacts.slides, contacts.straight
    hand_radius_out, object_radius_out = contacts.hand_radius, contacts.object_radius
    joint, direction, rotation, leaf_total = (
        pose.joints[f, k],
        pose.direction[f, k],
        pose.rotation,
        tree.radius.shape[0],
    )
    length, radius_a = hand.length[f, k], hand.radius[f, k]
    radius_drop = hand.radius[f, k] - hand.radius[f, k + 1]
    jx, jy, jz = joint[0], joint[1], joint[2]
    ux, uy, uz = length * direction[0], length * direction[1], length * direction[2]
    capacity = body_out.shape[0]
    for i in range(candidates.measured[body]):
        d = distance[i]
        if d > margin:
            continue
        if row >= capacity:
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
        reach = radius[i] + d
        body_out[row] = body
        key_out[row] = body * leaf_total + leaf[i]
        normal_out[0, row] = nx
        normal_out[1, row] = ny
        normal_out[2, row] = nz
        point_out[0, row] = cx + reach * nx
        point_out[1, row] = cy + reach * ny
        point_out[2, row] = cz + reach * nz
        straight_out[0, row] = straight_out[1, row] = straight_out[2, row] = 0.0
        distance_out[row] = d
        hand_radius_out[row] = radius_a - s * radius_drop
        object_radius_out[row] = radius[i]
        slides_out[row] = 1 if 0.0 < s < 1.0 else 0
        row += 1
    return row


@record_pairs.of(TreeArrays)
@jit
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
    if body < PALM_BODY:
        return _phalanx_contacts(tree, hand, pose, body, candidates, limit, row, contacts)
    for slot in range(PALM_SLOTS):
        if candidates.palm_least[slot] <= limit:
            row = _palm_contacts(tree, pose, slot, candidates, limit, row, contacts)
            if row < 0:
                return -1
    return row


@cone_contacts.of(TreeArrays)
@jit
def _cone_contacts(
    tree: TreeArrays, cone: RoundCone, limit: float, walk: Walk, row: int, pairs_out: ContactPoints
) -> tuple[int, float]:
    found, clearance, _ = gather_round_cone(tree, cone, limit, walk.stack, walk.scratch)
    if found < 0 or row + found > pairs_out.tick.shape[0]:
        return -1, 0.0
    for i in range(found):
        leaf = walk.scratch[i]
        dx, dy, dz = tree.x[leaf] - cone.x, tree.y[leaf] - cone.y, tree.z[leaf] - cone.z
        s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
        qx, qy, qz = dx - s * cone.length * cone.ux, dy - s * cone.length * cone.uy, dz - s * cone.length * cone.uz
        away = math.sqrt(qx * qx + qy * qy + qz * qz)
        # A leaf that is centred on the axis has no nearest point; any is as good.
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
    return nearest_leaf_round_cone(tree, cone, limit, stack)[0]


def _center(tree: TreeArrays) -> Array:
    return np.array([tree.x[0], tree.y[0], tree.z[0]])


SURFACE = Surface(
    summary="the leaf spheres of the object's sphere tree",
    arrays=TreeArrays,
    candidates=CANDIDATES,
    center=_center,
    coarser="a coarser sphere tree",
)
