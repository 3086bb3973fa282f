"""Distances between the hand and spheres or triangles: near pairs, contact points and signed distances, by bisection.

A phalanx is a round cone, the union of balls with centre x(s) and radius r(s) along its axis. Its distance to a
sphere's centre c is the minimum of |x(s) − c| − r(s), which is convex in s, and so is that to a triangle.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.verify.kinematics import OwnHand, Posed

PALM = 15
BODIES = 16
"""Phalanges from the thumb's proximal one on, three a finger; then the palm."""
CHUNK = 64
"""Ticks searched at once, to bound the memory."""
FARTHEST = 1e9
"""Coordinate of a hand that is far from everything [m]."""
HALVINGS = 56
"""Bisection steps: as many as a double has digits."""


class Pairs(NamedTuple):
    """Near pairs of a hand body and a piece of the surface: a leaf sphere, or a triangle of the mesh."""

    tick: IntArray  # index of the searched tick, ascending (N,)
    body: IntArray  # 0 to 14: phalanges, 15: palm (N,)
    leaf: IntArray  # index of the sphere or the triangle (N,)
    distance: FloatArray  # signed [m] (N,)
    point: FloatArray  # nearest point of the hand's surface [m], world (N, 3)
    normal: FloatArray  # unit, from the object to the hand (N, 3)

    def of(self, tick: int) -> "Pairs":
        """Pairs of one tick."""
        first, last = np.searchsorted(self.tick, [tick, tick + 1])
        return self.at(np.arange(first, last))

    def within(self, limit: float) -> "Pairs":
        """Pairs no more than `limit` [m] apart."""
        return self.at(np.flatnonzero(self.distance <= limit))

    def at(self, rows: IntArray) -> "Pairs":
        """Pairs at `rows`, in their order."""
        return Pairs._make(values[rows] for values in self)

    def bodies(self, ticks: int) -> IntArray:
        """Number of bodies that have a pair at each tick, shape (ticks,)."""
        return np.bincount(np.unique(self.tick * BODIES + self.body) // BODIES, minlength=ticks)

    def nearest(self, ticks: int) -> FloatArray:
        """Least distance [m] of each body at each tick, shape (ticks, 16); infinite where no pair is near."""
        found = np.full((ticks, BODIES), np.inf)
        np.minimum.at(found, (self.tick, self.body), self.distance)
        return found


class Places(NamedTuple):
    """Balls around the pieces of a surface, and k-d trees of the centres, one for balls of like radius."""

    trees: list[tuple[Any, IntArray, float]]  # scipy's k-d tree, the pieces in it, their largest radius [m]
    center: FloatArray  # [m] (L, 3)
    radius: FloatArray  # [m] (L,)

    def within(self, points: FloatArray, reach: FloatArray) -> tuple[IntArray, IntArray]:
        """Return indices of points [m], world, (N, 3), and of pieces whose balls may be within `reach` [m] (N,)."""
        rows, pieces = [], []
        for tree, members, largest in self.trees:
            found = tree.query_ball_point(_clipped(points), np.maximum(reach + largest, 0.0), return_sorted=False)
            rows.append(np.repeat(np.arange(len(points)), [len(some) for some in found]))
            pieces.append(members[np.fromiter(itertools.chain.from_iterable(found), np.int64, len(rows[-1]))])
        return np.concatenate(rows), np.concatenate(pieces)

    def counts(self, points: FloatArray, reach: float) -> IntArray:
        """Count the pieces whose balls may be within `reach` [m] of each point [m], world, (N, 3); shape (N,)."""
        found = (
            tree.query_ball_point(_clipped(points), reach + largest, return_length=True)
            for tree, _, largest in self.trees
        )
        return np.asarray(np.sum(list(found), axis=0))


def _clipped(points: FloatArray) -> FloatArray:
    # A k-d tree takes no points whose squares overflow.
    return np.clip(np.nan_to_num(points), -FARTHEST, FARTHEST)


def ball_places(center: FloatArray, radius: FloatArray) -> Places:
    """Sort balls by their places; centres (L, 3), radii (L,) [m]."""
    from scipy.spatial import cKDTree

    # The spheres of a tree fill the object: a few of them are a hundred times as large as most.
    octave = np.frexp(radius)[1]
    classes = [np.flatnonzero(octave == some) for some in np.unique(octave)]
    return Places([(cKDTree(center[some]), some, radius[some].max()) for some in classes], center, radius)


def near_rows(
    a: FloatArray, b: FloatArray, thick: FloatArray, pieces: Places, near: float
) -> tuple[IntArray, IntArray]:
    """Return indices of capsules and pieces whose balls are at most `near` [m] apart, sorted by capsule and piece.

    `a`, `b` are the ends of the capsules' axes [m], shape (N, 3), `thick` their radii [m], -inf to leave one out.
    """
    axis = b - a
    square = np.einsum("ni,ni->n", axis, axis)
    # A hand that is not finite is near nothing.
    known = np.isfinite(square)
    row, piece = pieces.within(0.5 * (a + b), np.where(known, 0.5 * np.sqrt(square) + thick + near, -np.inf))
    away = pieces.center[piece] - a[row]
    along = np.einsum("ni,ni->n", away, axis[row]) / np.where(square > 0.0, square, 1.0)[row]
    away -= np.clip(along, 0.0, 1.0)[:, None] * axis[row]
    kept = np.sqrt(np.einsum("ni,ni->n", away, away)) <= (thick + near)[row] + pieces.radius[piece]
    order = np.lexsort((piece[kept], row[kept]))
    return row[kept][order], piece[kept][order]


def near_pairs(hand: OwnHand, posed: Posed, spheres: Places, fingers: BoolArray, near: float) -> Pairs:
    """Find all pairs of a body and a sphere no more than `near` [m] apart, world, of the fingers in `fingers` (5,)."""
    return _by_chunks(
        posed, lambda some: (_phalanges(hand, some, spheres, fingers, near), _palm(hand, some, spheres, near))
    )


def _by_chunks(posed: Posed, search: Callable[[Posed], tuple[Pairs, ...]]) -> Pairs:
    """Pairs of a search by `CHUNK` ticks."""
    found: list[Pairs] = []
    for first in range(0, len(posed.joints), CHUNK):
        some = posed.at(slice(first, first + CHUNK))
        found.extend(pairs._replace(tick=pairs.tick + first) for pairs in search(some))
    return joined(found)


def joined(parts: Sequence[Pairs]) -> Pairs:
    """Pairs of several searches together, sorted by tick and body."""
    pairs = Pairs(*(np.concatenate(values) for values in zip(*parts)))
    return pairs.at(np.lexsort((pairs.body, pairs.tick)))


def axis_places(
    a: FloatArray, b: FloatArray, radius_a: FloatArray, radius_b: FloatArray, center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points of N axes where the round cones a, b, radius_a, radius_b are nearest to `center`, and the radii there [m].

    Ends, centres and points have shape (N, 3), radii (N,).
    """
    axis, drop = b - a, radius_b - radius_a

    def falls(share: FloatArray) -> BoolArray:
        away = a + share[:, None] * axis - center
        length = np.sqrt(np.einsum("ni,ni->n", away, away))
        return np.asarray(np.einsum("ni,ni->n", away, axis) < drop * length)

    share = lowest_places(len(a), falls)
    return a + share[:, None] * axis, radius_a + share * drop


def lowest_places(count: int, falls: Callable[[FloatArray], BoolArray]) -> FloatArray:
    """Shares [0 to 1] of some axes where a convex distance is least, by where it `falls`, shape (count,)."""
    low, high = np.zeros(count), np.ones(count)
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        down = falls(share)
        low, high = np.where(down, share, low), np.where(down, high, share)
    # Bisection never arrives at an end.
    return np.where(low == 0.0, 0.0, np.where(high == 1.0, 1.0, 0.5 * (low + high)))


class Phalanges(NamedTuple):
    """Round cones of all phalanges of some hands, 15 a tick."""

    a: FloatArray  # start of the axes [m] (N, 3)
    b: FloatArray  # end of the axes [m] (N, 3)
    radius_a: FloatArray  # radii at both ends [m] (N,)
    radius_b: FloatArray
    thick: FloatArray  # larger radius [m], -inf for a finger that does not count (N,)


def phalanges(hand: OwnHand, posed: Posed, fingers: BoolArray) -> Phalanges:
    """Round cones of the phalanges of hands; `fingers` (5,) selects the fingers that count."""
    ticks = len(posed.joints)
    a, b = posed.joints[:, :, :3].reshape(-1, 3), posed.joints[:, :, 1:].reshape(-1, 3)
    radius_a, radius_b = (np.tile(hand.radius[:, part].ravel(), ticks) for part in (slice(3), slice(1, 4)))
    counts = np.tile(np.repeat(fingers, 3), ticks)
    return Phalanges(a, b, radius_a, radius_b, np.where(counts, np.maximum(radius_a, radius_b), -np.inf))


def near_palm_rows(hand: OwnHand, posed: Posed, pieces: Places, near: float) -> tuple[IntArray, IntArray]:
    """Indices as of `near_rows` for the palms' spheres; a palm that is far as a whole is skipped."""
    spheres = len(hand.palm_radius)
    reach = float((np.linalg.norm(hand.palm_center, axis=1) + hand.palm_radius).max()) + near
    close = np.flatnonzero(pieces.counts(posed.position, reach))
    center = posed.palm[close].reshape(-1, 3)
    row, piece = near_rows(center, center, np.tile(hand.palm_radius, len(close)), pieces, near)
    return close[row // spheres] * spheres + row % spheres, piece


def _phalanges(hand: OwnHand, posed: Posed, spheres: Places, fingers: BoolArray, near: float) -> Pairs:
    of = phalanges(hand, posed, fingers)
    row, leaf = near_rows(of.a, of.b, of.thick, spheres, near)
    center, radius = spheres.center[leaf], spheres.radius[leaf]
    place, size = axis_places(of.a[row], of.b[row], of.radius_a[row], of.radius_b[row], center)
    return ball_pairs(row // 15, row % 15, leaf, place, size, place - center, radius, near)


def _palm(hand: OwnHand, posed: Posed, spheres: Places, near: float) -> Pairs:
    row, leaf = near_palm_rows(hand, posed, spheres, near)
    count = len(hand.palm_radius)
    place, size = posed.palm.reshape(-1, 3)[row], hand.palm_radius[row % count]
    body = np.full(len(row), PALM)
    center, radius = spheres.center[leaf], spheres.radius[leaf]
    return ball_pairs(row // count, body, leaf, place, size, place - center, radius, near)


def ball_pairs(
    tick: IntArray,
    body: IntArray,
    leaf: IntArray,
    place: FloatArray,
    size: FloatArray,
    away: FloatArray,
    radius: FloatArray | float,
    near: float,
) -> Pairs:
    """Pairs of the hand's balls (`place`, `size`) and pieces no more than `near` [m] apart.

    `away` [m], shape (N, 3), leads to each ball's centre from the sphere's centre, of a given radius [m], or from the
    nearest point of the triangle, with radius 0.
    """
    length = np.linalg.norm(away, axis=1)
    normal = away / np.where(length > 0.0, length, 1.0)[:, None]
    distance = length - size - radius
    pairs = Pairs(tick, body, leaf, distance, place - size[:, None] * normal, normal)
    return pairs.at(np.flatnonzero(distance <= near))


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


def triangle_places(triangles: FloatArray) -> Places:
    """Sort triangles by their places; corners [m], world, shape (F, 3, 3)."""
    middle = triangles.mean(axis=1)
    return ball_places(middle, np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1))


def near_triangle_pairs(
    hand: OwnHand, posed: Posed, triangles: ReadyTriangles, places: Places, fingers: BoolArray, near: float
) -> Pairs:
    """Find all pairs of a body and a triangle no more than `near` [m] apart, world; `leaf` is the triangle's index.

    A phalanx has pairs at its nearest point and at both ends, where it touches a face that it lies flat on. No depth
    exceeds the radius, that of a body whose axis passes through the triangle. `fingers` (5,) selects the fingers.
    """

    def search(some: Posed) -> tuple[Pairs, ...]:
        phalanx = _phalanges_on_triangles(hand, some, triangles, places, fingers, near)
        return phalanx, _palm_on_triangles(hand, some, triangles, places, near)

    return _by_chunks(posed, search)


def _phalanges_on_triangles(
    hand: OwnHand, posed: Posed, triangles: ReadyTriangles, places: Places, fingers: BoolArray, near: float
) -> Pairs:
    of = phalanges(hand, posed, fingers)
    row, face = near_rows(of.a, of.b, of.thick, places, near)
    row, face = _not_apart(of.a, of.b, of.thick + near, triangles, row, face)
    axis, drop, ready = (of.b - of.a)[row], (of.radius_b - of.radius_a)[row], triangles.at(face)
    start, along = np.ascontiguousarray(of.a[row].T), np.ascontiguousarray(axis.T)

    def falls(share: FloatArray) -> BoolArray:
        away = away_from_triangles(ready, start + share * along)
        return np.asarray((away * along).sum(axis=0) < drop * np.sqrt((away * away).sum(axis=0)))

    share = lowest_places(len(row), falls)
    found = [
        _with_triangles(row, face, of.a[row] + share[:, None] * axis, of.radius_a[row] + share * drop, ready, near)
    ]
    for end in (0.0, 1.0):
        other = share != end
        place = of.a[row[other]] + end * axis[other]
        size = of.radius_a[row[other]] + end * drop[other]
        found.append(_with_triangles(row[other], face[other], place, size, ready.at(other), near))
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


def _palm_on_triangles(hand: OwnHand, posed: Posed, triangles: ReadyTriangles, places: Places, near: float) -> Pairs:
    row, face = near_palm_rows(hand, posed, places, near)
    count, center = len(hand.palm_radius), posed.palm.reshape(-1, 3)
    row, face = _not_apart(center, center, np.tile(hand.palm_radius, len(posed.palm)) + near, triangles, row, face)
    pairs = _with_triangles(row, face, center[row], hand.palm_radius[row % count], triangles.at(face), near)
    return pairs._replace(tick=pairs.tick // count, body=np.full(len(pairs.tick), PALM))


def _with_triangles(
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
