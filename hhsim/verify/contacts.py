"""Distances of the hand to spheres, triangles and hands: near pairs, contact points and signed distances.

A phalanx is a round cone, the union of balls with centre x(s) and radius r(s) along its axis. Its distance to a
sphere's centre c is the minimum of |x(s) − c| − r(s), in closed form; that to a triangle is convex in s, too, and is
found by bisection. So is the distance of two round cones, of one hand or two: the least over places on the one axis
of the closed form of the other.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.verify.kinematics import OwnHand, Posed, pose

PALM = 15
BODIES = 16
"""Phalanges from the thumb's proximal one on, three a finger; then the palm."""
CHUNK = 64
"""Ticks searched at once, to bound the memory."""
FARTHEST = 1e9
"""Coordinate of a hand that is far from everything [m]."""
LIES_IN = 1e-15
"""Distance from a triangle up to which an axis lies in it [m]: rounding."""
HALVINGS = 56
"""Bisection steps: as many as a double has digits."""
TINY = 1e-30
NO_AREA = 1e-12
"""Ratio of a triangle's height to its longest side below which it is a line."""
PER_FINGER = 3


class Pairs(NamedTuple):
    """Near pairs of a hand body and a piece of the surface: a leaf sphere, a triangle of the mesh, or a hand's body."""

    tick: IntArray  # index of the searched tick, ascending (N,)
    body: IntArray  # 0 to 14: phalanges, 15: palm (N,)
    leaf: IntArray  # index of the sphere or the triangle; of a hand's own parts or two hands, the second body (N,)
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

    def nearest(self, ticks: int) -> FloatArray:
        """Least distance [m] of each body at each tick, shape (ticks, 16); infinite where no pair is near."""
        found = np.full((ticks, BODIES), np.inf)
        np.minimum.at(found, (self.tick, self.body), self.distance)
        return found


class Pieces(NamedTuple):
    """Pieces of a surface: leaf spheres, or triangles with the balls around them, and k-d trees of the centres.

    Balls of like radius have a tree of their own.
    """

    trees: list[tuple[Any, IntArray, float]]  # scipy's k-d tree, the pieces in it, their largest radius [m]
    center: FloatArray  # [m] (L, 3)
    radius: FloatArray  # [m] (L,)
    triangles: "ReadyTriangles | None" = None  # None for leaf spheres

    @classmethod
    def of_balls(cls, center: FloatArray, radius: FloatArray) -> "Pieces":
        """Sort balls by their places; centres (L, 3), radii (L,) [m]."""
        from scipy.spatial import cKDTree

        # The spheres of a tree fill the object: a few of them are a hundred times as large as most.
        octave = np.frexp(radius)[1]
        classes = [np.flatnonzero(octave == some) for some in np.unique(octave)]
        return cls([(cKDTree(center[some]), some, radius[some].max()) for some in classes], center, radius)

    @classmethod
    def of_triangles(cls, corners: FloatArray) -> "Pieces":
        """Sort triangles by their places; corners [m], world, shape (F, 3, 3)."""
        middle = corners.mean(axis=1)
        balls = cls.of_balls(middle, np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1))
        return balls._replace(triangles=ready_triangles(corners))

    def within(self, points: FloatArray, reach: FloatArray) -> tuple[IntArray, IntArray]:
        """Return indices of points [m], world, (N, 3), and of pieces whose balls may be within `reach` [m] (N,)."""
        rows, pieces, points = [], [], _clipped(points)
        for tree, members, largest in self.trees:
            most = np.maximum(reach + largest, 0.0)
            # To look into the tree takes much longer than at the box around its centres.
            beside = np.maximum(np.maximum(tree.mins - points, points - tree.maxes), 0.0)
            close = np.flatnonzero((beside * beside).sum(axis=1) <= 1.0001 * most * most)
            found = tree.query_ball_point(points[close], most[close], return_sorted=False)
            rows.append(np.repeat(close, [len(some) for some in found]))
            pieces.append(members[np.fromiter(itertools.chain.from_iterable(found), np.int64, len(rows[-1]))])
        return np.concatenate(rows), np.concatenate(pieces)

    def away(self, faces: IntArray, points: FloatArray) -> FloatArray:
        """Vectors to points [m], world, (N, 3), from the nearest points of their triangles, shape (3, N)."""
        assert self.triangles is not None
        return away_from_triangles(self.triangles.at(faces), points.T)

    def nearest(self, points: FloatArray) -> IntArray:
        """Return for each point [m], world, (N, 3), the piece of each tree whose centre is nearest, shape (N, C)."""
        return np.stack([members[tree.query(_clipped(points))[1]] for tree, members, _ in self.trees], axis=1)

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


