"""The referee's own distances between a hand and spheres: which pairs are near, where, and how far apart.

The distance of a phalanx (a round cone, the union of balls x(s), r(s) along its axis) to a sphere's centre is the
least of |x(s) − c| − r(s), which is convex in s: its slope is bisected. No tree and none of the solver's formulas.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.verify.kinematics import OwnHand, Posed

PALM = 15
BODIES = 16
CHUNK = 16
"""Ticks at once: what a finest tree's distances fit in memory for."""
HALVINGS = 56
"""As many as a double has digits: the place on the axis is as exact as its length."""


class Pairs(NamedTuple):
    """Near pairs of a hand body and a piece of the surface: a leaf sphere, or a triangle of the mesh.

    | field | meaning | shape |
    |---|---|---|
    | tick | of the ticks that were looked at, ascending | (N,) |
    | body | 0 to 14 the phalanges, 15 the palm | (N,) |
    | leaf | number of the sphere or the triangle | (N,) |
    | distance | signed [m] | (N,) |
    | point | of the hand's surface, nearest to the piece [m], world | (N, 3) |
    | normal | unit, from the object to the hand | (N, 3) |
    """

    tick: IntArray
    body: IntArray
    leaf: IntArray
    distance: FloatArray
    point: FloatArray
    normal: FloatArray

    def of(self, tick: int) -> "Pairs":
        """Those of one tick."""
        first, last = np.searchsorted(self.tick, [tick, tick + 1])
        return self.at(np.arange(first, last))

    def within(self, limit: float) -> "Pairs":
        """Those no more than `limit` [m] apart."""
        return self.at(np.flatnonzero(self.distance <= limit))

    def at(self, rows: IntArray) -> "Pairs":
        """Some of them, in the order of `rows`."""
        return Pairs(
            *(self.tick[rows], self.body[rows], self.leaf[rows]),
            *(self.distance[rows], self.point[rows], self.normal[rows]),
        )

    def bodies(self, ticks: int) -> IntArray:
        """How many bodies have a pair at each tick, shape (ticks,)."""
        return np.bincount(np.unique(self.tick * BODIES + self.body) // BODIES, minlength=ticks)

    def nearest(self, ticks: int) -> FloatArray:
        """Least distance [m] of each body at each tick, shape (ticks, 16); infinite where no pair is near."""
        found = np.full((ticks, BODIES), np.inf)
        np.minimum.at(found, (self.tick, self.body), self.distance)
        return found


def near_pairs(
    hand: OwnHand, posed: Posed, center: FloatArray, radius: FloatArray, fingers: BoolArray, near: float
) -> Pairs:
    """All pairs of a body and a sphere no more than `near` [m] apart.

    Args:
        center: Of the spheres [m], world, shape (L, 3).
        radius: [m], shape (L,).
        fingers: Which fingers count, shape (5,).
        near: [m].
    """
    found: list[Pairs] = []
    for first in range(0, len(posed.joints), CHUNK):
        part = Posed(*(values[first : first + CHUNK] for values in posed))
        both = (_phalanges(hand, part, center, radius, fingers, near), _palm(hand, part, center, radius, near))
        found.extend(pairs._replace(tick=pairs.tick + first) for pairs in both)
    return joined(found)


def joined(parts: Sequence[Pairs]) -> Pairs:
    """Pairs of several searches together, by tick and body."""
    pairs = Pairs(*(np.concatenate(values) for values in zip(*parts)))
    return pairs.at(np.lexsort((pairs.body, pairs.tick)))


def axis_places(
    a: FloatArray, b: FloatArray, radius_a: FloatArray, radius_b: FloatArray, center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where on the axes of round cones their least distance to points is: the place [m] (N, 3), the radius there [m].

    Args:
        a, b: Ends of the axes [m], shape (N, 3).
        radius_a, radius_b: There [m], shape (N,).
        center: The points [m], shape (N, 3).
    """
    axis, drop = b - a, radius_b - radius_a
    low, high = np.zeros(len(a)), np.ones(len(a))
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        away = a + share[:, None] * axis - center
        length = np.sqrt(np.einsum("ni,ni->n", away, away))
        falls = np.einsum("ni,ni->n", away, axis) < drop * length
        low, high = np.where(falls, share, low), np.where(falls, high, share)
    share = 0.5 * (low + high)
    # Bisection never arrives at an end.
    share = np.where(low == 0.0, 0.0, np.where(high == 1.0, 1.0, share))
    return a + share[:, None] * axis, radius_a + share * drop


def _phalanges(
    hand: OwnHand, posed: Posed, center: FloatArray, radius: FloatArray, fingers: BoolArray, near: float
) -> Pairs:
    from scipy.spatial.distance import cdist

    ticks = len(posed.joints)
    a = posed.joints[:, :, :3].reshape(-1, 3)
    b = posed.joints[:, :, 1:].reshape(-1, 3)
    radius_a, radius_b = (np.tile(hand.radius[:, part].ravel(), ticks) for part in (slice(3), slice(1, 4)))
    # A ball around the phalanx is no farther than the phalanx.
    around = 0.5 * np.linalg.norm(b - a, axis=1) + np.maximum(radius_a, radius_b)
    counts = np.tile(np.repeat(fingers, 3), ticks)
    apart = cdist(0.5 * (a + b), center) - around[:, None] - radius
    row, leaf = np.nonzero((apart <= near) & counts[:, None])
    place, size = axis_places(a[row], b[row], radius_a[row], radius_b[row], center[leaf])
    return _pairs(row // 15, row % 15, leaf, place, size, center[leaf], radius[leaf], near)


def _palm(hand: OwnHand, posed: Posed, center: FloatArray, radius: FloatArray, near: float) -> Pairs:
    from scipy.spatial.distance import cdist

    around = float((np.linalg.norm(hand.palm_center, axis=1) + hand.palm_radius).max())
    close = np.flatnonzero((cdist(posed.position, center) - radius - around <= near).any(axis=0))
    spheres = len(hand.palm_radius)
    apart = cdist(posed.palm.reshape(-1, 3), center[close])
    apart -= np.tile(hand.palm_radius, len(posed.palm))[:, None] + radius[close]
    row, leaf = np.nonzero(apart <= near)
    leaf = close[leaf]
    place, size = posed.palm.reshape(-1, 3)[row], hand.palm_radius[row % spheres]
    return _pairs(row // spheres, np.full(len(row), PALM), leaf, place, size, center[leaf], radius[leaf], near)


def _pairs(
    tick: IntArray,
    body: IntArray,
    leaf: IntArray,
    place: FloatArray,
    size: FloatArray,
    center: FloatArray,
    radius: FloatArray,
    near: float,
) -> Pairs:
    away = place - center
    length = np.linalg.norm(away, axis=1)
    normal = away / np.where(length > 0.0, length, 1.0)[:, None]
    distance = length - size - radius
    chosen = distance <= near
    point = place - size[:, None] * normal
    return Pairs(tick[chosen], body[chosen], leaf[chosen], distance[chosen], point[chosen], normal[chosen])
