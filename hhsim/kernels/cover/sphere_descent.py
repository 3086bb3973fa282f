"""Spheres inside a mesh: how deep a centre lies, and the descent to where a sphere protrudes least.

Descent of spheres, each to where the micro-triangles that it has to cover cost it less.

The cost as a function of its centre c is (distance of the farthest corner) − depth(c). Both terms have kinks where good
spheres lie: several corners equally far, several places of the surface equally near (the medial axis). So both are
modelled by cuts, planes that touch them: the corners and the nearest places found so far. Each step goes to the minimum
of the model plus a proximal term (a bundle method: Lemaréchal, 1975; Kiwiel, 1990), found in its dual, whose variables
are the weights of the corners and those of the places, each with the sum 1. A step that gains much less than the model
foresaw adds cuts and makes the next step shorter.
"""

import math

import numpy as np

from hhsim.kernels.cover.certify import MicroTriangles
from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh, beyond, closest_on_mesh, outside, winding_at
from hhsim.kernels.triangle import far_corner2

_SHRINKS = 40
_STRETCHES = 8


UNKNOWN = 0


@jit
def same_side(depth: float, moved2: float) -> int:
    """Return on which side of the surface a point still is that moved by so much [m²] from a depth [m].

    1 is inside, -1 outside, and `UNKNOWN` may be either.
    """
    if not moved2 < depth * depth * (1.0 - 1e-9):
        return UNKNOWN
    return 1 if depth > 0.0 else -1


@jit
def depth_at(
    bvh: MeshBvh,
    x: float,
    y: float,
    z: float,
    limit2: float,
    stack: Indices,
    stack_distance2: Array,
    side: int = UNKNOWN,
) -> tuple[float, float, float, float]:
    """Compute the depth [m], negative outside, −inf beyond the limit, and the closest surface point.

    Where the BVH has moments of the winding number, the sign is that of `side`, and its own if that is `UNKNOWN`.
    """
    triangle, qx, qy, qz, d2, feature = closest_on_mesh(bvh, x, y, z, limit2, stack, stack_distance2)
    if triangle < 0:
        return -np.inf, qx, qy, qz
    depth = math.sqrt(d2)
    if bvh.moments.radius.shape[0] == 0:
        is_outside = outside(bvh, triangle, feature, x - qx, y - qy, z - qz)
    elif side != UNKNOWN:
        is_outside = side < 0
    else:
        is_outside = beyond(bvh, x, y, z) or not winding_at(bvh, x, y, z, stack) > 0.5
    if is_outside:
        depth = -depth
    return depth, qx, qy, qz


@jit
def inscribed_sphere(
    bvh: MeshBvh,
    px: float,
    py: float,
    pz: float,
    nx: float,
    ny: float,
    nz: float,
    radius: float,
    stack: Indices,
    stack_distance2: Array,
) -> tuple[float, float, float, float]:
    """Compute the radius [m] of the largest inner sphere that touches the surface at p with outward normal n.

    It shrinks from `radius` [m] until no surface point lies inside (Ma, Bae and Choi, 2012). Returned with the surface
    point that stopped it.
    """
    sx, sy, sz = px, py, pz
    for _ in range(_SHRINKS):
        cx, cy, cz = px - radius * nx, py - radius * ny, pz - radius * nz
        limit = radius * (1.0 - 1e-9)
        triangle, qx, qy, qz, _, _ = closest_on_mesh(bvh, cx, cy, cz, limit * limit, stack, stack_distance2)
        if triangle < 0:
            break
        dx, dy, dz = px - qx, py - qy, pz - qz
        along = dx * nx + dy * ny + dz * nz
        if not along > 0.0:
            break
        smaller = 0.5 * (dx * dx + dy * dy + dz * dz) / along
        if not smaller < radius:
            break
        radius = smaller
        sx, sy, sz = qx, qy, qz
    return radius, sx, sy, sz


