"""The referee's own distances between a hand and triangles: which pairs are near, where, and how far apart.

The distance of a triangle to the ball at a place of a phalanx's axis is convex along the axis, so its slope is
bisected. No hierarchy, no features and none of the solver's formulas.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.verify.contacts import CHUNK, HALVINGS, PALM, Pairs, joined
from hhsim.verify.kinematics import OwnHand, Posed

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def near_triangle_pairs(
    hand: OwnHand, posed: Posed, triangles: FloatArray, fingers: NDArray[np.bool_], near: float
) -> Pairs:
    """All pairs of a body and a triangle no more than `near` [m] apart; `leaf` is the number of the triangle.

    A phalanx has pairs where it is nearest and at each of its ends, which is where it touches what it lies flat on. No
    distance is deeper than the radius: that of a body whose axis goes through the triangle.

    Args:
        hand: Sizes.
        posed: The ticks.
        triangles: Corners [m], world, shape (F, 3, 3).
        fingers: Which fingers count, shape (5,).
        near: [m].
    """
    found: list[Pairs] = []
    middle = triangles.mean(axis=1)
    around = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    for first in range(0, len(posed.joints), CHUNK):
        part = Posed(*(values[first : first + CHUNK] for values in posed))
        both = (
            _phalanges(hand, part, triangles, middle, around, fingers, near),
            _palm(hand, part, triangles, middle, around, near),
        )
        found.extend(pairs._replace(tick=pairs.tick + first) for pairs in both)
    return joined(found)


def _phalanges(
    hand: OwnHand,
    posed: Posed,
    triangles: FloatArray,
    middle: FloatArray,
    around: FloatArray,
    fingers: NDArray[np.bool_],
    near: float,
) -> Pairs:
    from scipy.spatial.distance import cdist

    ticks = len(posed.joints)
    a, b = posed.joints[:, :, :3].reshape(-1, 3), posed.joints[:, :, 1:].reshape(-1, 3)
    radius_a, radius_b = (np.tile(hand.radius[:, part].ravel(), ticks) for part in (slice(3), slice(1, 4)))
    size = 0.5 * np.linalg.norm(b - a, axis=1) + np.maximum(radius_a, radius_b)
    counts = np.tile(np.repeat(fingers, 3), ticks)
    apart = cdist(0.5 * (a + b), middle) - size[:, None] - around
    row, face = np.nonzero((apart <= near) & counts[:, None])
    axis, drop = b[row] - a[row], radius_b[row] - radius_a[row]
    share = nearest_share(a[row], axis, drop, triangles[face])
    parts = [_pairs(row, face, a[row] + share[:, None] * axis, radius_a[row] + share * drop, triangles, near)]
    for end in (0.0, 1.0):
        other = share != end
        place = a[row[other]] + end * axis[other]
        parts.append(_pairs(row[other], face[other], place, radius_a[row[other]] + end * drop[other], triangles, near))
    together = Pairs(*(np.concatenate(values) for values in zip(*parts)))
    return together._replace(tick=together.tick // 15, body=together.tick % 15)


def _palm(
    hand: OwnHand, posed: Posed, triangles: FloatArray, middle: FloatArray, around: FloatArray, near: float
) -> Pairs:
    from scipy.spatial.distance import cdist

    reach = float((np.linalg.norm(hand.palm_center, axis=1) + hand.palm_radius).max())
    close = np.flatnonzero((cdist(posed.position, middle) - around - reach <= near).any(axis=0))
    spheres = len(hand.palm_radius)
    center = posed.palm.reshape(-1, 3)
    apart = cdist(center, middle[close]) - np.tile(hand.palm_radius, len(posed.palm))[:, None] - around[close]
    row, face = np.nonzero(apart <= near)
    pairs = _pairs(row, close[face], center[row], hand.palm_radius[row % spheres], triangles, near)
    return pairs._replace(tick=pairs.tick // spheres, body=np.full(len(pairs.tick), PALM))


def nearest_share(a: FloatArray, axis: FloatArray, drop: FloatArray, triangles: FloatArray) -> FloatArray:
    """Where along its axis [0 to 1] each round cone is nearest to its triangle, shape (N,).

    Args:
        a: Start of the axes [m], shape (N, 3).
        axis: From there to the end [m], shape (N, 3).
        drop: Radius at the end less that at the start [m], shape (N,).
        triangles: Corners [m], shape (N, 3, 3).
    """
    low, high = np.zeros(len(a)), np.ones(len(a))
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        place = a + share[:, None] * axis
        away = place - closest_on_triangles(triangles, place)
        length = np.sqrt(np.einsum("ni,ni->n", away, away))
        falls = np.einsum("ni,ni->n", away, axis) < drop * length
        low, high = np.where(falls, share, low), np.where(falls, high, share)
    # Bisection never arrives at an end.
    return np.where(low == 0.0, 0.0, np.where(high == 1.0, 1.0, 0.5 * (low + high)))


def _pairs(
    row: IntArray,
    face: IntArray,
    place: FloatArray,
    size: FloatArray,
    triangles: FloatArray,
    near: float,
) -> Pairs:
    """Pairs of balls and triangles that are near; `tick` is the row."""
    point = closest_on_triangles(triangles[face], place)
    away = place - point
    length = np.linalg.norm(away, axis=1)
    chosen = length - size <= near
    normal = away / np.where(length > 0.0, length, 1.0)[:, None]
    surface = place - size[:, None] * normal
    body = np.zeros(len(row), np.int64)
    found = Pairs(row, body, face, length - size, surface, normal)
    return Pairs(*(values[chosen] for values in found))


def closest_on_triangles(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """The point of each triangle [m], corners of shape (N, 3, 3), that is nearest to its point [m], shape (N, 3).

    The foot on its plane where that lies inside, else the nearest of its sides' points.
    """
    best, least = np.zeros((len(points), 3)), np.full(len(points), np.inf)
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    square = np.einsum("ni,ni->n", normal, normal)
    height = np.einsum("ni,ni->n", points - a, normal) / np.where(square > 0.0, square, 1.0)
    over = square > 0.0
    for start, end in ((a, b), (b, c), (c, a)):
        side = end - start
        length = np.einsum("ni,ni->n", side, side)
        share = np.einsum("ni,ni->n", points - start, side) / np.where(length > 0.0, length, 1.0)
        on_side = start + np.clip(share, 0.0, 1.0)[:, None] * side
        away = np.einsum("ni,ni->n", points - on_side, points - on_side)
        nearer = away < least
        best, least = np.where(nearer[:, None], on_side, best), np.where(nearer, away, least)
        over &= np.einsum("ni,ni->n", np.cross(side, points - start), normal) >= 0.0
    return np.where(over[:, None], points - height[:, None] * normal, best)
