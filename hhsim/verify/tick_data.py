"""Ticks as the referee judges them: postures of the stored hands, near pairs, contacts and the coupling's pull."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.result.reader import Result
from hhsim.result.schema import HANDS_APART
from hhsim.solver.method import never_penetrates
from hhsim.verify.contacts import (
    PALM,
    Meetings,
    Pairs,
    joined,
    meetings,
    meetings_of_two,
    near_pairs,
    near_triangle_pairs,
    parts_that_may_meet,
)
from hhsim.verify.file_checks import usable
from hhsim.verify.judged_body import JudgedBody, judged_bodies
from hhsim.verify.kinematics import configurations, own_hand, pose, turn_between

FINGERS = ("thumb", "index", "middle", "ring", "little")
STUCK, LAG, INPUT_INVALID, START_INSIDE, CAPACITY_EXCEEDED, ABDUCTION_HELD, NO_PLACE, SNAP = 1, 2, 4, 8, 16, 32, 64, 128
"""Flags of a tick's status."""
FLAGS = {
    STUCK: "stuck",
    LAG: "with lag",
    INPUT_INVALID: "of held input",
    START_INSIDE: "begun inside",
    CAPACITY_EXCEEDED: "full",
    ABDUCTION_HELD: "of held abduction",
    NO_PLACE: "without a place",
    SNAP: "that snap",
}
"""What ticks with a flag are called."""
UNSETTLED = STUCK | LAG | INPUT_INVALID | START_INSIDE | CAPACITY_EXCEEDED | NO_PLACE | SNAP
LENGTH = 1e-9
"""Tolerance of lengths [m]: a thousandth of the smallest that any table shows."""
BLOCK = 1024
"""Ticks whose near pairs are in memory at once."""
ON_THE_WAY = 20.0
"""Distance of bearing pairs in a tick that lags, as a multiple of `offset`."""
NEAR_CONE = 0.03
"""Sine of the largest angle between a contact at a border and the normal that the solver pushes along."""
WHY_LENGTH = "a thousandth of the smallest length that a table shows"


def left_out(status: IntArray, flags: int) -> str:
    """Name the ticks that some flags keep from a claim, by their statuses (T,); "" for none."""
    counts = {word: np.count_nonzero(status & flag) for flag, word in FLAGS.items() if flag & flags}
    told = ", ".join(f"{count:,} {word}" for word, count in counts.items() if count)
    return f"left out: {told}" if told else ""


def other_hand(result: Result) -> Result | None:
    """Return the result of the other of two hands that keep apart, in the same frame; None where there is none."""
    if result.other is None or not (result.body.is_free or result.scene.get(HANDS_APART)):
        return None
    return result.other if result.view is None else result.other.seen_by(result.view)


class Nearness(NamedTuple):
    """Pairs near the hand at n ticks."""

    pairs: Pairs  # pairs that touch, or nearly so
    nearest: FloatArray  # least distance of each body [m], infinite for none near (n, 16)


