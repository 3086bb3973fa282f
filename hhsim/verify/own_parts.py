"""Pairs of the hand's own parts as the referee finds them: by kinematics and bisections of its own.

The distance of two round cones is convex in the places on both axes: for each place on the one, bisection finds the
nearest on the other, and bisection over the first finds the least of these.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.verify.contacts import BODIES, PALM, RoundCones, axis_places, lowest_places, round_cones
from hhsim.verify.forces import Moment, pushes
from hhsim.verify.kinematics import OwnHand, Posed, pose

SAMPLES = 5
"""Points of each axis whose distances tell which pairs can be near."""
WORTH_A_LOOK = 1e-3
"""Slack [m] of the balls that tell which bodies of two hands can be near."""
TICKS = 256
"""Hands measured at once, to bound the memory."""
THUMB_TO_LITTLE, PER_FINGER = 5, 3


class Meetings(NamedTuple):
    """Near pairs of a phalanx and one of a later finger, or the palm."""

    tick: IntArray  # index of the searched tick, ascending (N,)
    first: IntArray  # 0 to 14 (N,)
    second: IntArray  # 0 to 14, or 15 for the palm (N,)
    distance: FloatArray  # signed [m] (N,)
    place: FloatArray  # nearest point of the first one's axis [m], world (N, 3)
    other: FloatArray  # nearest point of the second one's axis, or the centre of the palm's sphere [m], world (N, 3)
    normal: FloatArray  # unit, from the second to the first (N, 3)

    def at(self, rows: IntArray | BoolArray) -> "Meetings":
        """Return some of the pairs."""
        return Meetings._make(values[rows] for values in self)

    def nearest(self, ticks: int) -> FloatArray:
        """Least distance [m] of each body at each tick, shape (ticks, 16); infinite where no pair is near."""
        found = np.full((ticks, BODIES), np.inf)
        for body in (self.first, self.second):
            np.minimum.at(found, (self.tick, body), self.distance)
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
    at = HandConfiguration(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), straight, np.zeros((1, THUMB_TO_LITTLE)))
    joined = meetings(hand, pose(hand, at), may, 0.0)
    may[joined.first, joined.second] = False
    return may


def meetings(hand: OwnHand, posed: Posed, may: BoolArray, near: float) -> Meetings:
    """Find the pairs of `may` (15, 16) that are no more than `near` [m] apart; hands that are not finite have none."""
    spheres = PALM + np.arange(len(hand.palm_radius))
    couples = [(int(i), int(j)) for i, k in zip(*np.nonzero(may)) for j in ([k] if k < PALM else spheres)]
    bodies = round_cones(hand, posed)
    return _near(bodies, bodies, near, lambda a, b: couples)


def meetings_of_two(hands: Sequence[OwnHand], posed: Sequence[Posed], near: float) -> Meetings:
    """Find the pairs of two hands' bodies that are no more than `near` [m] apart, the palm's spheres on both sides."""
    bodies = [round_cones(hand, at) for hand, at in zip(hands, posed)]
    size = [np.maximum(one.radius_a, one.radius_b) for one in bodies]

    def couples(one: FloatArray, other: FloatArray) -> list[tuple[int, int]]:
        found = []
        for i in range(len(size[0])):
            apart = np.linalg.norm(one[:, i, None, SAMPLES // 2] - other[:, :, SAMPLES // 2], axis=2)
            length = [np.linalg.norm(points[0, :, -1] - points[0, :, 0], axis=1) for points in (one, other)]
            reach = 0.5 * (length[0][i] + length[1]) + size[0][i] + size[1] + near
            found += [(i, int(j)) for j in np.flatnonzero((apart <= reach + WORTH_A_LOOK).any(axis=0))]
        return found

    return _near(bodies[0], bodies[1], near, couples)


def _near(
    one: RoundCones, other: RoundCones, near: float, couples: Callable[[FloatArray, FloatArray], list[tuple[int, int]]]
) -> Meetings:
    shares, found = np.linspace(0.0, 1.0, SAMPLES)[:, None], []
    for start in range(0, max(len(one.a), 1), TICKS):
        blocks = [(of.a[start : start + TICKS], of.b[start : start + TICKS]) for of in (one, other)]
        points = [a[:, :, None] + shares * (b - a)[:, :, None] for a, b in blocks]
        gap = [
            0.5 / (SAMPLES - 1) * np.linalg.norm(b - a, axis=2) + np.maximum(of.radius_a, of.radius_b)
            for (a, b), of in zip(blocks, (one, other))
        ]
        rows = [np.zeros((3, 0), np.int64)]
        for i, j in couples(*points):
            facing_points = points[1][:, j, None] if j < PALM else points[1][:, j, None, :1]
            apart = np.linalg.norm(points[0][:, i, :, None] - facing_points, axis=3).min(axis=(1, 2))
            tick = np.flatnonzero(apart <= gap[0][:, i] + gap[1][:, j] + near)
            rows.append(np.stack([tick, np.full(len(tick), i), np.full(len(tick), j)]))
        tick, first, second = np.concatenate(rows, axis=1)
        (a, b), (c, d) = blocks
        axis, drop = (b - a)[tick, first], (one.radius_b - one.radius_a)[first]
        facing = partial(axis_places, c[tick, second], d[tick, second], other.radius_a[second], other.radius_b[second])

        def falls(share: FloatArray, own: Any = (a[tick, first], axis, drop, facing)) -> BoolArray:
            place = own[0] + share[:, None] * own[1]
            away = place - own[3](place)[0]
            return np.asarray((away * own[1]).sum(axis=1) < own[2] * np.linalg.norm(away, axis=1))

        share = lowest_places(len(tick), falls)
        place = a[tick, first] + share[:, None] * axis
        across, radius = facing(place)
        length = np.linalg.norm(place - across, axis=1)
        normal = (place - across) / np.where(length > 0.0, length, 1.0)[:, None]
        distance = length - one.radius_a[first] - share * drop - radius
        parts = np.minimum(first, PALM), np.minimum(second, PALM)
        pairs = Meetings(tick + start, *parts, distance, place, across, normal)
        found.append(pairs.at(distance <= near))
    every = Meetings(*(np.concatenate(values) for values in zip(*found)))
    return every.at(np.lexsort((every.second, every.first, every.tick)))


def with_meetings(at: Moment, posed: Posed, pairs: Meetings, i: int) -> Moment:
    """Add the pairs of tick `i` of `posed` to what can push there: each pushes its parts, one against the other."""
    first = pushes(posed, i, pairs.first, pairs.place, pairs.normal)
    second = pushes(posed, i, pairs.second, pairs.other, -pairs.normal)
    # Between two parts of the hand nothing acts on the whole of it.
    jacobian = np.where(np.arange(21) < 6, 0.0, first[0] + second[0])
    return at._replace(
        jacobian=np.concatenate([at.jacobian, jacobian]),
        bodies=np.concatenate([at.bodies, first[1] + second[1]]),
        distance=np.concatenate([at.distance, pairs.distance]),
        body=np.concatenate([at.body, pairs.first]),
    )
