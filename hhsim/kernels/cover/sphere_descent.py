"""Descent of one sphere: it moves to where the micro-triangles that it has to cover cost it less.

Its cost as a function of its centre c is (distance of the farthest corner) − depth(c). Both terms have kinks where good
spheres lie: several corners equally far, several places of the surface equally near (the medial axis). So both are
modelled by cuts, planes that touch them: the corners and the nearest places that were met on the way. Each step goes to
the minimum of the model plus a proximal term (a bundle method: Lemaréchal, 1975; Kiwiel, 1990), found in its dual,
whose variables are the weights of the corners and those of the places, each with the sum 1. A step that is worth much
less than the model foresaw adds cuts and makes the next step shorter.
"""

import math

import numpy as np

from hhsim.kernels.cover.inscribed_sphere import depth_at
from hhsim.kernels.cover.micro_triangle import MicroTriangles
from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_allocating, jit_inline
from hhsim.kernels.mesh.bvh import MeshBvh

_FAR = 10
"""Most corners in the model, the first rows of the workspace: position, unit vector from it to the centre, distance
less the largest, weight."""
_NEAR = 8
"""Most places in the model, the next rows: unit vector from it to the centre, depth at the origin, minus the error of
the depth, weight."""
_MODEL_STEPS = 30
_CORNER_ROUNDS = 4
_GOOD = 0.1
_VERY_GOOD = 0.5
_STATIONARY = 1e-3
_LONGEST = 0.9
"""Longest step, as a share of the depth: the centre stays inside."""

WORK = _FAR + _NEAR
"""Rows of workspace, of 8 columns, that `descend_sphere` needs."""


@jit
def _farthest(micro: MicroTriangles, members: Indices, x: float, y: float, z: float) -> tuple[float, int, int]:
    """Squared distance [m²] of the farthest corner from (x, y, z), its micro-triangle and its first column."""
    far2, which, column = -1.0, 0, 0
    for i in members:
        t = micro.corner[i]
        for v in range(0, 9, 3):
            dx, dy, dz = x - t[v], y - t[v + 1], z - t[v + 2]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 > far2:
                far2, which, column = d2, i, v
    return far2, which, column


@jit_inline
def _room_in(work: Array, begin: int, count: int, most: int, weight: int) -> int:
    """Row for a new cut: the next free one, or that of the cut with the least weight."""
    if count < most:
        return begin + count
    least = begin
    for i in range(begin, begin + most):
        if work[i, weight] < work[least, weight]:
            least = i
    return least


@jit
def _aim(work: Array, begin: int, count: int, value: int, weight: int, sign: float, t: float, w: Array) -> float:
    """Shift weight from the worst to the best cut of one group; return how far from the optimum they were."""
    best, worst = -1, -1
    least, most = np.inf, -np.inf
    for i in range(begin, begin + count):
        slope = sign * t * (work[i, value - 3] * w[0] + work[i, value - 2] * w[1] + work[i, value - 1] * w[2])
        slope -= work[i, value + (0 if sign > 0.0 else 1)]
        if slope < least:
            least, best = slope, i
        if work[i, weight] > 0.0 and slope > most:
            most, worst = slope, i
    if best == worst:
        return 0.0
    dx = work[best, value - 3] - work[worst, value - 3]
    dy = work[best, value - 2] - work[worst, value - 2]
    dz = work[best, value - 1] - work[worst, value - 1]
    length2 = dx * dx + dy * dy + dz * dz
    share = work[worst, weight]
    if most - least < share * t * length2:
        share = (most - least) / (t * length2)
    work[best, weight] += share
    work[worst, weight] = 0.0 if share >= work[worst, weight] else work[worst, weight] - share
    w[0] += sign * share * dx
    w[1] += sign * share * dy
    w[2] += sign * share * dz
    return most - least


