"""Contact detection: which pairs of hand body and object sphere are near, and how near.

Two stages. *Gathering* walks the object's tree once for a body with a margin plus a skin and copies what it finds into
contiguous arrays. *Evaluation* computes the signed distances of all gathered pairs on the vector unit, every time the
hand moves.

No pair is missed. When a body is gathered, every leaf left out is at least `clearance` away. No point of the body can
since have moved further than the sum of its motion bounds (`kernels.hand.motion_bounds`), so every leaf left out is
still at least
slack = clearance - Σ motion away. A body is gathered anew before its slack falls below the margin that the next step
may use up; hence all pairs within the margin are among the gathered ones, at every step.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import BODY_COUNT, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Record, as_int64, jit, jit_inline, jit_vector
from hhsim.kernels.round_cone_distance import round_cone_distances, sphere_pair_distances
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_round_cone

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

COUNT_NODE_TESTS = 0
COUNT_PAIR_TESTS = 1
COUNT_GATHERS = 2
"""Places in the work counters."""

FULL = 1
"""More pairs are near than the arrays hold, even with no skin."""


PHALANX_PAIRS = 4096
PALM_PAIRS = 16384
CONTACT_ROWS = 4096
"""Room for the near pairs of a phalanx, of the palm, and for contacts.

The paper's heaviest scenes have a few hundred.
"""

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
        ("count", np.int64, (BODY_COUNT,)),
        ("slack", np.float64, (BODY_COUNT,)),
        ("fresh", np.float64, (BODY_COUNT,)),
        ("nearest", np.float64, (BODY_COUNT,)),
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
| count | pairs of each body |
| slack | least distance that any leaf left out can still have [m]; negative infinity: to be gathered |
| fresh | slack when the body was gathered [m] |
| nearest | least signed distance of each body, infinite where it has no pair [m] |
| scratch, stack | of a walk |
"""

CONTACTS = np.dtype(
    [
        ("body", np.int64, (CONTACT_ROWS,)),
        ("key", np.int64, (CONTACT_ROWS,)),
        ("point", np.float64, (3, CONTACT_ROWS)),
        ("normal", np.float64, (3, CONTACT_ROWS)),
        ("distance", np.float64, (CONTACT_ROWS,)),
        ("hand_radius", np.float64, (CONTACT_ROWS,)),
        ("object_radius", np.float64, (CONTACT_ROWS,)),
        ("slides", np.int8, (CONTACT_ROWS,)),
        ("start", np.int64, (FINGER_COUNT + 2,)),
        ("phalanx_end", np.int64, (FINGER_COUNT, PHALANX_COUNT)),
    ],
    align=True,
)
"""Contact records: what the solver knows of the object, whatever its surface is made of.

| field | meaning |
|---|---|
| body | 0 to 14 phalanx, 15 palm |
| key | names the same pair at every tick, for warm starts |
| point | contact point on the hand's surface [m], world |
| normal | unit vector from the object to the hand, world |
| distance | signed [m], negative inside |
| hand_radius, object_radius | radii of curvature of the two surfaces at the contact [m] |
| slides | 1 where the nearest point of the phalanx can slide along its axis, else 0 |
| start | first record of the palm, of each finger, and the end |
| phalanx_end | where the records of each phalanx end |
"""


@jit
def _gather_phalanx(
    hand: HandArrays,
    pose: Record,
    tree: TreeArrays,
    body: int,
    reach: float,
    candidates: Record,
    stack: Indices,
    scratch: Indices,
    work: Indices,
) -> bool:
    f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
    count, clearance, tests = gather_round_cone(
        tree,
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
        reach,
        stack,
        scratch,
    )
    work[COUNT_NODE_TESTS] += tests
    if count < 0:
        return False
    for i in range(count):
        node = scratch[i]
        candidates.leaf[body, i] = node
        candidates.x[body, i] = tree.x[node]
        candidates.y[body, i] = tree.y[node]
        candidates.z[body, i] = tree.z[node]
        candidates.radius[body, i] = tree.radius[node]
    candidates.count[body] = count
    candidates.slack[body] = clearance
    return True


@jit
def _gather_palm(
    hand: HandArrays,
    pose: Record,
    tree: TreeArrays,
    reach: float,
    candidates: Record,
    stack: Indices,
    scratch: Indices,
    work: Indices,
) -> bool:
    rotation, position = pose.rotation, pose.position
    capacity = PALM_PAIRS
    total = 0
    slack = np.inf
    for sphere in range(hand.palm_radius.shape[0]):
        hx, hy, hz = hand.palm_x[sphere], hand.palm_y[sphere], hand.palm_z[sphere]
        count, clearance, tests = gather_round_cone(
            tree,
            position[0] + rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz,
            position[1] + rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz,
            position[2] + rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            hand.palm_radius[sphere],
            0.0,
            reach,
            stack,
            scratch,
        )
        work[COUNT_NODE_TESTS] += tests
        slack = min(slack, clearance)
        if count < 0 or total + count > capacity:
            return False
        for i in range(count):
            node = scratch[i]
            candidates.hand_x[total] = hx
            candidates.hand_y[total] = hy
            candidates.hand_z[total] = hz
            candidates.hand_radius[total] = hand.palm_radius[sphere]
            candidates.object_x[total] = tree.x[node]
            candidates.object_y[total] = tree.y[node]
            candidates.object_z[total] = tree.z[node]
            candidates.object_radius[total] = tree.radius[node]
            candidates.palm_sphere[total] = sphere
            candidates.palm_leaf[total] = node
            total += 1
    candidates.count[PALM_BODY] = total
    candidates.slack[PALM_BODY] = slack
    return True


