"""Distances of the hand to leaf spheres and triangles by the collision library coal.

Coal has no round cones but balls: the cone's distance is the minimum of d(x(s)) − r(s) along its axis. d is convex, so
its tangents, from coal's nearest points, bound it from below; the next s is where two tangents meet.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh

EXACT = 1e-9
"""Tolerance of the bounds of a distance [m]."""
_MOST_PLACES = 200
NO_AREA = 1e-12
"""Ratio of a triangle's height to its longest side below which it is a line; less than `EXACT` is lost on it."""

Shape = tuple[Any, Any]
"""Shape of coal and its placement."""


def require_coal() -> None:
    """Raise InputError if coal is not installed."""
    try:
        import coal  # noqa: F401
    except ImportError as error:
        raise InputError(
            "distances to the true mesh are measured with coal, which is not installed: pip install 'hhsim[verify]'"
        ) from error


def coal_model(vertices: FloatArray, faces: IntArray) -> Any:
    """Build coal's bounding-volume hierarchy of a mesh."""
    import coal

    model: Any = coal.BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addVertices(np.array(vertices))
    model.addTriangles(np.array(faces))
    model.endModel()
    return model


def sphere_shapes(center: FloatArray, radius: FloatArray) -> Callable[[int], Shape]:
    """Return a function from a sphere's index to its shape; centres [m] (L, 3), radii [m] (L,)."""
    import coal

    return lambda i: (coal.Sphere(float(radius[i])), coal.Transform3s(np.eye(3), np.array(center[i])))


def triangle_shapes(mesh: Mesh) -> Callable[[int], Shape]:
    """Return a function from a triangle's index to its shape: a hierarchy of one triangle, or a line without area.

    Coal has no distance of a lone triangle, and none of one without area.
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
        return coal_model(corners, np.array([[0, 1, 2]])), coal.Transform3s()

    return shape


def coal_distance(a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, shape: Any, place: Any) -> float:
    """Signed distance [m] of the hull of two balls to a shape of coal, at most `EXACT` too large.

    `a`, `b` are the centres of the balls [m], shape (3,), with their radii [m].
    """
    import coal

    request, answer, ball, there = coal.DistanceRequest(), coal.DistanceResult(), coal.Sphere(0.0), coal.Transform3s()
    request.gjk_tolerance = 1e-12
    axis, drop = b - a, radius_b - radius_a

    def tangent(share: float) -> tuple[float, float, float]:
        """Share of the axis, distance there and slope."""
        at = a + share * axis
        there.setTranslation(at)
        answer.clear()
        distance = float(coal.distance(shape, place, ball, there, request, answer))
        away = at - np.array(answer.getNearestPoint1())
        # Inside a sphere the nearest point is farther out.
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
    """A rotation that turns z along an axis [m], shape (3, 3); the identity for an axis of no length."""
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