@jit
def place_sphere(
    bvh: MeshBvh,
    micro: MicroTriangles,
    i: int,
    largest: float,
    allowed: float,
    stack: Indices,
    stack_distance2: Array,
    center_out: Array,
) -> float:
    """Place a sphere for micro-triangle i; return its depth [m].

    It starts as the largest inner sphere that touches there, of at most `largest` [m], and then goes deeper along the
    medial axis, away from both points that it touches, while its cost for i stays within `allowed` [m]: a deeper sphere
    covers more around i.
    """
    t = micro.corner[i]
    px, py, pz = (t[0] + t[3] + t[6]) / 3.0, (t[1] + t[4] + t[7]) / 3.0, (t[2] + t[5] + t[8]) / 3.0
    nx, ny, nz = micro.normal[i, 0], micro.normal[i, 1], micro.normal[i, 2]
    radius, sx, sy, sz = inscribed_sphere(bvh, px, py, pz, nx, ny, nz, largest, stack, stack_distance2)
    x, y, z = px - radius * nx, py - radius * ny, pz - radius * nz
    depth, _, _, _ = depth_at(bvh, x, y, z, np.inf, stack, stack_distance2)

    ux, uy, uz = (x - sx) / radius - nx, (y - sy) / radius - ny, (z - sz) / radius - nz
    norm = math.sqrt(ux * ux + uy * uy + uz * uz)
    if norm > 1e-6:
        ux, uy, uz = ux / norm, uy / norm, uz / norm
        x0, y0, z0 = x, y, z
        good, step = 0.0, max(depth, allowed)
        for _ in range(_STRETCHES):
            length = good + step
            tx, ty, tz = x0 + length * ux, y0 + length * uy, z0 + length * uz
            side = same_side(depth, (tx - x) ** 2 + (ty - y) ** 2 + (tz - z) ** 2)
            deeper, _, _, _ = depth_at(bvh, tx, ty, tz, np.inf, stack, stack_distance2, side)
            if deeper > depth and math.sqrt(far_corner2(micro.corner, i, tx, ty, tz)) - deeper <= allowed:
                good, depth = length, deeper
                x, y, z = tx, ty, tz
                step *= 1.5
            else:
                step *= 0.4
    center_out[0], center_out[1], center_out[2] = x, y, z
    return depth


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
    """Find the farthest corner from (x, y, z): squared distance [m²], micro-triangle and first column."""
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
def _free_row(work: Array, begin: int, count: int, most: int, weight: int) -> int:
    """Return the row for a new cut: the next free one, or that of the cut with the least weight."""
    if count < most:
        return begin + count
    least = begin
    for i in range(begin, begin + most):
        if work[i, weight] < work[least, weight]:
            least = i
    return least


@jit_inline
def _normalise(work: Array, begin: int, count: int, row: int, weight: int) -> None:
    """Scale the weights of one group to the sum 1, that of `row` being 1 if all are 0."""
    total = 0.0
    for i in range(begin, begin + count):
        total += work[i, weight]
    if total <= 0.0:
        work[row, weight] = total = 1.0
    for i in range(begin, begin + count):
        work[i, weight] /= total


