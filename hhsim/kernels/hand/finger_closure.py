"""Geometric search of a trajectory script: the travel of a hand, and the closing of a finger, up to contact.

Both searches step by conservative advancement: a body that is d away and whose points move at most v a unit of the
motion stays clear for d / v units. So no feature is stepped over, however thin, and there is no step size to choose.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.hand.kinematics import (
    BODY_COUNT,
    PALM_BODY,
    PHALANX_COUNT,
    HandArrays,
    forward_kinematics,
    phalanx_cone,
    placed_sphere,
)
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating, jit_inline
from hhsim.kernels.round_cone import round_cone_parameter, sphere_cone
from hhsim.kernels.sphere_tree import TreeArrays, nearest_piece

CONTACT = 2e-5
"""Distance [m] at which a body counts as touching and the advancement stops."""
STEP_LIMIT = 400
"""Largest number of steps: a search that creeps along a surface ends short of contact, and therefore clear."""


class ClosureWork(NamedTuple):
    """Hand and object of a search, and its workspace: the kinematics of the hand, world, and the tree walk's stack."""

    hand: HandArrays
    tree: TreeArrays
    joints: Array  # joint and tip centres [m], (5, 4, 3)
    direction: Array  # unit axis of each phalanx, (5, 3, 3)
    axis: Array  # unit flexion axes, (5, 3)
    abduction_axis: Array  # unit, (5, 3)
    stack: Indices  # (STACK_SIZE,)


@jit_inline
def _place(position: Array, rotation: Array, flexion: Array, abduction: Array, work: ClosureWork) -> None:
    hand, _, joints, direction, axis, abduction_axis, _ = work
    forward_kinematics(hand, position, rotation, flexion, abduction, joints, direction, axis, abduction_axis)


@jit
def phalanx_distance(finger: int, phalanx: int, limit: float, work: ClosureWork) -> tuple[float, int]:
    """Compute the least signed distance [m] of a phalanx to the leaves, and that leaf's node; (limit, -1) if none."""
    cone = phalanx_cone(work.hand, work.joints, work.direction, finger, phalanx)
    distance, leaf, _ = nearest_piece(work.tree, cone, limit, work.stack)
    return distance, leaf


@jit
def sphere_distance(center: Array, radius: float, limit: float, work: ClosureWork) -> float:
    """Compute the least signed distance [m] of a sphere to the leaves; `limit` if none is nearer."""
    cone = sphere_cone(center[0], center[1], center[2], radius)
    return nearest_piece(work.tree, cone, limit, work.stack)[0]


@jit
def _body_distance(position: Array, rotation: Array, body: int, limit: float, work: ClosureWork) -> float:
    """Compute the least signed distance [m] of a phalanx or of the palm's leaf spheres to the tree's leaves."""
    if body < PALM_BODY:
        return phalanx_distance(body // PHALANX_COUNT, body % PHALANX_COUNT, limit, work)[0]
    best, hand = limit, work.hand
    for i in range(hand.palm_x.shape[0]):
        x, y, z, radius = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i], hand.palm_radius[i]
        cone = placed_sphere(position, rotation, x, y, z, radius)
        best = nearest_piece(work.tree, cone, best, work.stack)[0]
    return best


@jit
def body_distances(
    position: Array, rotation: Array, flexion: Array, abduction: Array, work: ClosureWork, distance_out: Array
) -> None:
    """Compute the signed distance [m] of every body to the tree's leaves; shape (16,)."""
    _place(position, rotation, flexion, abduction, work)
    for body in range(BODY_COUNT):
        distance_out[body] = _body_distance(position, rotation, body, np.inf, work)


