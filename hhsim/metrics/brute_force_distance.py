"""Distances of a hand to every sphere of an object, by brute force: slow and independent of trees and kernels.

Round cones use the case table of Quilez ("Round cone", 2018), not the clamped axis parameter of the kernels.
"""

import numpy as np

from hhsim.arrays import FloatArray


def round_cone_distance(
    points: FloatArray, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> FloatArray:
    """Signed distance [m] of points (N, 3) to the hull of two spheres, neither inside the other; shape (N,).

    `a`, `b` are the centres [m], shape (3,); `radius_a` [m] is not less than `radius_b`.
    """
    axis = b - a
    square = float(axis @ axis)
    drop = radius_a - radius_b
    slant = square - drop * drop
    p = points - a
    along = p @ axis
    beyond = along - square
    across = p * square - np.outer(along, axis)
    h2 = (across * across).sum(axis=1)
    k = np.sign(drop) * drop * drop * h2
    tip = np.sqrt(h2 + beyond * beyond * square) / square - radius_b
    base = np.sqrt(h2 + along * along * square) / square - radius_a
    side = (np.sqrt(h2 * slant / square) + along * drop) / square - radius_a
    at_tip = np.sign(beyond) * slant * beyond * beyond * square > k
    at_base = np.sign(along) * slant * along * along * square < k
    distance: FloatArray = np.where(at_tip, tip, np.where(at_base, base, side))
    return distance


def sphere_contact(
    leaf_center: FloatArray, leaf_radius: FloatArray, center: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Signed distances (L,) [m] of a sphere to leaf spheres, and the nearest point (L, 3) of each leaf.

    For a leaf with the same centre, the point is that centre.
    """
    away = center - leaf_center
    length = np.linalg.norm(away, axis=1)
    unit = away / np.where(length > 0.0, length, 1.0)[:, None]
    return length - leaf_radius - radius, leaf_center + leaf_radius[:, None] * unit


def round_cone_contact(
    leaf_center: FloatArray, leaf_radius: FloatArray, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float
) -> tuple[FloatArray, FloatArray]:
    """Signed distances and points as of `sphere_contact`, for the hull of two spheres (`round_cone_distance`).

    The nearest point lies against the gradient of the distance; a leaf centred on the axis has none, and its centre is
    used.
    """
    distance = round_cone_distance(leaf_center, a, b, radius_a, radius_b)
    step = 1e-7
    ahead, behind = (
        np.stack([round_cone_distance(leaf_center + s * axis, a, b, radius_a, radius_b) for axis in np.eye(3)], axis=1)
        for s in (step, -step)
    )
    gradient = ahead - behind
    gradient /= np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-300)
    return distance - leaf_radius, leaf_center - leaf_radius[:, None] * gradient
