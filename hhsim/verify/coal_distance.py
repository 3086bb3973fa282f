"""The referee's distances to leaf spheres and triangles, held against an established collision library, coal.

Coal knows no round cones, but segments: the union of spheres along an axis is min over s of d(x(s)) − r(s) away, and
coal's d over a piece of the axis bounds that from below. The piece with the lowest bound is halved until the bounds
meet, as in `hhsim.verify.mesh_distance` for the mesh.
"""

import heapq
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.mesh.mesh import Mesh

EXACT = 1e-9
"""Bounds this near to each other [m] have met."""
_MOST_PIECES = 1000
"""Far more than bounds take to meet but where an axis lies along an edge: 200 left 3 nm between them there."""


Shape = tuple[Any, Any]
"""One of coal's shapes, and where it is."""


def sphere_shapes(center: FloatArray, radius: FloatArray) -> Callable[[int], Shape]:
    """Spheres by their number; centres [m] (L, 3), radii [m] (L,)."""
    import coal

    return lambda i: (coal.Sphere(float(radius[i])), coal.Transform3s(np.eye(3), np.array(center[i])))


def triangle_shapes(mesh: Mesh) -> Callable[[int], Shape]:
    """Triangles of a mesh by their number, each as a hierarchy of one: coal has no distance of a triangle alone."""
    import coal

    def shape(i: int) -> Shape:
        model: Any = coal.BVHModelOBBRSS()
        model.beginModel(1, 3)
        model.addVertices(np.array(mesh.triangles[i]))
        model.addTriangles(np.array([[0, 1, 2]]))
        model.endModel()
        return model, coal.Transform3s()

    return shape


def coal_distance(a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, shape: Any, place: Any) -> float:
    """Signed distance [m] of the hull of two spheres to a sphere or a triangle, at most `EXACT` too large.

    Args:
        a, b: Centres of the spheres [m], shape (3,).
        radius_a, radius_b: Theirs [m].
        shape: Of coal.
    """
    import coal

    request, answer = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = 1e-12

    def apart(low: float, high: float) -> float:
        first, last = a + low * (b - a), a + high * (b - a)
        answer.clear()
        piece: Any = coal.Capsule(0.0, float(np.linalg.norm(last - first)))
        there = coal.Transform3s(frame_along(b - a), 0.5 * (first + last))
        return float(coal.distance(shape, place, piece, there, request, answer))

    def size(share: float) -> float:
        return radius_a + share * (radius_b - radius_a)

    best = min(apart(0.0, 0.0) - radius_a, apart(1.0, 1.0) - radius_b)
    pieces = [(apart(0.0, 1.0) - max(radius_a, radius_b), 0.0, 1.0)]
    for _ in range(_MOST_PIECES):
        bound, low, high = heapq.heappop(pieces)
        if bound >= best - EXACT:
            break
        middle = 0.5 * (low + high)
        best = min(best, apart(middle, middle) - size(middle))
        for start, end in ((low, middle), (middle, high)):
            heapq.heappush(pieces, (apart(start, end) - max(size(start), size(end)), start, end))
    return best


def frame_along(axis: FloatArray) -> FloatArray:
    """A rotation that turns z along an axis [m], shape (3, 3); any about it, and any for an axis of no length."""
    x, y, z = axis.tolist()
    length = math.hypot(x, y, z)
    if length == 0.0:
        return np.eye(3)
    x, y, z = x / length, y / length, z / length
    # Across the coordinate axis that is farthest from this one; by hand, since numpy takes most of a query for it.
    if abs(x) <= min(abs(y), abs(z)):
        side = math.hypot(y, z)
        i, j, k = 0.0, z / side, -y / side
    elif abs(y) <= abs(z):
        side = math.hypot(x, z)
        i, j, k = -z / side, 0.0, x / side
    else:
        side = math.hypot(x, y)
        i, j, k = y / side, -x / side, 0.0
    return np.array([[i, y * k - z * j, x], [j, z * i - x * k, y], [k, x * j - y * i, z]])