@jit_vector
def _least(values: Array, count: int) -> float:
    least = 1e300
    for i in range(count):
        v = values[i]
        least = v if v < least else least
    return least


@jit_vector
def count_within(distance: Array, count: int, limit: float) -> int:
    """How many of the first `count` distances are at most `limit`."""
    within = 0
    for i in range(count):
        within += 1 if distance[i] <= limit else 0
    return within


FAR = 4.0
"""A body whose clearance is this many times the reach of a walk has no lists to lose by another walk."""


@jit
def _to_be_gathered(margin: float, skin: float, candidates: Record, body: int) -> bool:
    # Far from the object a long step leaves little slack, which would bound the next one; a walk there is cheap.
    slack, fresh = candidates.slack[body], candidates.fresh[body]
    return slack < margin or (fresh > FAR * (margin + skin) and slack < 0.5 * fresh)


@jit_inline
def evaluate_range(
    hand: HandArrays,
    pose: Record,
    tree: TreeArrays,
    margin: float,
    skin: float,
    first: int,
    last: int,
    candidates: Record,
    stack: Indices,
    scratch: Indices,
    work: Indices,
) -> int:
    """As `evaluate`, for the bodies first to last - 1; absorbed by its callers, to which the many arrays are at hand.

    Writes what belongs to these bodies, the counters and the walk's `stack` and `scratch`, and nothing else.
    """
    status = 0
    for body in range(first, last):
        if not _to_be_gathered(margin, skin, candidates, body):
            continue
        work[COUNT_GATHERS] += 1
        gathered = False
        for reach in (margin + skin, margin):
            if not gathered and body < PALM_BODY:
                gathered = _gather_phalanx(hand, pose, tree, body, reach, candidates, stack, scratch, work)
            elif not gathered:
                gathered = _gather_palm(hand, pose, tree, reach, candidates, stack, scratch, work)
        if gathered:
            candidates.fresh[body] = candidates.slack[body]
        else:
            # The others go on, so that what is left behind does not hang on who came first.
            status = FULL
    for body in range(first, min(last, PALM_BODY)):
        count = candidates.count[body]
        if count == 0:
            candidates.nearest[body] = np.inf
            continue
        f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
        round_cone_distances(
            candidates.x[body],
            candidates.y[body],
            candidates.z[body],
            candidates.radius[body],
            count,
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
            candidates.distance[body],
            candidates.parameter[body],
        )
        work[COUNT_PAIR_TESTS] += count
        candidates.nearest[body] = _least(candidates.distance[body], count)
    if last <= PALM_BODY:
        return status
    count = candidates.count[PALM_BODY]
    candidates.nearest[PALM_BODY] = np.inf
    if count > 0:
        sphere_pair_distances(
            candidates.hand_x,
            candidates.hand_y,
            candidates.hand_z,
            candidates.hand_radius,
            candidates.object_x,
            candidates.object_y,
            candidates.object_z,
            candidates.object_radius,
            count,
            pose.position,
            pose.rotation,
            candidates.palm_distance,
        )
        work[COUNT_PAIR_TESTS] += count
        candidates.nearest[PALM_BODY] = _least(candidates.palm_distance[:], count)
    return status


WALK_COST = 2000
"""What gathering a phalanx costs, in distances that the vector unit computes in that time; the palm's, ten times."""


@jit
def part_cost(margin: float, skin: float, part: int, candidates: Record) -> int:
    """What `evaluate_range` will cost for a finger (0 to 4) or the palm (5), roughly, in distances."""
    if part == FINGER_COUNT:
        walk = 10 * WALK_COST if _to_be_gathered(margin, skin, candidates, as_int64(PALM_BODY)) else 0
        return walk + candidates.count[PALM_BODY]
    cost = 0
    for body in range(PHALANX_COUNT * part, PHALANX_COUNT * (part + 1)):
        cost += candidates.count[body]
        if _to_be_gathered(margin, skin, candidates, body):
            cost += WALK_COST
    return cost


