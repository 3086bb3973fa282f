"""Descent of one ball: it moves to where the micro-triangles that it has to cover cost it less.

Its cost as a function of its centre c is (distance of the farthest corner) − depth(c). A subgradient is the unit vector
from that corner to c, less the unit vector from the closest surface point to c. The cost has kinks, above all on the
medial axis, where good balls lie, and a step along one subgradient fails there. So the subgradients of failed steps are
kept, and the next step goes against the shortest vector of their hull (a bundle method: Wolfe, 1975).
"""

import math

import numpy as np
from numpy.typing import NDArray

from .inner_ball import depth_at
from .jit import jit
from .mesh_bvh import MeshBvh
from .micro_triangle import MicroTriangles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_BUNDLE = 8
_HULL_STEPS = 24
_STATIONARY = 0.03

WORK = _BUNDLE + 3
"""Rows of workspace that `descend_ball` needs."""


@jit
def _shortest_in_hull(vectors: Array, shortest_out: Array) -> float:
    """Find about the shortest vector of the hull of vectors (Gilbert, 1966); return its length."""
    count = vectors.shape[0]
    last = count - 1
    x, y, z = vectors[last, 0], vectors[last, 1], vectors[last, 2]
    for _ in range(_HULL_STEPS):
        least, chosen = np.inf, 0
        for i in range(count):
            along = vectors[i, 0] * x + vectors[i, 1] * y + vectors[i, 2] * z
            if along < least:
                least, chosen = along, i
        length2 = x * x + y * y + z * z
        if length2 - least <= 1e-3 * length2:
            break
        dx, dy, dz = vectors[chosen, 0] - x, vectors[chosen, 1] - y, vectors[chosen, 2] - z
        t = min(1.0, (length2 - least) / (dx * dx + dy * dy + dz * dz))
        x, y, z = x + t * dx, y + t * dy, z + t * dz
    shortest_out[0], shortest_out[1], shortest_out[2] = x, y, z
    return math.sqrt(x * x + y * y + z * z)


@jit
def _evaluate(
    bvh: MeshBvh,
    micro: MicroTriangles,
    members: Indices,
    x: float,
    y: float,
    z: float,
    limit2: float,
    stack: Indices,
    stack_distance2: Array,
    subgradient_out: Array,
    closest_out: Array,
) -> tuple[float, float]:
    """Cost and depth [m] of a ball centred at (x, y, z) for the micro-triangles `members`."""
    far2 = -1.0
    fx = fy = fz = 0.0
    for i in members:
        t = micro.corner[i]
        for v in range(0, 9, 3):
            dx, dy, dz = x - t[v], y - t[v + 1], z - t[v + 2]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 > far2:
                far2, fx, fy, fz = d2, dx, dy, dz
    depth, qx, qy, qz = depth_at(bvh, x, y, z, limit2, stack, stack_distance2)
    far = math.sqrt(far2)
    inverse = 1.0 / far if far > 0.0 else 0.0
    back = 1.0 / depth if depth != 0.0 else 0.0
    subgradient_out[0] = fx * inverse - (x - qx) * back
    subgradient_out[1] = fy * inverse - (y - qy) * back
    subgradient_out[2] = fz * inverse - (z - qz) * back
    closest_out[0], closest_out[1], closest_out[2] = qx, qy, qz
    return far - depth, depth


@jit
def descend_ball(
    bvh: MeshBvh,
    micro: MicroTriangles,
    members: Indices,
    trials: int,
    step: float,
    center: Array,
    work: Array,
    stack: Indices,
    stack_distance2: Array,
) -> tuple[float, float, float, int]:
    """Move a ball by at most `trials` steps.

    Args:
        bvh: over the mesh.
        micro: the micro-triangles.
        members: those that the ball has to cover, at least one.
        trials: steps to try.
        step: length of the first [m]; not positive for a guess.
        center: of the ball [m], shape (3,); moved in place, never out of the solid.
        work: workspace, shape (WORK, 3).
        stack, stack_distance2: workspace, shape (STACK,).

    Returns:
        (cost [m], depth [m], length of the next step [m], number of good steps).
    """
    direction, closest, trial_closest = work[_BUNDLE], work[_BUNDLE + 1], work[_BUNDLE + 2]
    x, y, z = center[0], center[1], center[2]
    # Row 0 of the bundle is the subgradient at the centre.
    cost, depth = _evaluate(bvh, micro, members, x, y, z, np.inf, stack, stack_distance2, work[0], closest)
    kept, good = 1, 0
    if step <= 0.0:
        step = 0.5 * math.sqrt(max(cost, 0.0) * max(2.0 * depth + cost, 0.0))
    for _ in range(trials):
        length = _shortest_in_hull(work[:kept], direction)
        if depth <= 0.0:
            break
        if length < _STATIONARY:
            # Stationary for steps of this length, whose subgradients are in the hull; perhaps not for shorter ones.
            if kept == 1:
                break
            kept = 1
            step *= 0.3
            continue
        # Nine tenths of the depth: the centre stays inside.
        scale = min(step, 0.9 * depth) / length
        tx, ty, tz = x - scale * direction[0], y - scale * direction[1], z - scale * direction[2]
        dx, dy, dz = tx - closest[0], ty - closest[1], tz - closest[2]
        limit2 = (dx * dx + dy * dy + dz * dz) * (1.0 + 1e-9)
        slot = kept
        if kept == _BUNDLE:
            slot = _BUNDLE - 1
            for i in range(1, slot):
                for k in range(3):
                    work[i, k] = work[i + 1, k]
        trial_cost, trial_depth = _evaluate(
            bvh, micro, members, tx, ty, tz, limit2, stack, stack_distance2, work[slot], trial_closest
        )
        if trial_depth > 0.0 and trial_cost < cost - 1e-6 * abs(cost):
            x, y, z, cost, depth = tx, ty, tz, trial_cost, trial_depth
            for k in range(3):
                closest[k] = trial_closest[k]
                work[0, k] = work[slot, k]
            kept = 1
            step *= 1.3
            good += 1
        else:
            kept = slot + 1
            step *= 0.7
    center[0], center[1], center[2] = x, y, z
    return cost, depth, max(step, 1e-3 * max(cost, 0.0)), good
