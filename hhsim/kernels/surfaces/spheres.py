"""Contacts with the leaf spheres of the object's sphere tree, as in the paper."""

import math
from typing import TypeAlias

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
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT, HandArrays, phalanx_cone, placed_sphere
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline, jit_once
from hhsim.kernels.round_cone_distance import (
    RoundCone,
    Spheres,
    count_within,
    least_distance,
    round_cone_distances,
    round_cone_parameter,
    sphere_pair_distances,
)
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_round_cone, nearest_leaf_round_cone

Triple: TypeAlias = tuple[float, float, float]

PHALANX_PAIRS = 4088
PALM_SLOTS = 8
SLOT_PAIRS = 4088
PALM_PAIRS = PALM_SLOTS * SLOT_PAIRS
"""Most near pairs of a phalanx, and of the palm; the paper's heaviest scenes have a few hundred.

The palm's spheres are gathered by slots, each when its own slack is used up: all of them at once would take many times
another tick.
"""
CROWD = 1024
SHARES = (1.0, 0.5, 0.25, 0.0)
"""With more pairs of a slot than this within the reach, those up to the next share of the way from what is needed to
that reach are listed: long lists take long to measure. From the last share but one there may be as many as fit: a list
that reaches no further than what is needed is used up by the next tick."""
FEW = 4
"""Divisor of that number for a slot whose list may reach further the next time."""

CANDIDATES = np.dtype(
    [
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
        ("palm_count", np.int64, (PALM_SLOTS,)),  # pairs of each slot, which has its own stretch of the arrays
        ("palm_spare", np.float64, (PALM_SLOTS,)),  # slack of each slot beyond that of the palm [m]
        ("palm_share", np.int64, (PALM_SLOTS,)),  # index in `SHARES` of each slot's last gathering
        *SHARED_CANDIDATES,
        ("scratch", np.int64, (PHALANX_PAIRS,)),  # workspace of a walk, as the next
        ("stack", np.int64, (STACK_SIZE,)),
    ],
    align=True,
)
"""Gathered pairs and their distances."""


