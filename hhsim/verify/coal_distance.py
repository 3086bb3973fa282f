"""Distances of a round cone to a sphere or a triangle by the collision library coal: a second opinion, where installed.

Coal has no round cones but balls: the cone's distance is the minimum of d(x(s)) − r(s) along its axis, with the
distance d, which is convex for a sphere or a triangle.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray

EXACT = 1e-9
"""Tolerance of a distance [m]."""


def has_coal() -> bool:
    """Return True if coal is installed."""
    return find_spec("coal") is not None


def coal_model(vertices: FloatArray, faces: IntArray) -> Any:
    """Build coal's bounding-volume hierarchy of a mesh of triangles with areas; coal has no distance of a lone one."""
    import coal

    model: Any = coal.BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addVertices(np.array(vertices))
    model.addTriangles(np.array(faces))
    model.endModel()
    return model


def coal_distance(
    a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, piece: FloatArray, size: float = 0.0
) -> float:
    """Compute the signed distance [m] of the hull of two balls to a triangle or a sphere, at most `EXACT` too large.

    `a`, `b` are the centres of the balls [m], shape (3,), with their radii [m]; `piece` is a triangle's corners [m],
    shape (3, 3), or a sphere's centre, shape (3,), of radius `size` [m].
    """
    import coal
    from scipy.optimize import minimize_scalar

    shape, place = coal.Sphere(float(size)), coal.Transform3s()
    if piece.ndim == 2:
        shape = coal_model(piece, np.array([[0, 1, 2]]))
    else:
        place.setTranslation(np.array(piece))
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
