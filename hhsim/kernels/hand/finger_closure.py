"""Geometric search of a trajectory script: how far a hand can move, and a finger close, before it touches the object.

Both searches step by conservative advancement: a body that is d away and whose points move at most v a unit of the
motion stays clear for d / v units. So no feature is stepped over, however thin, and no step size is to be chosen.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays, forward_kinematics
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.round_cone_distance import RoundCone, round_cone_parameter
from hhsim.kernels.sphere_tree import TreeArrays, nearest_leaf_round_cone

CONTACT = 2e-5
"""A body this close [m] counts as touching: the advancement stops there."""
STEP_LIMIT = 400
"""A search that creeps along a surface ends after so many steps, short of contact and therefore clear."""


class ClosureWork(NamedTuple):
    """Workspace of the search.

    | field | meaning | shape |
    |---|---|---|
    | joints | joint and tip centres [m], world | (5, 4, 3) |
    | direction | unit axis of each phalanx, world | (5, 3, 3) |
    | axis, abduction_axis | unit axes, world | (5, 3) |
    | stack | of the tree walk | (STACK_SIZE,) |
    """

    joints: Array
    direction: Array
    axis: Array
    abduction_axis: Array
    stack: Indices


@jit
def phalanx_distance(
    hand: HandArrays, tree: TreeArrays, finger: int, phalanx: int, limit: float, work: ClosureWork
) -> tuple[float, int]:
    """Least signed distance [m] of a phalanx to the leaves, and that leaf's node; (limit, -1) where none is nearer."""
    a, u = work.joints[finger, phalanx], work.direction[finger, phalanx]
    cone = RoundCone(
        a[0],
        a[1],
        a[2],
        u[0],
        u[1],
        u[2],
        hand.length[finger, phalanx],
        hand.tan_slope[finger, phalanx],
        hand.inverse_length[finger, phalanx],
        hand.radius[finger, phalanx],
        hand.radius[finger, phalanx] - hand.radius[finger, phalanx + 1],
    )
    return nearest_leaf_round_cone(tree, cone, limit, work.stack)


@jit
def sphere_distance(tree: TreeArrays, center: Array, radius: float, limit: float, work: ClosureWork) -> float:
    """Least signed distance [m] of a sphere to the leaves; `limit` where none is nearer."""
    cone = RoundCone(center[0], center[1], center[2], 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, radius, 0.0)
    distance, _ = nearest_leaf_round_cone(tree, cone, limit, work.stack)
    return distance


@jit_allocating
def palm_distance(
    hand: HandArrays, tree: TreeArrays, position: Array, rotation: Array, limit: float, work: ClosureWork
) -> float:
    """Least signed distance [m] of the palm's leaf spheres to the tree's; `limit` where none is below it."""
    best = limit
    center = np.empty(3)
    for i in range(hand.palm_x.shape[0]):
        x, y, z = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i]
        for k in range(3):
            center[k] = position[k] + rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
        best = sphere_distance(tree, center, hand.palm_radius[i], best, work)
    return best