@jit_allocating
def descend_sphere(
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
    """Move a sphere by at most `trials` steps.

    Args:
        bvh: Over the mesh.
        micro: The micro-triangles.
        members: Those that the sphere has to cover, at least one.
        trials: Steps to try.
        step: Proximal length of the first [m]; not positive for a guess.
        center: Of the sphere [m], shape (3,); moved in place, never out of the solid.
        work: Workspace, shape (WORK, 8).
        stack, stack_distance2: Workspace, shape (STACK,).

    Returns:
        (cost [m], depth [m], proximal length of the next step [m], number of good steps).
    """
    x, y, z = center[0], center[1], center[2]
    far2, which, column = _farthest(micro, members, x, y, z)
    far = math.sqrt(far2)
    depth, qx, qy, qz = depth_at(bvh, x, y, z, np.inf, stack, stack_distance2)
    cost = far - depth
    if not (depth > 0.0 and far > 0.0):
        return cost, depth, max(step, 0.0), 0
    if step <= 0.0:
        step = 0.5 * far
    for k in range(3):
        work[0, k] = micro.corner[which, column + k]
    work[0, 7] = 1.0
    near = work[_FAR]
    near[0], near[1], near[2] = (x - qx) / depth, (y - qy) / depth, (z - qz) / depth
    near[3] = depth - (near[0] * x + near[1] * y + near[2] * z)
    near[5] = 1.0
    fars, nears, good = as_int64(1), as_int64(1), 0
    w = np.empty(3)
    for _ in range(trials):
        # Values and slopes of the cuts at the centre.
        for i in range(fars):
            cut = work[i]
            dx, dy, dz = x - cut[0], y - cut[1], z - cut[2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            inverse = 1.0 / distance if distance > 0.0 else 0.0
            cut[3], cut[4], cut[5], cut[6] = dx * inverse, dy * inverse, dz * inverse, distance - far
        for i in range(_FAR, _FAR + nears):
            cut = work[i]
            # Depth is not concave: a cut that is off at the centre counts as if it were off to the safe side.
            cut[4] = -abs(cut[3] + cut[0] * x + cut[1] * y + cut[2] * z - depth)
        tx = ty = tz = trial_far = foreseen = 0.0
        for corner_round in range(_CORNER_ROUNDS):
            w[:] = 0.0
            for i in range(fars):
                for k in range(3):
                    w[k] += work[i, 7] * work[i, 3 + k]
            for i in range(_FAR, _FAR + nears):
                for k in range(3):
                    w[k] -= work[i, 5] * work[i, k]
            for _ in range(_MODEL_STEPS):
                off = _aim(work, as_int64(0), fars, as_int64(6), as_int64(7), 1.0, step, w)
                off += _aim(work, as_int64(_FAR), nears, as_int64(3), as_int64(5), -1.0, step, w)
                if off <= 1e-3 * _STATIONARY * abs(cost):
                    break
            length = step * math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            scale = step if length <= _LONGEST * depth else step * _LONGEST * depth / length
            sx, sy, sz = -scale * w[0], -scale * w[1], -scale * w[2]
            high, low = -np.inf, -np.inf
            for i in range(fars):
                high = max(high, work[i, 6] + work[i, 3] * sx + work[i, 4] * sy + work[i, 5] * sz)
            for i in range(_FAR, _FAR + nears):
                low = max(low, work[i, 4] - work[i, 0] * sx - work[i, 1] * sy - work[i, 2] * sz)
            foreseen = -(high + low)
            if foreseen <= _STATIONARY * abs(cost):
                break
            tx, ty, tz = x + sx, y + sy, z + sz
            far2, which, column = _farthest(micro, members, tx, ty, tz)
            trial_far = math.sqrt(far2)
            if trial_far - far <= high + 0.25 * foreseen or corner_round + 1 == _CORNER_ROUNDS:
                break
            # A corner that the model did not know is farther: with it, before the surface is asked.
            row = _room_in(work, as_int64(0), fars, as_int64(_FAR), as_int64(7))
            if row == fars:
                fars += 1
            else:
                work[row, 7] = 0.0
            cut = work[row]
            for k in range(3):
                cut[k] = micro.corner[which, column + k]
            dx, dy, dz = x - cut[0], y - cut[1], z - cut[2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            inverse = 1.0 / distance if distance > 0.0 else 0.0
            cut[3], cut[4], cut[5], cut[6], cut[7] = dx * inverse, dy * inverse, dz * inverse, distance - far, 0.0
            total = 0.0
            for i in range(fars):
                total += work[i, 7]
            if total <= 0.0:
                cut[7] = 1.0
            else:
                for i in range(fars):
                    work[i, 7] /= total
        if foreseen <= _STATIONARY * abs(cost):
            break
        dx, dy, dz = tx - qx, ty - qy, tz - qz
        limit2 = (dx * dx + dy * dy + dz * dz) * (1.0 + 1e-9)
        trial_depth, ux, uy, uz = depth_at(bvh, tx, ty, tz, limit2, stack, stack_distance2)
        if not trial_depth > 0.0:
            step *= 0.3
            continue
        row = _room_in(work, as_int64(_FAR), nears, as_int64(_NEAR), as_int64(5))
        if row == _FAR + nears:
            nears += 1
            work[row, 5] = 0.0
        cut = work[row]
        cut[0], cut[1], cut[2] = (tx - ux) / trial_depth, (ty - uy) / trial_depth, (tz - uz) / trial_depth
        cut[3] = trial_depth - (cut[0] * tx + cut[1] * ty + cut[2] * tz)
        total = 0.0
        for i in range(_FAR, _FAR + nears):
            total += work[i, 5]
        if total <= 0.0:
            cut[5] = total = 1.0
        for i in range(_FAR, _FAR + nears):
            work[i, 5] /= total
        gain = cost - (trial_far - trial_depth)
        if gain >= _GOOD * foreseen:
            x, y, z, far, depth = tx, ty, tz, trial_far, trial_depth
            qx, qy, qz = ux, uy, uz
            cost = far - depth
            good += 1
            if gain >= _VERY_GOOD * foreseen:
                step *= 1.5
        else:
            step *= 0.6
    center[0], center[1], center[2] = x, y, z
    return cost, depth, max(step, 1e-3 * far), good
