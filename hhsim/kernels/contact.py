"""Contact detection: which pairs of hand body and object sphere are near, and how near.

Two stages. *Gathering* walks the object's tree once for a body with a margin plus a skin and copies what it finds into contiguous
arrays. *Evaluation* computes the signed distances of all gathered pairs on the vector unit, every time the hand moves.

No pair is missed. When a body is gathered, every leaf left out is at least `clearance` away. No point of the body can since have
moved further than the sum of its motion bounds (`kernels.hand.motion_bounds`), so every leaf left out is still at least
slack = clearance - Σ motion away. A body is gathered anew before its slack falls below the margin that the next step
may use up; hence all pairs within the margin are among the gathered ones, at every step.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .distance import round_cone_distances, sphere_pair_distances
from .hand import BODY_COUNT, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from .jit import jit, jit_vector
from .pose import HandPose
from .tree import TreeArrays, gather_round_cone

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

COUNT_NODE_TESTS = 0
COUNT_PAIR_TESTS = 1
COUNT_GATHERS = 2
"""Places in the work counters."""

FULL = 1
"""More pairs are near than the arrays hold, even with no skin."""


class Candidates(NamedTuple):
    """Gathered pairs and their distances.

    | field | meaning | shape |
    |---|---|---|
    | x, y, z, radius | object spheres near each phalanx [m], world | (15, capacity) |
    | leaf | their node in the tree | (15, capacity) |
    | distance, parameter | signed distance [m] and axis parameter of the nearest sphere | (15, capacity) |
    | hand_x, hand_y, hand_z, hand_radius | palm sphere of each palm pair [m], palm frame | (palm capacity,) |
    | object_x, object_y, object_z, object_radius | object sphere of each palm pair [m], world | (palm capacity,) |
    | palm_sphere, palm_leaf | their indices | (palm capacity,) |
    | palm_distance | signed distance [m] | (palm capacity,) |
    | count | pairs of each body | (16,) |
    | slack | least distance that any leaf left out can still have [m] | (16,) |
    | nearest | least signed distance of each body, infinite where it has no pair [m] | (16,) |
    | scratch | node indices during a walk | (leaf count,) |
    | stack | of a walk | (STACK_SIZE,) |
    """

    x: Array
    y: Array
    z: Array
    radius: Array
    leaf: Indices
    distance: Array
    parameter: Array
    hand_x: Array
    hand_y: Array
    hand_z: Array
    hand_radius: Array
    object_x: Array
    object_y: Array
    object_z: Array
    object_radius: Array
    palm_sphere: Indices
    palm_leaf: Indices
    palm_distance: Array
    count: Indices
    slack: Array
    nearest: Array
    scratch: Indices
    stack: Indices


class Contacts(NamedTuple):
    """Contact records: what the solver knows of the object, whatever its surface is made of.

    | field | meaning | shape |
    |---|---|---|
    | body | 0 to 14 phalanx, 15 palm | (capacity,) |
    | key | names the same pair at every tick, for warm starts | (capacity,) |
    | point | contact point on the hand's surface [m], world | (3, capacity) |
    | normal | unit vector from the object to the hand, world | (3, capacity) |
    | distance | signed [m], negative inside | (capacity,) |
    | start | first record of the palm, of each finger, and the end | (7,) |
    """

    body: Indices
    key: Indices
    point: Array
    normal: Array
    distance: Array
    start: Indices


@jit
def _gather_phalanx(
    hand: HandArrays, pose: HandPose, tree: TreeArrays, body: int, reach: float, candidates: Candidates, work: Indices
) -> None:
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
        candidates.stack,
        candidates.scratch,
    )
    work[COUNT_NODE_TESTS] += tests
    for i in range(count):
        node = candidates.scratch[i]
        candidates.leaf[body, i] = node
        candidates.x[body, i] = tree.x[node]
        candidates.y[body, i] = tree.y[node]
        candidates.z[body, i] = tree.z[node]
        candidates.radius[body, i] = tree.radius[node]
    candidates.count[body] = count
    candidates.slack[body] = clearance


@jit
def _gather_palm(
    hand: HandArrays, pose: HandPose, tree: TreeArrays, reach: float, candidates: Candidates, work: Indices
) -> bool:
    rotation, position = pose.rotation, pose.position
    capacity = candidates.palm_leaf.shape[0]
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
            candidates.stack,
            candidates.scratch,
        )
        work[COUNT_NODE_TESTS] += tests
        slack = min(slack, clearance)
        if total + count > capacity:
            return False
        for i in range(count):
            node = candidates.scratch[i]
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


@jit
def evaluate(
    hand: HandArrays,
    pose: HandPose,
    tree: TreeArrays,
    margin: float,
    skin: float,
    candidates: Candidates,
    work: Indices,
) -> int:
    """Distances of all near pairs at `pose`, whose kinematics are up to date; gathers the bodies whose slack is used up.

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
    for body in range(BODY_COUNT):
        if candidates.slack[body] >= margin:
            continue
        work[COUNT_GATHERS] += 1
        if body < PALM_BODY:
            _gather_phalanx(hand, pose, tree, body, margin + skin, candidates, work)
        elif not _gather_palm(hand, pose, tree, margin + skin, candidates, work) and not _gather_palm(
            hand, pose, tree, margin, candidates, work
        ):
            return FULL
    for body in range(PALM_BODY):
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
        candidates.nearest[PALM_BODY] = _least(candidates.palm_distance, count)
    return 0