@jit
def body_distances(
    hand: HandArrays,
    tree: TreeArrays,
    position: Array,
    rotation: Array,
    flexion: Array,
    abduction: Array,
    limit: float,
    work: ClosureWork,
    distance_out: Array,
) -> None:
    """Signed distance [m] of every body of the hand to the tree's leaves, `limit` where it is farther; shape (16,)."""
    forward_kinematics(
        hand, position, rotation, flexion, abduction, work.joints, work.direction, work.axis, work.abduction_axis
    )
    for body in range(PALM_BODY):
        distance_out[body], _ = phalanx_distance(hand, tree, body // PHALANX_COUNT, body % PHALANX_COUNT, limit, work)
    distance_out[PALM_BODY] = palm_distance(hand, tree, position, rotation, limit, work)


@jit_allocating
def advance_hand(
    hand: HandArrays,
    tree: TreeArrays,
    position: Array,
    rotation: Array,
    flexion: Array,
    abduction: Array,
    direction: Array,
    gap: Array,
    travel_limit: float,
    work: ClosureWork,
) -> tuple[float, int]:
    """How far [m] the rigid hand can move along the unit `direction` until a body comes within its gap of the object.

    Args:
        hand, tree: The hand and the object.
        position, rotation: Of the palm at the start, world.
        flexion, abduction: [rad], shapes (5, 3) and (5,).
        direction: Unit, shape (3,), world.
        gap: Distance to keep for each body [m], shape (16,).
        travel_limit: The farthest to go [m].
        work: Workspace.

    Returns:
        (travel, body that stopped it): body -1 where nothing did within the limit.
    """
    travel = 0.0
    blocking = PALM_BODY
    here = np.empty(3)
    for _ in range(STEP_LIMIT):
        for i in range(3):
            here[i] = position[i] + travel * direction[i]
        forward_kinematics(
            hand, here, rotation, flexion, abduction, work.joints, work.direction, work.axis, work.abduction_axis
        )
        slack = np.inf
        # The body that was nearest bounds the search of all the others: start with it.
        first = blocking
        for k in range(BODY_COUNT):
            body = (first + k) % BODY_COUNT
            limit = slack + gap[body]
            if body == PALM_BODY:
                distance = palm_distance(hand, tree, here, rotation, limit, work)
            else:
                distance, _ = phalanx_distance(hand, tree, body // PHALANX_COUNT, body % PHALANX_COUNT, limit, work)
            if distance < limit:
                slack = distance - gap[body]
                blocking = body
        if slack <= CONTACT:
            return travel, blocking
        travel += slack
        if travel >= travel_limit:
            return travel_limit, -1
    return travel, blocking


@jit_allocating
def close_finger(
    hand: HandArrays,
    tree: TreeArrays,
    position: Array,
    rotation: Array,
    finger: int,
    rate: Array,
    abduction: Array,
    flexion: Array,
    work: ClosureWork,
    touching_out: Array,
) -> None:
    """Close a finger as one that is driven by a tendon: a phalanx that touches stops, those beyond it go on.

    Args:
        hand, tree: The hand and the object.
        position, rotation: Of the palm, world.
        finger: Which one.
        rate: Share of each joint in the motion, not negative, shape (3,).
        abduction: [rad], shape (5,).
        flexion: [rad], shape (5, 3); this finger's row is closed in place, up to contact or the joint limits.
        work: Workspace.
        touching_out: 1 for a phalanx in contact, else 0, shape (5, 3); this finger's row is written.
    """
    speed = np.empty(PHALANX_COUNT)
    for k in range(PHALANX_COUNT):
        speed[k] = rate[k]
        touching_out[finger, k] = 0.0
    for _ in range(STEP_LIMIT):
        forward_kinematics(
            hand, position, rotation, flexion, abduction, work.joints, work.direction, work.axis, work.abduction_axis
        )
        step = np.inf
        for k in range(PHALANX_COUNT):
            if speed[k] > 0.0:
                step = min(step, (hand.flexion_max[finger, k] - flexion[finger, k]) / speed[k])
        # From the tip down: a phalanx that touches stops itself and those below it, not those above.
        for k in range(PHALANX_COUNT - 1, -1, -1):
            motion = 0.0
            for i in range(k + 1):
                motion += speed[i] * hand.lever[finger, k, i]
            if touching_out[finger, k] > 0.0:
                continue
            limit = 2.0 * CONTACT if motion == 0.0 else step * motion + 2.0 * CONTACT
            distance, _ = phalanx_distance(hand, tree, finger, k, limit, work)
            if distance <= CONTACT:
                touching_out[finger, k] = 1.0
                for i in range(k + 1):
                    speed[i] = 0.0
            elif motion > 0.0:
                step = min(step, distance / motion)
        moving = 0.0
        for k in range(PHALANX_COUNT):
            moving += speed[k]
        if moving == 0.0:
            return
        for k in range(PHALANX_COUNT):
            flexion[finger, k] = min(flexion[finger, k] + step * speed[k], hand.flexion_max[finger, k])
            if flexion[finger, k] >= hand.flexion_max[finger, k] - 1e-9:
                speed[k] = 0.0


@jit_allocating
def deepen_finger(
    hand: HandArrays, finger: int, rate: Array, abduction: Array, depth: float, flexion: Array, work: ClosureWork
) -> float:
    """Flex a finger on until its tip is `depth` [m] from where it was, or the joint limits end it.

    Args:
        hand: The hand.
        finger: Which one.
        rate: Share of each joint in the motion, not negative, shape (3,).
        abduction: [rad], shape (5,).
        depth: Distance between the tip before and after [m].
        flexion: [rad], shape (5, 3); this finger's row is changed in place.
        work: Workspace; its kinematics are overwritten.

    Returns:
        The distance reached [m].
    """
    origin = np.zeros(3)
    upright = np.eye(3)
    start = flexion[finger].copy()
    before = np.empty(3)
    low, high = 0.0, 0.0
    for k in range(PHALANX_COUNT):
        if rate[k] > 0.0:
            high = max(high, (hand.flexion_max[finger, k] - start[k]) / rate[k])
    moved = 0.0
    # The first round looks at the start, the second at the limits, the others halve.
    for iteration in range(52):
        amount = low if iteration == 0 else high if iteration == 1 else 0.5 * (low + high)
        for k in range(PHALANX_COUNT):
            flexion[finger, k] = min(start[k] + amount * rate[k], max(start[k], hand.flexion_max[finger, k]))
        forward_kinematics(
            hand, origin, upright, flexion, abduction, work.joints, work.direction, work.axis, work.abduction_axis
        )
        tip = work.joints[finger, PHALANX_COUNT]
        if iteration == 0:
            for i in range(3):
                before[i] = tip[i]
            continue
        moved = math.sqrt((tip[0] - before[0]) ** 2 + (tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2)
        if iteration == 1:
            if moved <= depth:
                return moved
            continue
        if moved < depth:
            low = amount
        else:
            high = amount
    return moved


@jit
def contact_normal(
    hand: HandArrays, tree: TreeArrays, finger: int, phalanx: int, work: ClosureWork, normal_out: Array
) -> float:
    """Signed distance [m] of a phalanx to the nearest leaf, and the unit normal from that leaf to the phalanx, world.

    `work` holds the kinematics.
    """
    distance, leaf = phalanx_distance(hand, tree, finger, phalanx, np.inf, work)
    a, u = work.joints[finger, phalanx], work.direction[finger, phalanx]
    dx, dy, dz = tree.x[leaf] - a[0], tree.y[leaf] - a[1], tree.z[leaf] - a[2]
    s = round_cone_parameter(
        dx, dy, dz, u[0], u[1], u[2], hand.tan_slope[finger, phalanx], hand.inverse_length[finger, phalanx]
    )
    along = s * hand.length[finger, phalanx]
    nx, ny, nz = along * u[0] - dx, along * u[1] - dy, along * u[2] - dz
    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
    scale = 1.0 / norm if norm > 0.0 else 0.0
    normal_out[0], normal_out[1], normal_out[2] = scale * nx, scale * ny, scale * nz
    return distance
