"""Surfaces cut at the sides of a box; triangles that cross a side end there."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.render.triangle_soup import Surface

FAR, NEAR = 1.2, 0.5
"""An object that goes beyond FAR times the hands' size from them is cut NEAR times that size from them."""


def near_hands(body: Surface, hands: FloatArray) -> Surface:
    """Return an object whole or, if it is much larger than the hands, its part near them.

    Args:
        hands: Points of the hands [m], shape (n, 3), world.
    """
    low, high = hands.min(axis=0), hands.max(axis=0)
    size = float(np.linalg.norm(high - low))
    far = ((body.points < low - FAR * size) | (body.points > high + FAR * size)).any()
    part = clipped(body, low - NEAR * size, high + NEAR * size) if far else body
    # A hand that is far from it is shown with all of it.
    return part if len(part.faces) else body


def clipped(surface: Surface, low: ArrayLike, high: ArrayLike) -> Surface:
    """Return the part of a surface inside a box, with normals and colours carried over to new corners.

    Args:
        low, high: Corners of the box [m], shape (3,), world.
    """
    for axis, (least, most) in enumerate(zip(np.asarray(low, np.float64), np.asarray(high, np.float64))):
        surface = _cut(surface, axis, 1.0, least)
        surface = _cut(surface, axis, -1.0, -most)
    return surface


def _cut(surface: Surface, axis: int, sign: float, least: float) -> Surface:
    """Return the part whose `sign` · coordinate is at least `least`."""
    height = sign * surface.points[:, axis] - least
    inside = height[surface.faces] >= 0.0
    count = inside.sum(axis=1)
    if (count == 3).all():
        return surface
    points = [surface.points, surface.normals, surface.colors]
    faces = [surface.faces[count == 3]]
    known = len(surface.points)
    for corners in (1, 2):
        # The corner that is alone on its side comes first; the order round the triangle stays.
        crossing = surface.faces[count == corners]
        alone = np.argmax(inside[count == corners] == (corners == 1), axis=1)
        a, b, c = (np.take_along_axis(crossing, (alone[:, None] + k) % 3, axis=1)[:, 0] for k in range(3))
        new = []
        for other in (b, c):
            share = (height[a] / (height[a] - height[other]))[:, None]
            for values, original in enumerate((surface.points, surface.normals, surface.colors)):
                points[values] = np.concatenate([points[values], original[a] + share * (original[other] - original[a])])
            new.append(known + np.arange(len(a)))
            known += len(a)
        p, q = new
        faces += (
            [np.stack([a, p, q], axis=1)]
            if corners == 1
            else [np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)]
        )
    points[1] = points[1] / np.maximum(np.linalg.norm(points[1], axis=1, keepdims=True), 1e-300)
    return replace(surface, points=points[0], normals=points[1], colors=points[2], faces=np.concatenate(faces))