@jit
def _gather_slot(
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
    """List the pairs of a slot; return its slack [m], a negative infinity if there is no room."""
    spheres, start = hand.palm_radius.shape[0], slot * SLOT_PAIRS
    place, slack = start, np.inf
    for sphere in range(slot * spheres // PALM_SLOTS, (slot + 1) * spheres // PALM_SLOTS):
        hx, hy, hz = hand.palm_x[sphere], hand.palm_y[sphere], hand.palm_z[sphere]
        cone = placed_sphere(pose.position[:], pose.rotation[:], hx, hy, hz, hand.palm_radius[sphere])
        count, clearance, tests = gather_round_cone(tree, cone, reach, walk.stack, walk.scratch)
        work[COUNT_NODE_TESTS] += tests
        slack = min(slack, clearance)
        if count < 0 or place + count > start + room:
            return -np.inf
        for i in range(count):
            node = walk.scratch[i]
            candidates.hand_x[place] = hx
            candidates.hand_y[place] = hy
            candidates.hand_z[place] = hz
            candidates.hand_radius[place] = hand.palm_radius[sphere]
            candidates.object_x[place] = tree.x[node]
            candidates.object_y[place] = tree.y[node]
            candidates.object_z[place] = tree.z[node]
            candidates.object_radius[place] = tree.radius[node]
            candidates.palm_sphere[place] = sphere
            candidates.palm_leaf[place] = node
            place += 1
    candidates.palm_count[slot] = place - start
    return slack


@jit_once
def _gather_palm(
    tree: TreeArrays, hand: HandArrays, pose: Record, reach: float, candidates: Record, walk: Walk, work: Indices
) -> bool:
    """Gather the slots that need it, or that soonest will; far from the object, where a walk is cheap, all."""
    spare, used, needed = candidates.palm_spare, candidates.slack[PALM_BODY], candidates.needed - candidates.leeway
    least, share = min(candidates.needed, reach), candidates.palm_share
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
            own = -np.inf
            for k in range(share[slot], len(SHARES)):
                room = CROWD if k < len(SHARES) - 2 else SLOT_PAIRS
                limit = least + SHARES[k] * (reach - least)
                own = _gather_slot(tree, hand, pose, slot, limit, room, candidates, walk, work)
                if own > -np.inf:
                    share[slot] = max(k - 1, 0) if FEW * candidates.palm_count[slot] <= CROWD else k
                    break
            if own == -np.inf:
                # Slacks of slots gathered anew and before are relative to different references.
                candidates.slack[PALM_BODY] = -np.inf
                return False
        spare[slot] = own
        slack = min(slack, own)
        total += candidates.palm_count[slot]
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
    if body >= PALM_BODY:
        return _gather_palm(tree, hand, pose, reach, candidates, walk, work)
    cone = phalanx_cone(hand, pose.joints[:], pose.direction[:], body // PHALANX_COUNT, body % PHALANX_COUNT)
    count, clearance, tests = gather_round_cone(tree, cone, reach, walk.stack, walk.scratch)
    work[COUNT_NODE_TESTS] += tests
    if count < 0:
        return False
    for i in range(count):
        node = walk.scratch[i]
        candidates.leaf[body, i] = node
        candidates.x[body, i] = tree.x[node]
        candidates.y[body, i] = tree.y[node]
        candidates.z[body, i] = tree.z[node]
        candidates.radius[body, i] = tree.radius[node]
    candidates.count[body] = count
    candidates.slack[body] = clearance
    return True


@measure_pairs.of(TreeArrays)
@jit
def _measure(tree: TreeArrays, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    count = candidates.count[body]
    if body < PALM_BODY:
        near = Spheres(candidates.x[body], candidates.y[body], candidates.z[body], candidates.radius[body])
        cone = phalanx_cone(hand, pose.joints[:], pose.direction[:], body // PHALANX_COUNT, body % PHALANX_COUNT)
        round_cone_distances(near, count, cone, candidates.distance[body], candidates.parameter[body])
        return least_distance(candidates.distance[body], as_int64(0), count)
    least = np.inf
    for slot in range(PALM_SLOTS):
        start, count = slot * SLOT_PAIRS, candidates.palm_count[slot]
        if count == 0:
            continue
        stop = start + count
        x, y, z = candidates.hand_x[start:stop], candidates.hand_y[start:stop], candidates.hand_z[start:stop]
        palm = Spheres(x, y, z, candidates.hand_radius[start:stop])
        x, y, z = candidates.object_x[start:stop], candidates.object_y[start:stop], candidates.object_z[start:stop]
        leaves = Spheres(x, y, z, candidates.object_radius[start:stop])
        distance = candidates.palm_distance[start:stop]
        sphere_pair_distances(palm, leaves, count, pose.position[:], pose.rotation[:], distance)
        least = min(least, least_distance(distance, as_int64(0), count))
    return least


@pairs_within.of(TreeArrays)
@jit
def _within(tree: TreeArrays, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    if body < PALM_BODY:
        return count_within(candidates.distance[body], as_int64(0), candidates.count[body], limit)
    within = 0
    for slot in range(PALM_SLOTS):
        start, count = slot * SLOT_PAIRS, candidates.palm_count[slot]
        within += count_within(candidates.palm_distance[:], start, start + count, limit)
    return within


@jit_inline
def _write(
    contacts: Record, row: int, center: Triple, radius: float, normal: Triple, distance: float, hand_radius: float
) -> None:
    reach = radius + distance
    for j in range(3):
        contacts.normal[j, row] = normal[j]
        contacts.point[j, row] = center[j] + reach * normal[j]
        contacts.straight[j, row] = 0.0
    contacts.distance[row] = distance
    contacts.hand_radius[row] = hand_radius
    contacts.object_radius[row] = radius


@jit_once
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
    for i in range(start, start + candidates.palm_count[slot]):
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
        _write(contacts, row, center, object_radius[i], normal, d, hand_radius[i])
        contacts.body[row] = PALM_BODY
        contacts.key[row] = (PALM_BODY + sphere[i]) * leaf_total + leaf[i]
        contacts.slides[row] = 0
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
    if body == PALM_BODY:
        for slot in range(PALM_SLOTS):
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
    for i in range(candidates.count[body]):
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
        _write(contacts, row, (cx, cy, cz), radius[i], (nx, ny, nz), d, radius_a - s * radius_drop)
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
    found, clearance, _ = gather_round_cone(tree, cone, limit, walk.stack, walk.scratch)
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