@jit_inline
def _set_corner(cut: Array, x: float, y: float, z: float, far: float) -> None:
    """Compute slope and value of a corner's cut at the centre."""
    dx, dy, dz = x - cut[0], y - cut[1], z - cut[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / distance if distance > 0.0 else 0.0
    cut[3], cut[4], cut[5], cut[6] = dx * inverse, dy * inverse, dz * inverse, distance - far


@jit
def _aim(work: Array, begin: int, count: int, value: int, weight: int, sign: float, t: float, w: Array) -> float:
    """Shift weight from the worst to the best cut of one group; return their difference from the optimum."""
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


@jit
def _minimise_model(work: Array, fars: int, nears: int, step: float, tolerance: float, w_out: Array) -> None:
    """Find the weights of the minimum of the model plus the proximal term, and the model's slope there."""
    w_out[:] = 0.0
    for i in range(fars):
        for k in range(3):
            w_out[k] += work[i, 7] * work[i, 3 + k]
    for i in range(_FAR, _FAR + nears):
        for k in range(3):
            w_out[k] -= work[i, 5] * work[i, k]
    for _ in range(_MODEL_STEPS):
        off = _aim(work, as_int64(0), fars, as_int64(6), as_int64(7), 1.0, step, w_out)
        off += _aim(work, as_int64(_FAR), nears, as_int64(3), as_int64(5), -1.0, step, w_out)
        if off <= tolerance:
            return


@jit
def _model_values(work: Array, fars: int, nears: int, sx: float, sy: float, sz: float) -> tuple[float, float]:
    """Compute the model's changes of the farthest distance and of minus the depth after a step."""
    high, low = -np.inf, -np.inf
    for i in range(fars):
        high = max(high, work[i, 6] + work[i, 3] * sx + work[i, 4] * sy + work[i, 5] * sz)
    for i in range(_FAR, _FAR + nears):
        low = max(low, work[i, 4] - work[i, 0] * sx - work[i, 1] * sy - work[i, 2] * sz)
    return high, low


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
    """Move a sphere that has to cover the micro-triangles `members`, at least one, by at most `trials` steps.

    `step` is the first proximal length [m], not positive for a guess. The centre [m], shape (3,), moves in place, out
    of no solid that it is in. Workspace has the shapes (WORK, 8) and (STACK,). Returns cost [m], depth [m], the next
    proximal length [m] and the number of good steps.
    """
    x, y, z = center[0], center[1], center[2]
    far2, which, column = _farthest(micro, members, x, y, z)
    far = math.sqrt(far2)
    depth, qx, qy, qz = depth_at(bvh, x, y, z, np.inf, stack, stack_distance2)
    cost = far - depth
    # Only a sheet has spheres outside: a solid's begin in it.
    if not far > 0.0 or (not depth > 0.0 and bvh.moments.radius.shape[0] == 0):
        return cost, depth, max(step, 0.0), 0
    if step <= 0.0:
        step = 0.5 * far
    for k in range(3):
        work[0, k] = micro.corner[which, column + k]
    work[0, 7] = 1.0
    near = work[_FAR]
    inside = depth > 0.0
    divisor = depth if depth != 0.0 else np.inf
    near[0], near[1], near[2] = (x - qx) / divisor, (y - qy) / divisor, (z - qz) / divisor
    near[3] = depth - (near[0] * x + near[1] * y + near[2] * z)
    near[5] = 1.0
    fars, nears, good = as_int64(1), as_int64(1), 0
    w = np.empty(3)
    for _ in range(trials):
        for i in range(fars):
            _set_corner(work[i], x, y, z, far)
        for i in range(_FAR, _FAR + nears):
            cut = work[i]
            # Depth is not concave: a cut that is off at the centre counts as if it were off to the safe side.
            cut[4] = -abs(cut[3] + cut[0] * x + cut[1] * y + cut[2] * z - depth)
        tx = ty = tz = trial_far = foreseen = 0.0
        for corner_round in range(_CORNER_ROUNDS):
            _minimise_model(work, fars, nears, step, 1e-3 * _STATIONARY * abs(cost), w)
            length = step * math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            scale = step
            if inside and length > _LONGEST * depth:
                scale = step * _LONGEST * depth / length
            elif not inside and length > far:
                # A sheet has no inside to stay in.
                scale = step * far / length
            sx, sy, sz = -scale * w[0], -scale * w[1], -scale * w[2]
            high, low = _model_values(work, fars, nears, sx, sy, sz)
            foreseen = -(high + low)
            if foreseen <= _STATIONARY * abs(cost):
                break
            tx, ty, tz = x + sx, y + sy, z + sz
            far2, which, column = _farthest(micro, members, tx, ty, tz)
            trial_far = math.sqrt(far2)
            if trial_far - far <= high + 0.25 * foreseen or corner_round + 1 == _CORNER_ROUNDS:
                break
            # A corner that the model did not know is farther: it enters before the depth is computed.
            row = _free_row(work, as_int64(0), fars, as_int64(_FAR), as_int64(7))
            fars = max(fars, row + 1)
            for k in range(3):
                work[row, k] = micro.corner[which, column + k]
            _set_corner(work[row], x, y, z, far)
            work[row, 7] = 0.0
            _normalise(work, as_int64(0), fars, row, as_int64(7))
        if foreseen <= _STATIONARY * abs(cost):
            break
        dx, dy, dz = tx - qx, ty - qy, tz - qz
        limit2 = (dx * dx + dy * dy + dz * dz) * (1.0 + 1e-9)
        side = same_side(depth, (tx - x) ** 2 + (ty - y) ** 2 + (tz - z) ** 2)
        trial_depth, ux, uy, uz = depth_at(bvh, tx, ty, tz, limit2, stack, stack_distance2, side)
        if inside and not trial_depth > 0.0:
            step *= 0.3
            continue
        row = _free_row(work, as_int64(_FAR), nears, as_int64(_NEAR), as_int64(5))
        if row == _FAR + nears:
            nears += 1
            work[row, 5] = 0.0
        cut = work[row]
        divisor = trial_depth if trial_depth != 0.0 else np.inf
        cut[0], cut[1], cut[2] = (tx - ux) / divisor, (ty - uy) / divisor, (tz - uz) / divisor
        cut[3] = trial_depth - (cut[0] * tx + cut[1] * ty + cut[2] * tz)
        _normalise(work, as_int64(_FAR), nears, row, as_int64(5))
        gain = cost - (trial_far - trial_depth)
        if gain >= _GOOD * foreseen:
            x, y, z, far, depth = tx, ty, tz, trial_far, trial_depth
            qx, qy, qz = ux, uy, uz
            cost = far - depth
            inside = depth > 0.0
            good += 1
            if gain >= _VERY_GOOD * foreseen:
                step *= 1.5
        else:
            step *= 0.6
    center[0], center[1], center[2] = x, y, z
    return cost, depth, max(step, 1e-3 * far), good


@jit_allocating
def move_spheres(
    bvh: MeshBvh,
    micro: MicroTriangles,
    first: Indices,
    order: Indices,
    trials: int,
    center: Array,
    depth: Array,
    step: Array,
) -> int:
    """Move every sphere that has micro-triangles by at most `trials` steps; in place.

    Those of sphere j are order[first[j]:first[j + 1]]. Centres, depths and step lengths are in metres; a new sphere's
    step is not positive. Returns the number of good steps.
    """
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    work = np.empty((WORK, 8))
    total = 0
    for j in range(depth.shape[0]):
        begin, end = first[j], first[j + 1]
        if begin < end:
            _, depth[j], step[j], good = descend_sphere(
                bvh, micro, order[begin:end], trials, step[j], center[j], work, stack, stack_distance2
            )
            total += good
    return total