class RoundCones(NamedTuple):
    """N round cones, such as the bodies of hands: phalanges, and the palm's spheres, cones without length."""

    a: FloatArray  # start of each axis [m] (N, 3)
    b: FloatArray
    radius_a: FloatArray  # [m] (N,)
    radius_b: FloatArray

    def at(self, rows: IntArray | BoolArray) -> "RoundCones":
        """Return some cones: indices in their order, or a mask."""
        return RoundCones._make(values[rows] for values in self)

    @property
    def thick(self) -> FloatArray:
        """Larger radius of each [m] (N,)."""
        return np.maximum(self.radius_a, self.radius_b)

    def balls(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return centres (N, 3) and radii (N,) of the balls at these shares of the axes [m]."""
        return self.a + share[:, None] * (self.b - self.a), self.radius_a + share * (self.radius_b - self.radius_a)

    def nearest_balls(self, center: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return centres (N, 3) and radii (N,) of the balls that are nearest to one point each [m], (N, 3)."""
        axis, drop, away = self.b - self.a, self.radius_b - self.radius_a, center - self.a
        length = np.linalg.norm(axis, axis=1)
        size = np.where(length > 0.0, length, 1.0)
        unit, slope = axis / size[:, None], drop / size
        along = np.einsum("ni,ni->n", away, unit)
        # The normal of a cone leans by its slope; where one end's ball holds the other's it is the nearest.
        lean = slope / np.sqrt(np.maximum(1.0 - slope**2, TINY))
        along += lean * np.linalg.norm(away - along[:, None] * unit, axis=1)
        return self.balls(np.where(length > 0.0, np.clip(along / size, 0.0, 1.0), drop > 0.0))


def round_cones(joints: FloatArray, palm: FloatArray, radius: FloatArray, palm_radius: FloatArray) -> RoundCones:
    """Return the bodies of hands, tick by tick: 15 phalanges, then the palm's P spheres.

    Joints (T, 5, 4, 3), spheres (T, P, 3) [m]; radii at the joints (5, 4), and of the spheres (P,) [m].
    """
    parts = slice(3), slice(1, 4)
    ends = (np.concatenate([joints[:, :, some].reshape(-1, PALM, 3), palm], axis=1).reshape(-1, 3) for some in parts)
    sizes = (np.tile(np.append(radius[:, some].ravel(), palm_radius), len(joints)) for some in parts)
    return RoundCones(*ends, *sizes)


def own_cones(hand: OwnHand, posed: Posed) -> RoundCones:
    """Return the bodies of a result's hands, as `round_cones`."""
    return round_cones(posed.joints, posed.palm, hand.radius, hand.palm_radius)


def near_rows(cones: RoundCones, reach: FloatArray, pieces: Pieces) -> tuple[IntArray, IntArray]:
    """Return indices of axes and pieces whose balls are at most `reach` [m] (N,) apart, sorted by axis and piece.

    A reach of -inf leaves a cone out.
    """
    # A hand that is not finite is near nothing.
    some = np.flatnonzero(np.isfinite(cones.a - cones.b).all(axis=1) & (reach > -np.inf))
    a, b = cones.a[some], cones.b[some]
    square = np.einsum("ni,ni->n", b - a, b - a)
    row, piece = pieces.within(0.5 * (a + b), 0.5 * np.sqrt(square) + reach[some])
    away, axis = pieces.center[piece] - a[row], (b - a)[row]
    along = np.einsum("ni,ni->n", away, axis) / np.where(square > 0.0, square, 1.0)[row]
    away -= np.clip(along, 0.0, 1.0)[:, None] * axis
    row = some[row]
    kept = np.sqrt(np.einsum("ni,ni->n", away, away)) <= reach[row] + pieces.radius[piece]
    order = np.lexsort((piece[kept], row[kept]))
    return row[kept][order], piece[kept][order]


def near_pairs(hand: OwnHand, posed: Posed, pieces: Pieces, fingers: BoolArray, near: float) -> Pairs:
    """Find all pairs of a body and a piece no more than `near` [m] apart, world, of the fingers in `fingers` (5,).

    With a triangle a phalanx has pairs at its nearest point and at both ends, where it touches a face that it lies flat
    on. No depth exceeds the radius, that of a body whose axis passes through the triangle.
    """
    found = list[Pairs]()
    # A palm that is far as a whole is left out.
    reach, spheres = float((np.linalg.norm(hand.palm_center, axis=1) + hand.palm_radius).max()) + near, hand.palm_radius
    for first in range(0, max(len(posed.joints), 1), CHUNK):
        some = posed.at(slice(first, first + CHUNK))
        used = np.repeat(pieces.counts(some.position, reach)[:, None] > 0, PALM + len(spheres), axis=1)
        used[:, :PALM] = np.repeat(fingers, 3)
        cones, within = own_cones(hand, some), np.where(used.ravel(), near, -np.inf)
        if pieces.triangles is None:
            row, piece = near_rows(cones, cones.thick + within, pieces)
            place, size = cones.at(row).nearest_balls(pieces.center[piece])
            pairs = ball_pairs(row, piece, place, size, place - pieces.center[piece], pieces.radius[piece])
        else:
            row, piece, share, _ = cones_near_triangles(cones, pieces, within)
            long = (cones.a != cones.b).any(axis=1)[row]
            ends = [np.flatnonzero(long & (share != end)) for end in (0.0, 1.0)]
            every = np.concatenate([np.arange(len(row)), *ends])
            at = np.concatenate([share, *(np.full(len(rows), end) for end, rows in enumerate(ends))])
            row, piece = row[every], piece[every]
            place, size = cones.at(row).balls(at)
            pairs = ball_pairs(row, piece, place, size, pieces.away(piece, place).T, 0.0)
        pairs = pairs.within(near)
        tick, body = np.divmod(pairs.body, PALM + len(spheres))
        found.append(pairs._replace(tick=tick + first, body=np.minimum(body, PALM)))
    return joined(found)


def joined(parts: Sequence[Pairs]) -> Pairs:
    """Pairs of several searches together, sorted by tick and body."""
    pairs = Pairs(*(np.concatenate(values) for values in zip(*parts)))
    return pairs.at(np.lexsort((pairs.body, pairs.tick)))


def lowest_places(count: int, falls: Callable[[FloatArray], BoolArray]) -> FloatArray:
    """Shares [0 to 1] of some axes where a convex distance is least, by where it `falls`, shape (count,)."""
    low, high = np.zeros(count), np.ones(count)
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        down = falls(share)
        low, high = np.where(down, share, low), np.where(down, high, share)
    # Bisection never arrives at an end.
    return np.where(low == 0.0, 0.0, np.where(high == 1.0, 1.0, 0.5 * (low + high)))


def ball_pairs(
    row: IntArray, leaf: IntArray, place: FloatArray, size: FloatArray, away: FloatArray, radius: FloatArray | float
) -> Pairs:
    """Pairs of the hand's balls (`place`, `size`) and pieces; their `body` is the row.

    `away` [m], shape (N, 3), leads to each ball's centre from the sphere's centre, of a given radius [m], or from the
    nearest point of the triangle, with radius 0.
    """
    length = np.linalg.norm(away, axis=1)
    normal = away / np.where(length > 0.0, length, 1.0)[:, None]
    distance = length - size - radius
    return Pairs(np.zeros(len(row), np.int64), row, leaf, distance, place - size[:, None] * normal, normal)


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
    solid = length > NO_AREA * square.max(axis=0)
    normal = np.where(solid, normal, 0.0) / np.where(solid, length, 1.0)
    inward = np.cross(normal[None], side, axis=1)
    return ReadyTriangles(start, side, 1.0 / np.where(square > 0.0, square, 1.0), inward, normal, solid)


def cones_near_triangles(
    cones: RoundCones, pieces: Pieces, near: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Find the round cones and triangles that are no more than `near` [m] apart.

    Args:
        cones: N round cones.
        pieces: All triangles.
        near: A number for each cone, shape (N,); -inf leaves it out.

    Returns:
        Of each pair the indices of cone and triangle, the share of the axis where the cone is nearest, and the signed
        distance [m]. An axis that passes through the triangle has the distance minus the cone's radius there.
    """
    triangles, (row, face) = pieces.triangles, near_rows(cones, cones.thick + near, pieces)
    assert triangles is not None
    of = cones.at(row)
    axis, drop = of.b - of.a, of.radius_b - of.radius_a
    long = np.asarray(axis.any(axis=1))
    ready, drops = triangles.at(face[long]), drop[long]
    start, along = np.ascontiguousarray(of.a[long].T), np.ascontiguousarray(axis[long].T)

    def falls(share: FloatArray) -> BoolArray:
        away = away_from_triangles(ready, start + share * along)
        length = np.sqrt((away * away).sum(axis=0))
        # Of an axis that lies in a triangle the larger ball is deepest.
        return np.where(length > LIES_IN, (away * along).sum(axis=0) < drops * length, drops > 0.0)

    # Of an axis without length the larger ball is nearest.
    share = np.where(drop > 0.0, 1.0, 0.0)
    share[long] = lowest_places(len(drops), falls)
    place, size = of.balls(share)
    distance = np.linalg.norm(pieces.away(face, place), axis=0) - size
    kept = np.flatnonzero(distance <= near[row])
    return row[kept], face[kept], share[kept], distance[kept]


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


def parts_that_may_meet(hand: OwnHand, fingers: BoolArray) -> BoolArray:
    """Return True for two bodies that may meet, shape (15, 16): of fingers that count, and apart in a straight hand.

    The angles of a straight hand are zero, or as near to it as the limits of flexion allow.
    """
    may = np.zeros((PALM, BODIES), bool)
    body = np.arange(PALM)
    may[:, :PALM] = body[:, None] // PER_FINGER < body // PER_FINGER
    may[:, PALM] = True
    used = np.append(np.repeat(fingers, PER_FINGER), True)
    may &= used[:PALM, None] & used
    straight = np.clip(np.zeros((1, *hand.flexion_min.shape)), hand.flexion_min, hand.flexion_max)
    at = HandConfiguration(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), straight, np.zeros((1, 5)))
    together = meetings(hand, pose(hand, at), may, 0.0)
    may[together.body, together.leaf] = False
    return may


def meetings(hand: OwnHand, posed: Posed, may: BoolArray, near: float) -> Pairs:
    """Find the pairs of `may` (15, 16) that are no more than `near` [m] apart; hands that are not finite have none.

    A pair's `leaf` is its second body, towards which the first one's normal points back.
    """
    spheres = len(hand.palm_radius)
    couples = np.zeros((PALM + spheres, PALM + spheres), bool)
    couples[:PALM] = np.concatenate([may[:, :PALM], np.repeat(may[:, PALM:], spheres, axis=1)], axis=1)
    return _between((hand, hand), (posed, posed), couples, near)


def meetings_of_two(hands: Sequence[OwnHand], posed: Sequence[Posed], near: float | FloatArray) -> Pairs:
    """Find the pairs of two hands' bodies that are no more than `near` [m] apart, the palm's spheres on both sides.

    `near` is a number, or has one for each tick, shape (T,).
    """
    bodies = (PALM + len(hand.palm_radius) for hand in hands)
    return _between(hands, posed, np.ones(tuple(bodies), bool), near)


def _between(hands: Sequence[OwnHand], posed: Sequence[Posed], couples: BoolArray, near: float | FloatArray) -> Pairs:
    """Find the pairs in `couples`, shape (B, C), of two hands' round cones that are at most `near` [m] apart."""
    ticks, found = len(posed[0].joints), list[Pairs]()
    near = np.broadcast_to(near, ticks)
    for start in range(0, max(ticks, 1), CHUNK):
        part = slice(start, start + CHUNK)
        within = near[part]
        cones = [own_cones(hand, at.at(part)) for hand, at in zip(hands, posed)]
        shapes = [(len(within), count) for count in couples.shape]
        middle, other_middle = ((0.5 * (of.a + of.b)).reshape(*size, 3) for of, size in zip(cones, shapes))
        reach, other_reach = (
            (0.5 * np.linalg.norm(of.b - of.a, axis=1) + of.thick).reshape(size) for of, size in zip(cones, shapes)
        )
        apart = np.linalg.norm(middle[:, :, None] - other_middle[:, None], axis=3)
        reach = reach[:, :, None] + other_reach[:, None] + within[:, None, None]
        tick, *bodies = np.nonzero(couples & (apart <= reach))
        one, other = (of.at(tick * size[1] + body) for of, size, body in zip(cones, shapes, bodies))

        def falls(share: FloatArray, one: RoundCones = one, other: RoundCones = other) -> BoolArray:
            place, axis, drop = one.balls(share)[0], one.b - one.a, one.radius_b - one.radius_a
            away = place - other.nearest_balls(place)[0]
            return np.asarray((away * axis).sum(axis=1) < drop * np.linalg.norm(away, axis=1))

        place, size = one.balls(lowest_places(len(tick), falls))
        across, radius = other.nearest_balls(place)
        first, second = np.minimum(bodies, PALM)
        pairs = ball_pairs(first, second, place, size, place - across, radius)
        found.append(pairs._replace(tick=tick + start).at(np.flatnonzero(pairs.distance <= within[tick])))
    return joined(found)
