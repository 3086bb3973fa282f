"""Distances of a round cone to a sphere or a triangle by the collision library coal: a second opinion, where installed.

Coal has no round cones but balls: the cone's distance is the minimum of d(x(s)) − r(s) along its axis, with the
distance d, which is convex for a sphere or a triangle.
"""

import math
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.verify.contacts import NO_AREA

EXACT = 1e-9
"""Tolerance of a distance [m]."""

Shape = tuple[Any, Any]
"""Shape of coal and its placement."""


def has_coal() -> bool:
    """Return True if coal is installed."""
    return find_spec("coal") is not None


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
    """Compute the signed distance [m] of the hull of two balls to a shape of coal, at most `EXACT` too large.

    `a`, `b` are the centres of the balls [m], shape (3,), with their radii [m].
    """
    import coal
    from scipy.optimize import minimize_scalar

    request, answer, ball, there = coal.DistanceRequest(), coal.DistanceResult(), coal.Sphere(0.0), coal.Transform3s()
    request.gjk_tolerance = 1e-12

    def distance(share: float) -> float:
        there.setTranslation(a + share * (b - a))
        answer.clear()
        radius = (1.0 - share) * radius_a + share * radius_b
        return float(coal.distance(shape, place, ball, there, request, answer)) - radius

    ends = min(distance(0.0), distance(1.0))
    if np.array_equal(a, b):
        return ends
    # The search looks between the ends, and does not reach them.
    return min(ends, float(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).fun))


def frame_along(axis: FloatArray) -> FloatArray:
    """Return a rotation that turns z along an axis [m], shape (3, 3), by Duff et al. (2017); the identity for none."""
    x, y, z = axis.tolist()
    length = math.hypot(x, y, z)
    if length == 0.0:
        return np.eye(3)
    x, y, z = x / length, y / length, z / length
    sign = math.copysign(1.0, z)
    slope = -1.0 / (sign + z)
    both = x * y * slope
    return np.array([[1.0 + sign * x * x * slope, both, x], [sign * both, sign + y * y * slope, y], [-sign * x, -y, z]])
