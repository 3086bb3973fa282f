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
CHUNK = 64
"""Ticks at once: what a finest tree's distances fit in memory for."""
GROUP, MOST_GROUPS = 12, 2048
"""Pieces of a group, and more where there would be more groups than so many."""
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


class Groups(NamedTuple):
    """Pieces of a surface, each inside of a ball, in groups of neighbours: a body far from a group is far from each.

    | field | meaning | shape |
    |---|---|---|
    | order | numbers of the pieces, group by group | (L,) |
    | first | where each group begins in `order`, and where the last one ends | (G + 1,) |
    | middle, around | ball around each group [m] | (G, 3), (G,) |
    | center, radius | ball around each piece [m], by its number | (L, 3), (L,) |
    """

    order: IntArray
    first: IntArray
    middle: FloatArray
    around: FloatArray
    center: FloatArray
    radius: FloatArray


def grouped(center: FloatArray, radius: FloatArray) -> Groups:
    """Group pieces by halving them at the median of their longest extent; balls of centres (L, 3), radii (L,) [m]."""
    most = max(GROUP, len(radius) // MOST_GROUPS)
    waiting, parts = [np.arange(len(radius))], []
    while waiting:
        rows = waiting.pop()
        if len(rows) <= most:
            parts.append(rows)
            continue
        rows = rows[np.argsort(center[rows, np.ptp(center[rows], axis=0).argmax()], kind="stable")]
        waiting += [rows[: len(rows) // 2], rows[len(rows) // 2 :]]
    middle = np.array([0.5 * (center[rows].min(axis=0) + center[rows].max(axis=0)) for rows in parts])
    around = np.array(
        [(np.linalg.norm(center[rows] - at, axis=1) + radius[rows]).max() for rows, at in zip(parts, middle)]
    )
    first = np.cumsum([0, *(len(rows) for rows in parts)])
    return Groups(np.concatenate(parts), first, middle, around, center, radius)


def near_rows(
    a: FloatArray, b: FloatArray, thick: FloatArray, pieces: Groups, near: float
) -> tuple[IntArray, IntArray]:
    """Which capsules and pieces are no more than `near` [m] apart by their balls: numbers of both.

    Args:
        a, b: Ends of the capsules' axes [m], shape (N, 3).
        thick: Their radii [m], shape (N,); -inf for one that is near nothing.
    """
    from scipy.spatial.distance import cdist

    axis = b - a
    square = np.einsum("ni,ni->n", axis, axis)
    inverse = 1.0 / np.where(square > 0.0, square, 1.0)

    def close(row: IntArray, center: FloatArray, radius: FloatArray) -> BoolArray:
        away, along = center - a[row], axis[row]
        share = np.clip(np.einsum("ni,ni->n", away, along) * inverse[row], 0.0, 1.0)
        away -= share[:, None] * along
        return np.asarray(np.sqrt(np.einsum("ni,ni->n", away, away)) <= (thick + near)[row] + radius)

    reach = 0.5 * np.sqrt(square) + thick + near
    row, group = np.nonzero(cdist(0.5 * (a + b), pieces.middle) <= reach[:, None] + pieces.around)
    kept = close(row, pieces.middle[group], pieces.around[group])
    row, group = row[kept], group[kept]
    count = np.diff(pieces.first)[group]
    row = np.repeat(row, count)
    piece = pieces.order[np.arange(len(row)) + np.repeat(pieces.first[:-1][group] - np.cumsum(count) + count, count)]
    kept = close(row, pieces.center[piece], pieces.radius[piece])
    return row[kept], piece[kept]


def near_pairs(hand: OwnHand, posed: Posed, spheres: Groups, fingers: BoolArray, near: float) -> Pairs:
    """All pairs of a body and a sphere no more than `near` [m] apart.

    Args:
        spheres: World.
        fingers: Which fingers count, shape (5,).
        near: [m].
    """
    found: list[Pairs] = []
    for first in range(0, len(posed.joints), CHUNK):
        part = Posed(*(values[first : first + CHUNK] for values in posed))
        both = (_phalanges(hand, part, spheres, fingers, near), _palm(hand, part, spheres, near))
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


class Phalanges(NamedTuple):
    """Round cones of all phalanges of some hands, 15 a tick: ends of the axes [m] (N, 3), radii there [m] (N,).

    `thick` (N,) [m] is the larger radius; -inf of a finger that does not count.
    """

    a: FloatArray
    b: FloatArray
    radius_a: FloatArray
    radius_b: FloatArray
    thick: FloatArray


def phalanges(hand: OwnHand, posed: Posed, fingers: BoolArray) -> Phalanges:
    """The phalanges of hands; `fingers` (5,) are those that count."""
    ticks = len(posed.joints)
    a, b = posed.joints[:, :, :3].reshape(-1, 3), posed.joints[:, :, 1:].reshape(-1, 3)
    radius_a, radius_b = (np.tile(hand.radius[:, part].ravel(), ticks) for part in (slice(3), slice(1, 4)))
    counts = np.tile(np.repeat(fingers, 3), ticks)
    return Phalanges(a, b, radius_a, radius_b, np.where(counts, np.maximum(radius_a, radius_b), -np.inf))


def near_palm_rows(hand: OwnHand, posed: Posed, pieces: Groups, near: float) -> tuple[IntArray, IntArray]:
    """As `near_rows`, of the palms' spheres: a palm that is far as a whole is not looked at sphere by sphere."""
    from scipy.spatial.distance import cdist

    spheres = len(hand.palm_radius)
    reach = float((np.linalg.norm(hand.palm_center, axis=1) + hand.palm_radius).max()) + near
    close = np.flatnonzero((cdist(posed.position, pieces.middle) <= reach + pieces.around).any(axis=1))
    center = posed.palm[close].reshape(-1, 3)
    row, piece = near_rows(center, center, np.tile(hand.palm_radius, len(close)), pieces, near)
    return close[row // spheres] * spheres + row % spheres, piece


def _phalanges(hand: OwnHand, posed: Posed, spheres: Groups, fingers: BoolArray, near: float) -> Pairs:
    of = phalanges(hand, posed, fingers)
    row, leaf = near_rows(of.a, of.b, of.thick, spheres, near)
    center, radius = spheres.center[leaf], spheres.radius[leaf]
    place, size = axis_places(of.a[row], of.b[row], of.radius_a[row], of.radius_b[row], center)
    return _pairs(row // 15, row % 15, leaf, place, size, center, radius, near)


def _palm(hand: OwnHand, posed: Posed, spheres: Groups, near: float) -> Pairs:
    row, leaf = near_palm_rows(hand, posed, spheres, near)
    count = len(hand.palm_radius)
    place, size = posed.palm.reshape(-1, 3)[row], hand.palm_radius[row % count]
    body = np.full(len(row), PALM)
    return _pairs(row // count, body, leaf, place, size, spheres.center[leaf], spheres.radius[leaf], near)


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