@jit
def evaluate(
    hand: HandArrays,
    pose: Record,
    tree: TreeArrays,
    margin: float,
    skin: float,
    candidates: Record,
    work: Indices,
) -> int:
    """Distances of all near pairs at `pose`, whose kinematics are up to date.

    Gathers the bodies whose slack is used up.

    Args:
        hand: the hand.
        pose: the configuration.
        tree: the object's sphere tree, world frame.
        margin: every pair up to this far [m] is to be known.
        skin: gathered in excess of the margin [m], so that lists last for several ticks.
        candidates: the lists, brought up to date.
        work: counters of node tests, pair tests and gathers, added to, shape (>= 3,).

    Returns:
        0, or FULL.
    """
    stack, scratch = candidates.stack[:], candidates.scratch[:]
    first, last = as_int64(0), as_int64(BODY_COUNT)
    return evaluate_range(hand, pose, tree, margin, skin, first, last, candidates, stack, scratch, work[:])


@jit
def _palm_contacts(
    hand_x: Array,
    hand_y: Array,
    hand_z: Array,
    hand_radius: Array,
    object_x: Array,
    object_y: Array,
    object_z: Array,
    object_radius: Array,
    distance: Array,
    sphere: Indices,
    leaf: Indices,
    count: int,
    position: Array,
    rotation: Array,
    margin: float,
    leaf_total: int,
    row: int,
    body_out: Indices,
    key_out: Indices,
    point_out: Array,
    normal_out: Array,
    distance_out: Array,
    hand_radius_out: Array,
    object_radius_out: Array,
    slides_out: NDArray[np.int8],
) -> int:
    # Arrays one by one: reading them out of a NamedTuple inside the loop costs a reference count each time.
    px, py, pz = position[0], position[1], position[2]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    capacity = body_out.shape[0]
    for i in range(count):
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
        distance_out[row] = d
        hand_radius_out[row] = hand_radius[i]
        object_radius_out[row] = object_radius[i]
        slides_out[row] = 0
        row += 1
    return row


@jit
def _phalanx_contacts(
    x: Array,
    y: Array,
    z: Array,
    radius: Array,
    distance: Array,
    parameter: Array,
    leaf: Indices,
    count: int,
    joint: Array,
    direction: Array,
    length: float,
    radius_a: float,
    radius_drop: float,
    rotation: Array,
    body: int,
    margin: float,
    leaf_total: int,
    row: int,
    body_out: Indices,
    key_out: Indices,
    point_out: Array,
    normal_out: Array,
    distance_out: Array,
    hand_radius_out: Array,
    object_radius_out: Array,
    slides_out: NDArray[np.int8],
) -> int:
    jx, jy, jz = joint[0], joint[1], joint[2]
    ux, uy, uz = length * direction[0], length * direction[1], length * direction[2]
    capacity = body_out.shape[0]
    for i in range(count):
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
        distance_out[row] = d
        hand_radius_out[row] = radius_a - s * radius_drop
        object_radius_out[row] = radius[i]
        slides_out[row] = 1 if 0.0 < s < 1.0 else 0
        row += 1
    return row


@jit
def find_contacts(
    hand: HandArrays, pose: Record, candidates: Record, margin: float, leaf_total: int, contacts: Record
) -> int:
    """Contact records of all evaluated pairs within `margin` [m], palm first, then finger by finger.

    `leaf_total` is larger than any leaf's node index: it makes the keys unique.

    Returns:
        0, or FULL.
    """
    row = 0
    contacts.start[0] = 0
    if candidates.nearest[PALM_BODY] <= margin:
        row = _palm_contacts(
            candidates.hand_x,
            candidates.hand_y,
            candidates.hand_z,
            candidates.hand_radius,
            candidates.object_x,
            candidates.object_y,
            candidates.object_z,
            candidates.object_radius,
            candidates.palm_distance,
            candidates.palm_sphere,
            candidates.palm_leaf,
            candidates.count[PALM_BODY],
            pose.position,
            pose.rotation,
            margin,
            leaf_total,
            row,
            contacts.body,
            contacts.key,
            contacts.point,
            contacts.normal,
            contacts.distance,
            contacts.hand_radius,
            contacts.object_radius,
            contacts.slides,
        )
        if row < 0:
            return FULL
    contacts.start[1] = row
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            body = PHALANX_COUNT * f + k
            contacts.phalanx_end[f, k] = row
            if candidates.nearest[body] > margin:
                continue
            row = _phalanx_contacts(
                candidates.x[body],
                candidates.y[body],
                candidates.z[body],
                candidates.radius[body],
                candidates.distance[body],
                candidates.parameter[body],
                candidates.leaf[body],
                candidates.count[body],
                pose.joints[f, k],
                pose.direction[f, k],
                hand.length[f, k],
                hand.radius[f, k],
                hand.radius[f, k] - hand.radius[f, k + 1],
                pose.rotation,
                body,
                margin,
                leaf_total,
                row,
                contacts.body,
                contacts.key,
                contacts.point,
                contacts.normal,
                contacts.distance,
                contacts.hand_radius,
                contacts.object_radius,
                contacts.slides,
            )
            if row < 0:
                return FULL
            contacts.phalanx_end[f, k] = row
        contacts.start[f + 2] = row
    return 0