class JudgedTicks:
    """Ticks of a replay or a session, judged lazily.

    Distances and forces are judged at the chosen ticks, ascending; a slow library at those that are `asked`, None: all.
    """

    def __init__(self, result: Result, chosen: IntArray, asked: IntArray | None = None) -> None:
        self.result, self.chosen = result, chosen
        # Indices in `chosen`.
        self.asked = np.arange(len(chosen)) if asked is None else np.flatnonzero(np.isin(chosen, asked))
        self.hand = own_hand(result)
        self.options = result.scene["solver"]
        self.fingers = np.array([name in self.options["fingers"] for name in FINGERS])  # True for modelled ones
        self.status: IntArray = np.asarray(result["status"])
        self.numbers = np.arange(result.ticks)
        self.shown = configurations(result, "graphic")  # graphic hand of all ticks
        # Haptic hand of all ticks, which holds its last usable value.
        last_usable = np.maximum.accumulate(np.where(usable(result), self.numbers, 0))
        self.wanted = configurations(result, "haptic").at(last_usable)
        self.shown_posed, self.wanted_posed = pose(self.hand, self.shown), pose(self.hand, self.wanted)
        self.chosen_shown = self.shown.at(chosen)
        self.chosen_posed = self.shown_posed.at(chosen)
        # Stiffness of the coupling: palm 3 [N/m] and 3 [N·m/rad], flexion 15 [N·m/rad]; and its rows' factors, to N.
        g = self.options["stiffness"]
        self.diagonal = np.repeat([g["translation"], g["rotation"], g["flexion"]], [3, 3, 15]).astype(np.float64)
        self.scale = np.sqrt(g["translation"] / self.diagonal)
        # Whether the method promises that nothing penetrates, and the hand touched triangles.
        self.safe, self.on_mesh = never_penetrates(self.options["method"]), result.surface == "mesh"
        self.self_contact = bool(self.options.get("self_contact", False))
        self.other = other_hand(result)
        # Largest distances [m] of a touching and of a candidate pair, and of one that bears a force in a lagging tick,
        # whose last step was not the last.
        self.touch, self.margin = float(self.options["touch"]), float(self.options["margin"])
        self.bearing = max(self.touch, ON_THE_WAY * float(self.options["offset"]))

    @cached_property
    def pull(self) -> FloatArray:
        """Pull of the coupling G (q_g − q_h) at all ticks, shape (T, 21)."""
        here, there = self.shown, self.wanted
        turn = turn_between(there.orientation, here.orientation)
        bend = (here.flexion - there.flexion).reshape(-1, 15)
        return np.concatenate([here.position - there.position, turn, bend], axis=1) * self.diagonal

    @cached_property
    def springs_of_way(self) -> FloatArray:
        """Springs G times the shown hand's way since the tick before, shape (T, 21): 0 at the first tick."""
        here = self.shown
        turn = turn_between(here.orientation[:-1], here.orientation[1:])
        way = [np.diff(here.position, axis=0), turn, np.diff(here.flexion.reshape(-1, 15), axis=0)]
        return np.concatenate([np.zeros((1, 21)), np.concatenate(way, axis=1)]) * self.diagonal

    @cached_property
    def moved(self) -> FloatArray:
        """Travel of the farthest joint since the tick before [m], shape (T,); infinite at the first tick."""
        moved = np.linalg.norm(np.diff(self.shown_posed.joints, axis=0), axis=3).max(axis=(1, 2), initial=0.0)
        return np.concatenate([[np.inf], moved])

    @cached_property
    def last_step(self) -> FloatArray:
        """Upper bound of the farthest joint's travel in the last step of a settled tick [m], shape (T,)."""
        return np.minimum(self.moved, float(self.options["step_tolerance"]))

    @cached_property
    def _least_leaf(self) -> float:
        # Rolling on an edge or a corner of a mesh has the hand's radius alone.
        return 0.0 if self.on_mesh else float(min(body.radius.min() for body in self.bodies))

    @property
    def rolling(self) -> float:
        """Least radius at which hand and object roll on each other [m]."""
        return self._least_leaf + float(min(self.hand.radius.min(), self.hand.palm_radius.min()))

    @cached_property
    def bearing_within(self) -> FloatArray:
        """Largest distance of a pair that bears a force [m], of each body at the chosen ticks, shape (n, 16).

        The last program of a settled tick keeps contacts `offset` away to first order; the second order is half the
        step's square over the radius of a body on an edge, and up to as much again for turning joints and palm.
        """
        phalanges = np.minimum(self.hand.radius[:, :-1], self.hand.radius[:, 1:]).ravel()
        rolling = self._least_leaf + np.append(phalanges, self.hand.palm_radius.min())
        settled = float(self.options["offset"]) + self.last_step[self.chosen, None] ** 2 / rolling
        late = self.status[self.chosen, None] & LAG > 0
        return np.where(late, self.bearing, np.clip(settled, self.touch, self.bearing))

    @cached_property
    def meetings(self) -> Meetings:
        """Pairs of the hand's own parts at the chosen ticks that touch, or nearly so; none without self-contact."""
        may = parts_that_may_meet(self.hand, self.fingers & self.self_contact)
        return meetings(self.hand, self.chosen_posed, may, 2.0 * self.bearing)

    def meetings_at(self, i: int) -> Meetings:
        """Pairs of the hand's own parts that can bear a force at the chosen tick of index i."""
        found = self.meetings.at(np.arange(*np.searchsorted(self.meetings.tick, [i, i + 1])))
        within = self.bearing_within[i]
        return found.at(found.distance <= np.maximum(within[found.first], within[found.second]))

    def of_other_hand(self, ticks: IntArray, near: float) -> Meetings:
        """Pairs with the other hand's bodies that are within `near` [m] at some ticks."""
        assert self.other is not None
        theirs = own_hand(self.other), configurations(self.other, "graphic").at(ticks)
        return meetings_of_two((self.hand, theirs[0]), (self.shown_posed.at(ticks), pose(*theirs)), near)

    @cached_property
    def against_other_hand(self) -> Pairs:
        """Pairs with the other hand at the chosen ticks that touch, or nearly so; none where it is not seen."""
        if self.other is None:
            return self.pairs.at(np.zeros(0, np.int64))
        found = self.of_other_hand(self.chosen, 2.0 * self.bearing)
        return Pairs(found.tick, found.first, np.full(len(found.tick), -1), found.distance, found.place, found.normal)

    def bearing_at(self, i: int) -> Pairs:
        """Pairs that can bear a force at the chosen tick of index i, with the object or the other hand."""
        others = self.against_other_hand.of(i)
        within = self.bearing_within[i, others.body]
        return joined([self._bearing_on_object(i), others.at(np.flatnonzero(others.distance <= within))])

    def _bearing_on_object(self, i: int) -> Pairs:
        """Pairs with the object that can bear a force at the chosen tick of index i.

        On a mesh, those of a tick that lags and lean little from the normal of the triangle whose border they are at
        are there along that normal too: the program pushes along it, and the contact slides on over the border.
        """
        pairs = self.pairs.of(i)
        pairs = pairs.at(np.flatnonzero(pairs.distance <= self.bearing_within[i, pairs.body]))
        if not self.on_mesh or not self.status[self.chosen[i]] & LAG:
            return pairs
        across = self._across(pairs, i)
        side = np.sign((across * pairs.normal).sum(axis=1))
        lean = np.linalg.norm(np.cross(across, pairs.normal), axis=1)
        leaning = np.flatnonzero((lean > 0.0) & (lean <= NEAR_CONE))
        return joined([pairs, pairs.at(leaning)._replace(normal=(side[:, None] * across)[leaning])])

    def _across(self, pairs: Pairs, i: int) -> FloatArray:
        """Normals of the triangles of pairs of the chosen tick of index i, shape (N, 3)."""
        found = np.empty((len(pairs.leaf), 3))
        for body in self.bodies:
            of = body.of(pairs)
            normal = body.triangles.normal.T[pairs.leaf[of] - body.first]
            found[of] = normal if body.turn is None else normal @ body.turn[i].T
        return found

    @cached_property
    def bodies(self) -> tuple[JudgedBody, ...]:
        """Object, or parts of a body, where they are at the chosen ticks."""
        return judged_bodies(self.result, self.chosen)

    @property
    def squeezed(self) -> BoolArray:
        """Chosen ticks that say that moving parts left the hand no place."""
        return np.asarray(self.status[self.chosen] & NO_PLACE > 0)

    def near_body(self, body: JudgedBody, places: IntArray, reach: float) -> Pairs:
        """Find the pairs with one body within `reach` [m] at some chosen ticks, which are counted from 0."""
        posed = body.seen(self.chosen_posed, places)
        if self.on_mesh:
            found = near_triangle_pairs(self.hand, posed, body.triangles, body.pieces, self.fingers, reach)
        else:
            found = near_pairs(self.hand, posed, body.pieces, self.fingers, reach)
        return body.placed(found, places)

    @cached_property
    def near(self) -> Nearness:
        """Near pairs at all chosen ticks; distant pairs, which are many, are only measured, beside a free body."""
        reach = max(2.0 * self.bearing, self.margin if self.result.body.is_free else 0.0)
        found_blocks, places = [], np.arange(len(self.chosen))
        for block in np.array_split(places, range(BLOCK, len(places), BLOCK)):
            found = joined([self.near_body(body, block, reach) for body in self.bodies])
            pairs = found.within(2.0 * self.bearing)
            found_blocks.append(Nearness(pairs._replace(tick=block[pairs.tick]), found.nearest(len(block))))
        pairs = joined([found.pairs for found in found_blocks])
        return Nearness(pairs, np.concatenate([found.nearest for found in found_blocks]))

    @property
    def pairs(self) -> Pairs:
        """Pairs of the chosen ticks that touch, or nearly so."""
        return self.near.pairs

    @cached_property
    def touching(self) -> Pairs:
        """Pairs that touch."""
        return self.pairs.within(self.touch)

    @property
    def sphere_penetration(self) -> float:
        """Maximum depth in the leaf spheres [m]; NaN for a hand that touches triangles."""
        if self.on_mesh:
            return float("nan")
        return max(0.0, -float(self.near.nearest.min(initial=0.0)))

    def stored_forces(self, ticks: IntArray) -> FloatArray:
        """Force of each body [N], the palm's last, shape (n, 16, 3)."""
        phalanx = np.asarray(self.result["force/phalanx"])[ticks].reshape(-1, PALM, 3)
        palm = np.asarray(self.result["force/total"])[ticks] - phalanx.sum(axis=1)
        return np.concatenate([phalanx, palm[:, None]], axis=1)
