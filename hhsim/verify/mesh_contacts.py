"""Distances between the hand and triangles: near pairs, contact points and signed distances, by bisection.

The distance of a triangle to the ball at a point of a phalanx's axis is convex along the axis.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.verify.contacts import (
    CHUNK,
    HALVINGS,
    PALM,
    Groups,
    Pairs,
    ball_pairs,
    grouped,
    joined,
    near_palm_rows,
    near_rows,
    phalanges,
)
from hhsim.verify.kinematics import OwnHand, Posed


class ReadyTriangles(NamedTuple):
    """N triangles with the precomputed terms of a distance; coordinates come before triangles."""

    start: FloatArray  # start of each side, the corners [m] (3, 3, N)
    side: FloatArray  # to the next corner [m] (3, 3, N)
    inverse: FloatArray  # inverse squared length of each side [1/m²], 1 for none (3, N)
    inward: FloatArray  # in the plane, normal to the side, towards the triangle (3, 3, N)
    normal: FloatArray  # unit, zero without area (3, N)
    solid: BoolArray  # True if there is an area (N,)

    def at(self, rows: IntArray | BoolArray) -> "ReadyTriangles":
        """Triangles at `rows`: indices in their order, or a mask."""
        return ReadyTriangles._make(values[..., rows] for values in self)


def ready_triangles(corners: FloatArray) -> ReadyTriangles:
    """Precompute the terms of `away_from_triangles`; corners [m], shape (N, 3, 3)."""
    start = np.ascontiguousarray(corners.transpose(1, 2, 0))
    side = start[[1, 2, 0]] - start
    square = (side * side).sum(axis=1)
    normal = np.cross(side[0], -side[2], axis=0)
    length = np.sqrt((normal * normal).sum(axis=0))
    solid = length > 0.0
    normal /= np.where(solid, length, 1.0)
    inward = np.cross(normal[None], side, axis=1)
    return ReadyTriangles(start, side, 1.0 / np.where(square > 0.0, square, 1.0), inward, normal, solid)


def triangle_groups(triangles: FloatArray) -> Groups:
    """Group neighbouring triangles; corners [m], world, shape (F, 3, 3)."""
    middle = triangles.mean(axis=1)
    return grouped(middle, np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1))


def near_triangle_pairs(
    hand: OwnHand, posed: Posed, triangles: ReadyTriangles, groups: Groups, fingers: BoolArray, near: float
) -> Pairs:
    """Find all pairs of a body and a triangle no more than `near` [m] apart, world; `leaf` is the triangle's index.

    A phalanx has pairs at its nearest point and at both ends, where it touches a face that it lies flat on. No depth
    exceeds the radius, that of a body whose axis passes through the triangle. `fingers` (5,) selects the fingers.
    """
    found: list[Pairs] = []
    for first in range(0, len(posed.joints), CHUNK):
        some = Posed(*(values[first : first + CHUNK] for values in posed))
        both = (_phalanges(hand, some, triangles, groups, fingers, near), _palm(hand, some, triangles, groups, near))
        found.extend(pairs._replace(tick=pairs.tick + first) for pairs in both)
    return joined(found)


def _phalanges(
    hand: OwnHand, posed: Posed, triangles: ReadyTriangles, groups: Groups, fingers: BoolArray, near: float
) -> Pairs:
    of = phalanges(hand, posed, fingers)
    row, face = near_rows(of.a, of.b, of.thick, groups, near)
    row, face = _not_apart(of.a, of.b, of.thick + near, triangles, row, face)
    axis, drop, ready = (of.b - of.a)[row], (of.radius_b - of.radius_a)[row], triangles.at(face)
    share = nearest_share(of.a[row], axis, drop, ready)
    found = [_pairs(row, face, of.a[row] + share[:, None] * axis, of.radius_a[row] + share * drop, ready, near)]
    for end in (0.0, 1.0):
        other = share != end
        place = of.a[row[other]] + end * axis[other]
        size = of.radius_a[row[other]] + end * drop[other]
        found.append(_pairs(row[other], face[other], place, size, ready.at(other), near))
    together = Pairs(*(np.concatenate(values) for values in zip(*found)))
    return together._replace(tick=together.tick // 15, body=together.tick % 15)


def _not_apart(
    a: FloatArray, b: FloatArray, thick: FloatArray, triangles: ReadyTriangles, row: IntArray, face: IntArray
) -> tuple[IntArray, IntArray]:
    """Rows of capsules and triangles that no plane of the triangle separates: its own, or one at a side."""
    for across, start in ((triangles.normal, triangles.start[0]), *zip(-triangles.inward, triangles.start)):
        length = np.sqrt((across * across).sum(axis=0))
        unit = (across / np.where(length > 0.0, length, 1.0)).T[face]
        first, last = (((at[row] - start.T[face]) * unit).sum(axis=1) for at in (a, b))
        apart = np.minimum(first, last)
        if across is triangles.normal:
            apart = np.maximum(apart, -np.maximum(first, last))
        kept = apart <= thick[row]
        row, face = row[kept], face[kept]
    return row, face


def _palm(hand: OwnHand, posed: Posed, triangles: ReadyTriangles, groups: Groups, near: float) -> Pairs:
    row, face = near_palm_rows(hand, posed, groups, near)
    count, center = len(hand.palm_radius), posed.palm.reshape(-1, 3)
    row, face = _not_apart(center, center, np.tile(hand.palm_radius, len(posed.palm)) + near, triangles, row, face)
    pairs = _pairs(row, face, center[row], hand.palm_radius[row % count], triangles.at(face), near)
    return pairs._replace(tick=pairs.tick // count, body=np.full(len(pairs.tick), PALM))


def nearest_share(a: FloatArray, axis: FloatArray, drop: FloatArray, triangles: ReadyTriangles) -> FloatArray:
    """Share [0 to 1] of its axis at which each round cone is nearest to its triangle, shape (N,).

    Args:
        a: Start of the axes [m], shape (N, 3).
        axis: Vectors to their ends [m], shape (N, 3).
        drop: Radius at the end minus radius at the start [m], shape (N,).
        triangles: N of them.
    """
    start, along = np.ascontiguousarray(a.T), np.ascontiguousarray(axis.T)
    low, high = np.zeros(len(a)), np.ones(len(a))
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        away = away_from_triangles(triangles, start + share * along)
        falls = (away * along).sum(axis=0) < drop * np.sqrt((away * away).sum(axis=0))
        low, high = np.where(falls, share, low), np.where(falls, high, share)
    # Bisection never arrives at an end.
    return np.where(low == 0.0, 0.0, np.where(high == 1.0, 1.0, 0.5 * (low + high)))


def _pairs(
    row: IntArray, face: IntArray, place: FloatArray, size: FloatArray, triangles: ReadyTriangles, near: float
) -> Pairs:
    """Near pairs of balls and triangles, a triangle for each ball; `tick` is the row."""
    away = away_from_triangles(triangles, place.T).T
    return ball_pairs(row, np.zeros(len(row), np.int64), face, place, size, away, 0.0, near)


def away_from_triangles(triangles: ReadyTriangles, points: FloatArray) -> FloatArray:
    """Vectors to points [m], shape (3, N), from the nearest point of each one's triangle, shape (3, N).

    That is the foot on its plane where the foot lies inside, else the nearest point of its sides.
    """
    start, side, inverse, inward, normal, solid = triangles
    away = points - start
    share = np.clip((away * side).sum(axis=1) * inverse, 0.0, 1.0)
    aside = away - share[:, None] * side
    square = (aside * aside).sum(axis=1)
    nearest = np.where(square[1] < square[0], aside[1], aside[0])
    nearest = np.where(square[2] < np.minimum(square[0], square[1]), aside[2], nearest)
    over = solid & ((away * inward).sum(axis=1) >= 0.0).all(axis=0)
    found: FloatArray = np.where(over, (away[0] * normal).sum(axis=0) * normal, nearest)
    return found
