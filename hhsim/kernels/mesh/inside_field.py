"""Inside of an open or closed surface, by winding number above ½ or a sheet nearby; crossings of segments with it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh, closest_on_mesh
from hhsim.kernels.mesh.winding_number import WindingMoments, winding_at
from hhsim.kernels.triangle import ray_crossing

Bools = NDArray[np.bool_]

_MOST_HITS = 16
_HALVINGS = 12
_STEP = 1e-6
"""Share of a segment before and behind a triangle at which the inside is evaluated."""


class SolidField(NamedTuple):
    """A solid: enclosing triangles, wound outward, and sheets with a thickness."""

    bvh: MeshBvh
    moments: WindingMoments  # of `bvh`
    sheet: MeshBvh  # triangles of sheets
    half: float  # half their thickness [m], negative for no sheets


@jit
def inside_at(field: SolidField, x: float, y: float, z: float, stack: Indices, stack_distance2: Array) -> bool:
    """Return True if a point [m] lies inside."""
    half2 = field.half * field.half
    if field.half > 0.0 and closest_on_mesh(field.sheet, x, y, z, half2, stack, stack_distance2)[0] >= 0:
        return True
    return bool(winding_at(field.bvh, field.moments, x, y, z, stack) > 0.5)


@jit_allocating
def inside(field: SolidField, points: Array, inside_out: Bools) -> None:
    """Mark the points [m], shape (n, 3), that lie inside."""
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    for i in range(points.shape[0]):
        inside_out[i] = inside_at(field, points[i, 0], points[i, 1], points[i, 2], stack, stack_distance2)


@jit_allocating
def near(bvh: MeshBvh, points: Array, distance: float, near_out: Bools) -> None:
    """Mark the points [m], shape (n, 3), that have a triangle within a distance [m]."""
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        near_out[i] = closest_on_mesh(bvh, x, y, z, distance * distance, stack, stack_distance2)[0] >= 0


@jit_inline
def _meets_box(box: Array, p: Array, d: Array) -> bool:
    """Return True if the segment from p along d meets the box with the lowest and the highest corner box[:6]."""
    near, far = 0.0, 1.0
    for k in range(3):
        if d[k] == 0.0:
            if p[k] < box[k] or p[k] > box[3 + k]:
                return False
        else:
            first, second = (box[k] - p[k]) / d[k], (box[3 + k] - p[k]) / d[k]
            if first > second:
                first, second = second, first
            near, far = max(near, first), min(far, second)
            # A tolerance, so that rounding loses no hit in a flat box.
            if near > far + 1e-12:
                return False
    return True


@jit
def segment_hits(bvh: MeshBvh, p: Array, d: Array, stack: Indices, hits: Array) -> int:
    """Find the sorted shares of d at which the segment from p along d meets triangles, as many as fit; count all."""
    count = 0
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if not _meets_box(bvh.bound[node], p, d):
            continue
        if bvh.right[node] < 0:
            for i in range(bvh.start[node], bvh.end[node]):
                s, _ = ray_crossing(bvh.corner[i], p[0], p[1], p[2], d[0], d[1], d[2])
                if 0.0 < s < 1.0:
                    if count < hits.shape[0]:
                        j = count
                        while j > 0 and hits[j - 1] > s:
                            hits[j] = hits[j - 1]
                            j -= 1
                        hits[j] = s
                    count += 1
        else:
            stack[top], stack[top + 1] = bvh.right[node], node + 1
            top += 2
    return count


@jit_allocating
def count_hits(bvh: MeshBvh, start: Array, along: Array, count_out: Indices) -> None:
    """Count the triangles that each segment meets, from `start` along `along` [m], shapes (n, 3)."""
    stack, hits = np.empty(STACK, np.int64), np.empty(1)
    for i in range(start.shape[0]):
        count_out[i] = segment_hits(bvh, start[i], along[i], stack, hits)


@jit_inline
def _inside_on(field: SolidField, p: Array, d: Array, s: float, stack: Indices, stack_distance2: Array) -> bool:
    return inside_at(field, p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2], stack, stack_distance2)


@jit_allocating
def leave_inside(field: SolidField, start: Array, end: Array, share_out: Array) -> None:
    """Compute the share, between 0 and 1, at which each segment from inside to outside [m] first leaves the inside.

    Exact where it meets a triangle, and by bisection where the inside ends without one.
    """
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    hits = np.empty(_MOST_HITS)
    d = np.empty(3)
    for i in range(start.shape[0]):
        p = start[i]
        for k in range(3):
            d[k] = end[i, k] - p[k]
        count = min(segment_hits(field.bvh, p, d, stack, hits), as_int64(_MOST_HITS))
        low, high = 0.0, 1.0
        # Most segments have one hit, where the inside ends.
        at = hits[0] if count == 1 else -1.0
        if count > 1:
            for j in range(count + 1):
                before = hits[j - 1] if j > 0 else 0.0
                after = hits[j] if j < count else 1.0
                if not after > before:
                    continue
                middle = 0.5 * (before + after)
                if _inside_on(field, p, d, middle, stack, stack_distance2):
                    low = middle
                else:
                    high = middle
                    at = before if j > 0 else -1.0
                    break
        if at > low:
            ahead, behind = max(at - _STEP, low), min(at + _STEP, high)
            if not _inside_on(field, p, d, ahead, stack, stack_distance2):
                high = ahead
            elif not _inside_on(field, p, d, behind, stack, stack_distance2):
                share_out[i] = at
                continue
            else:
                low = behind
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _inside_on(field, p, d, middle, stack, stack_distance2):
                low = middle
            else:
                high = middle
        share_out[i] = 0.5 * (low + high)