@jit
def _record(
    contacts: Contacts,
    row: int,
    body: int,
    key: int,
    qx: float,
    qy: float,
    qz: float,
    cx: float,
    cy: float,
    cz: float,
    object_radius: float,
    distance: float,
    pose: HandPose,
) -> None:
    # q is the centre of the hand's nearest sphere, c the object's.
    nx, ny, nz = qx - cx, qy - cy, qz - cz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length > 0.0:
        nx, ny, nz = nx / length, ny / length, nz / length
    else:
        # Concentric spheres: every direction is as good; out of the back of the hand is where it can retreat.
        nx, ny, nz = pose.rotation[0, 2], pose.rotation[1, 2], pose.rotation[2, 2]
    contacts.body[row] = body
    contacts.key[row] = key
    contacts.normal[0, row] = nx
    contacts.normal[1, row] = ny
    contacts.normal[2, row] = nz
    reach = object_radius + distance
    contacts.point[0, row] = cx + reach * nx
    contacts.point[1, row] = cy + reach * ny
    contacts.point[2, row] = cz + reach * nz
    contacts.distance[row] = distance


@jit
def find_contacts(
    hand: HandArrays, pose: HandPose, candidates: Candidates, margin: float, leaf_total: int, contacts: Contacts
) -> int:
    """Contact records of all evaluated pairs within `margin` [m], palm first, then finger by finger.

    Returns:
        0, or FULL.
    """
    capacity = contacts.body.shape[0]
    row = 0
    contacts.start[0] = 0
    if candidates.nearest[PALM_BODY] <= margin:
        rotation, position = pose.rotation, pose.position
        for i in range(candidates.count[PALM_BODY]):
            distance = candidates.palm_distance[i]
            if distance > margin:
                continue
            if row >= capacity:
                return FULL
            hx, hy, hz = candidates.hand_x[i], candidates.hand_y[i], candidates.hand_z[i]
            _record(
                contacts,
                row,
                PALM_BODY,
                (PALM_BODY + candidates.palm_sphere[i]) * leaf_total + candidates.palm_leaf[i],
                position[0] + rotation[0, 0] * hx + rotation[0, 1] * hy + rotation[0, 2] * hz,
                position[1] + rotation[1, 0] * hx + rotation[1, 1] * hy + rotation[1, 2] * hz,
                position[2] + rotation[2, 0] * hx + rotation[2, 1] * hy + rotation[2, 2] * hz,
                candidates.object_x[i],
                candidates.object_y[i],
                candidates.object_z[i],
                candidates.object_radius[i],
                distance,
                pose,
            )
            row += 1
    contacts.start[1] = row
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            body = PHALANX_COUNT * f + k
            if candidates.nearest[body] > margin:
                continue
            length = hand.length[f, k]
            for i in range(candidates.count[body]):
                distance = candidates.distance[body, i]
                if distance > margin:
                    continue
                if row >= capacity:
                    return FULL
                along = candidates.parameter[body, i] * length
                _record(
                    contacts,
                    row,
                    body,
                    body * leaf_total + candidates.leaf[body, i],
                    pose.joints[f, k, 0] + along * pose.direction[f, k, 0],
                    pose.joints[f, k, 1] + along * pose.direction[f, k, 1],
                    pose.joints[f, k, 2] + along * pose.direction[f, k, 2],
                    candidates.x[body, i],
                    candidates.y[body, i],
                    candidates.z[body, i],
                    candidates.radius[body, i],
                    distance,
                    pose,
                )
                row += 1
        contacts.start[f + 2] = row
    return 0
