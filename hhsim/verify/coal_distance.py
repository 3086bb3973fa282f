"""The referee's distances to leaf spheres and triangles, held against an established collision library, coal.

Coal knows no round cones, but balls: the union of balls along an axis is min over s of d(x(s)) − r(s) away. A sphere
and a triangle are convex, so d is convex along the axis, and its tangents, by coal's nearest points, bound it from
below. The next place that is asked is where two tangents meet, until they meet at what was found.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.mesh.mesh import Mesh

EXACT = 1e-9
"""Bounds this near to each other [m] have met."""
_MOST_PLACES = 200
"""Far more than bounds take to meet."""
NO_AREA = 1e-12
"""A triangle that is no higher than this share of its longest side is a line: less than `EXACT` is lost on it."""

Shape = tuple[Any, Any]
"""One of coal's shapes, and where it is."""


def sphere_shapes(center: FloatArray, radius: FloatArray) -> Callable[[int], Shape]:
    """Spheres by their number; centres [m] (L, 3), radii [m] (L,)."""
    import coal

    return lambda i: (coal.Sphere(float(radius[i])), coal.Transform3s(np.eye(3), np.array(center[i])))


def triangle_shapes(mesh: Mesh) -> Callable[[int], Shape]:
    """Triangles of a mesh by their number, each as a hierarchy of one: coal has no distance of a triangle alone.

    Of one without area it says that everything touches it: that is a line.
    """
    import coal

    def shape(i: int) -> Shape:
        corners = mesh.triangles[i]
        sides = np.roll(corners, -1, axis=0) - corners
        square = (sides * sides).sum(axis=1)
        longest = int(square.argmax())
        if np.linalg.norm(np.cross(sides[0], sides[1])) <= NO_AREA * square[longest]:
            middle = corners[longest] + 0.5 * sides[longest]
            length = math.sqrt(square[longest])
            return coal.Capsule(0.0, length), coal.Transform3s(frame_along(sides[longest]), middle)
        model: Any = coal.BVHModelOBBRSS()
        model.beginModel(1, 3)
        model.addVertices(np.array(mesh.triangles[i]))
        model.addTriangles(np.array([[0, 1, 2]]))
        model.endModel()
        return model, coal.Transform3s()

    return shape


def coal_distance(a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, shape: Any, place: Any) -> float:
    """Signed distance [m] of the hull of two balls to a sphere or a triangle, at most `EXACT` too large.

    Args:
        a, b: Centres of the spheres [m], shape (3,).
        radius_a, radius_b: Theirs [m].
        shape: Of coal.
    """
    import coal

    request, answer, ball, there = coal.DistanceRequest(), coal.DistanceResult(), coal.Sphere(0.0), coal.Transform3s()
    request.gjk_tolerance = 1e-12
    axis, drop = b - a, radius_b - radius_a

    def tangent(share: float) -> tuple[float, float, float]:
        """The place, the distance there and its slope."""
        at = a + share * axis
        there.setTranslation(at)
        answer.clear()
        distance = float(coal.distance(shape, place, ball, there, request, answer))
        away = at - np.array(answer.getNearestPoint1())
        # Inside of a sphere the nearest point is farther out.
        slope = float(away @ axis) / (math.copysign(float(np.linalg.norm(away)), distance) or math.inf)
        return share, distance - radius_a - share * drop, slope - drop

    low, high = tangent(0.0), tangent(1.0)
    best = min(low[1], high[1])
    for _ in range(_MOST_PLACES):
        if low[2] >= 0.0 or high[2] <= 0.0:
            break
        share = (high[1] - low[1] + low[2] * low[0] - high[2] * high[0]) / (low[2] - high[2])
        if best <= low[1] + low[2] * (share - low[0]) + EXACT:
            break
        found = tangent(share)
        best = min(best, found[1])
        low, high = (found, high) if found[2] < 0.0 else (low, found)
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