@jit_allocating
def advance_hand(
    position: Array,
    rotation: Array,
    flexion: Array,
    abduction: Array,
    direction: Array,
    gap: Array,
    travel_limit: float,
    work: ClosureWork,
) -> tuple[float, int]:
    """Compute the travel [m] of the rigid hand along a unit direction until a body is within its gap of the object.

    Position and rotation are the palm's at the start, world; `gap` [m] has shape (16,). Returns the travel and the body
    that stopped it, -1 if none did within the limit.
    """
    travel = 0.0
    blocking = PALM_BODY
    here = np.empty(3)
    for _ in range(STEP_LIMIT):
        for i in range(3):
            here[i] = position[i] + travel * direction[i]
        _place(here, rotation, flexion, abduction, work)
        slack = np.inf
        # The body that was nearest bounds the search of all the others: start with it.
        first = blocking
        for k in range(BODY_COUNT):
            body = (first + k) % BODY_COUNT
            limit = slack + gap[body]
            distance = _body_distance(here, rotation, body, limit, work)
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
    position: Array,
    rotation: Array,
    finger: int,
    rate: Array,
    abduction: Array,
    flexion: Array,
    work: ClosureWork,
    touching_out: Array,
) -> None:
    """Close a finger like one driven by a tendon: a phalanx that touches stops, those beyond it go on.

    `rate` is the share of each joint in the motion, not negative, shape (3,). The finger's row of `flexion` [rad],
    shape (5, 3), is closed in place up to contact or the joint limits; its row of `touching_out`, shape (5, 3), becomes
    1 for a phalanx in contact, else 0.
    """
    hand, speed = work.hand, np.empty(PHALANX_COUNT)
    for k in range(PHALANX_COUNT):
        speed[k] = rate[k]
        touching_out[finger, k] = 0.0
    for _ in range(STEP_LIMIT):
        _place(position, rotation, flexion, abduction, work)
        step = np.inf
        for k in range(PHALANX_COUNT):
            if speed[k] > 0.0:
                step = min(step, (hand.flexion_max[finger, k] - flexion[finger, k]) / speed[k])
        # From the tip down: a phalanx that touches stops itself and those below it, not those above.
        for k in range(PHALANX_COUNT - 1, -1, -1):
            if touching_out[finger, k] > 0.0:
                continue
            motion = 0.0
            for i in range(k + 1):
                motion += speed[i] * hand.lever[finger, k, i]
            limit = 2.0 * CONTACT if motion == 0.0 else step * motion + 2.0 * CONTACT
            distance, _ = phalanx_distance(finger, k, limit, work)
            if distance <= CONTACT:
                touching_out[finger, k] = 1.0
                for i in range(k + 1):
                    speed[i] = 0.0
            elif motion > 0.0:
                step = min(step, distance / motion)
        if speed[0] + speed[1] + speed[2] == 0.0:
            return
        for k in range(PHALANX_COUNT):
            flexion[finger, k] = min(flexion[finger, k] + step * speed[k], hand.flexion_max[finger, k])
            if flexion[finger, k] >= hand.flexion_max[finger, k] - 1e-9:
                speed[k] = 0.0


@jit_allocating
def deepen_finger(finger: int, rate: Array, abduction: Array, depth: float, flexion: Array, work: ClosureWork) -> float:
    """Flex a finger until its tip is `depth` [m] from where it was, or the joint limits end it; return that distance.

    `rate` is as in `close_finger`; the finger's row of `flexion` [rad], shape (5, 3), is changed in place.
    """
    hand, origin, upright = work.hand, np.zeros(3), np.eye(3)
    start = flexion[finger].copy()
    before = np.empty(3)
    low, high = 0.0, 0.0
    for k in range(PHALANX_COUNT):
        if rate[k] > 0.0:
            high = max(high, (hand.flexion_max[finger, k] - start[k]) / rate[k])
    moved = 0.0
    # The first round measures the start, the second the limits, the others bisect.
    for iteration in range(52):
        amount = low if iteration == 0 else high if iteration == 1 else 0.5 * (low + high)
        for k in range(PHALANX_COUNT):
            flexion[finger, k] = min(start[k] + amount * rate[k], max(start[k], hand.flexion_max[finger, k]))
        _place(origin, upright, flexion, abduction, work)
        tip = work.joints[finger, PHALANX_COUNT]
        if iteration == 0:
            before[:] = tip
            continue
        moved = math.sqrt((tip[0] - before[0]) ** 2 + (tip[1] - before[1]) ** 2 + (tip[2] - before[2]) ** 2)
        if iteration == 1:
            if moved <= depth:
                return moved
        elif moved < depth:
            low = amount
        else:
            high = amount
    return moved


@jit
def contact_normal(finger: int, phalanx: int, work: ClosureWork, normal_out: Array) -> float:
    """Compute a phalanx's signed distance [m] to the nearest leaf and the normal from it, world, as `work` has it."""
    distance, leaf = phalanx_distance(finger, phalanx, np.inf, work)
    tree, cone = work.tree, phalanx_cone(work.hand, work.joints, work.direction, finger, phalanx)
    dx, dy, dz = tree.x[leaf] - cone.x, tree.y[leaf] - cone.y, tree.z[leaf] - cone.z
    s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
    along = s * cone.length
    nx, ny, nz = along * cone.ux - dx, along * cone.uy - dy, along * cone.uz - dz
    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
    scale = 1.0 / norm if norm > 0.0 else 0.0
    normal_out[0], normal_out[1], normal_out[2] = scale * nx, scale * ny, scale * nz
    return distance
