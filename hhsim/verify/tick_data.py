"""Ticks as the referee judges them: postures of the stored hands, near pairs, contacts and the coupling's pull.

Of a recorded session they have the sample that each tick used, and the span in which it ran. The loop sleeps until a
tick is due, reads, solves, sends commands and sleeps again, or begins the next tick at once. So a tick's work lies
between its wake-up and the next deadline, or the next begin, and a sample belongs to the tick in whose span its bytes
were read.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, FloatArray, IntArray
from hhsim.result.reader import Result
from hhsim.result.safety import WORDS, Safety
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
from hhsim.verify.file_checks import follows, usable
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
MOST_ANGLE = 2.0 * np.pi
"""Largest plausible joint angle [rad]: samples beyond are not used."""
MOST_READ = 64
"""Most samples taken by one tick."""
HANDED_OVER = 20_000_000
"""Longest time from the stamp of a sample's hand-over to the end of it [ns]: a driver may be stopped in between."""
QUIET = 1_000_000_000
"""Time in which the log does not repeat a line [ns]."""
LOOP_DIED = "the loop failed or was killed"
"""Reason of the end of a session whose loop was not brought to its end."""


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
    fewest: IntArray  # least and greatest possible number of listed pairs (n,)
    most: IntArray
    fewest_bodies: IntArray  # least and greatest possible number of bodies with a listed pair (n,)
    most_bodies: IntArray


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
        # Distance up to which pairs are certainly listed [m]: of triangles, the reach of a tick's final step.
        self.surely = min(self.margin, 2.0 * float(self.options["step_tolerance"])) if self.on_mesh else self.margin
        self._listed = max(2.0 * self.bearing, self.margin + 2.0 * LENGTH if self.safe else 0.0)

    @cached_property
    def stuck(self) -> IntArray:
        """Stuck ticks whose tick before is in the file."""
        return np.flatnonzero((self.status & STUCK > 0) & follows(self.result))

    @cached_property
    def pull(self) -> FloatArray:
        """Pull of the coupling G (q_g − q_h) at all ticks, shape (T, 21)."""
        here, there = self.shown, self.wanted
        turn = turn_between(there.orientation, here.orientation)
        bend = (here.flexion - there.flexion).reshape(-1, 15)
        return np.concatenate([here.position - there.position, turn, bend], axis=1) * self.diagonal

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

    @cached_property
    def carried(self) -> BoolArray:
        """Ticks in which a part moved since the tick before, shape (T,)."""
        moved = np.zeros(self.result.ticks, bool)
        for motion in self.result.meshes_moved() if len(self.result.bodies) > 1 else ():
            moved[1:] |= np.diff(np.concatenate(motion, axis=1), axis=0).any(axis=1)
        return moved

    def near_body(self, body: JudgedBody, places: IntArray, reach: float) -> Pairs:
        """Find the pairs with one body within `reach` [m] at some chosen ticks, which are counted from 0."""
        posed = body.seen(self.chosen_posed, places)
        if self.on_mesh:
            found = near_triangle_pairs(self.hand, posed, body.triangles, body.pieces, self.fingers, reach)
        else:
            found = near_pairs(self.hand, posed, body.pieces, self.fingers, reach)
        return body.placed(found, places)

    def _nearness(self, places: IntArray, reach: float) -> Nearness:
        """Find what is within `reach` [m] at some chosen ticks; distant pairs, which are many, are only counted."""
        found_blocks = []
        for block in np.array_split(places, range(BLOCK, len(places), BLOCK)):
            size = len(block)
            found = joined([self.near_body(body, block, reach) for body in self.bodies])
            pairs = found.within(2.0 * self.bearing)
            counts = self.pair_counts(found, self.surely, size)[0], self.pair_counts(found, self.margin, size)[1]
            bodies = (found.within(limit).bodies(size) for limit in (self.surely - LENGTH, self.margin + LENGTH))
            found_blocks.append(Nearness(pairs._replace(tick=block[pairs.tick]), found.nearest(size), *counts, *bodies))
        pairs = joined([found.pairs for found in found_blocks])
        return Nearness(pairs, *(np.concatenate(values) for values in zip(*(found[1:] for found in found_blocks))))

    @cached_property
    def near(self) -> Nearness:
        """Near pairs at all chosen ticks; counts of listed pairs and bodies are valid where a library is asked."""
        wide = len(self.asked) == len(self.chosen) or self.result.body.is_free
        return self._nearness(np.arange(len(self.chosen)), self._listed if wide else 2.0 * self.bearing)

    @cached_property
    def listed(self) -> Nearness:
        """Near pairs where a library is asked, as far as contacts are listed."""
        return self.near if len(self.asked) == len(self.chosen) else self._nearness(self.asked, self._listed)

    @property
    def pairs(self) -> Pairs:
        """Pairs of the chosen ticks that touch, or nearly so."""
        return self.near.pairs

    @cached_property
    def touching(self) -> Pairs:
        """Pairs that touch."""
        return self.pairs.within(self.touch)

    @cached_property
    def miscounted(self) -> BoolArray:
        """Chosen ticks whose stored number of touching pairs is wrong, shape (len(chosen),)."""
        least, greatest = self.pair_counts(self.pairs, self.touch, len(self.chosen))
        counted = np.asarray(self.result["contacts/touching"])[self.chosen]
        return np.asarray((counted < least) | (counted > greatest))

    def pair_counts(self, pairs: Pairs, limit: float, size: int) -> tuple[IntArray, IntArray]:
        """Least and greatest number of pairs within a limit [m] at each of `size` ticks, shapes (size,).

        A leaf is one piece. The solver counts faces, edges and corners of triangles, shared ones once: at least one of
        each near body, at most all seven of each triangle.
        """
        sure, possible = (pairs.within(limit + slack) for slack in (-LENGTH, LENGTH))
        greatest = np.bincount(possible.tick, minlength=size)
        if self.on_mesh:
            return sure.bodies(size), 7 * greatest
        return np.bincount(sure.tick, minlength=size), greatest

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


class SessionRows:
    """Tables of a session; arrays have shape (T,) and are as /live/tick unless a comment says otherwise."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.live: dict[str, Any] = dict(result.live or {})  # description of the session
        self.limits: dict[str, Any] = result.told("limits")  # of output and safety
        self.dry_run = bool(self.live["dry_run"])  # True if nothing was sent
        self.period_ns = round(1e9 / float(result.scene["rate"]))  # of a tick
        # Most that a bend moves in it.
        self.bend_step = float(self.limits["output"]["bend_speed"]) * 1e-9 * self.period_ns
        self.numbers = np.arange(result.ticks)
        self.follows = follows(result)  # True if the row before is the tick before
        self.period, self.deadline, self.early, self.wakeup, self.latency, self.missed, self.safety = (
            np.asarray(result[f"live/tick/{name}"], np.int64)
            for name in ("period", "deadline", "early", "wakeup", "latency", "missed", "safety")
        )
        self.at_once = np.asarray(result["live/tick/at_once"], bool)
        self.bend = np.asarray(result["live/tick/command_bend"])  # command to each finger, (T, 5)
        self.stiffness = np.asarray(result["live/tick/command_stiffness"])  # (T, 5)
        slept_over = self.wakeup // self.period_ns * self.period_ns
        self.woke = self.deadline + self.wakeup - slept_over  # wake-up of the loop, or begin of the tick [ns]
        # The span of a tick that is not in the file, because the solver failed, is unknown.
        whole = np.zeros(result.ticks, bool)
        whole[1:] = np.diff(self.period) == 1 + self.missed[1:]
        whole &= self.follows
        self.closed = np.append(whole[1:], False)  # True where the end of the tick's span is known
        # That end: the next deadline slept for, or the begin of a tick at once [ns].
        self.over = np.append(np.where(self.at_once, self.woke, self.deadline - slept_over)[1:], 0)

    @cached_property
    def samples(self) -> dict[str, AnyArray]:
        """Columns of /live/sample, by name."""
        names = ("record", "seq", "time", "handed", "good", "flexion", "abduction")
        return {name: np.asarray(self.result[f"live/sample/{name}"]) for name in names}

    @property
    def samples_whole(self) -> bool:
        """True if every sample that came should be in the file."""
        return self.result.complete and int(self.live["lost_samples"]) == 0

    @cached_property
    def usable(self) -> BoolArray:
        """True for finite, plausible samples, shape (S,)."""
        angles = np.concatenate(
            [self.samples["flexion"].reshape(-1, 15), self.samples["abduction"].reshape(-1, 5)], axis=1
        )
        # NaN compares false.
        return np.asarray((self.samples["good"] == 1) & (np.abs(angles) <= MOST_ANGLE).all(axis=1))

    @cached_property
    def used(self) -> IntArray:
        """Row of the sample that each tick used, -1 where it is not in the file, shape (T,)."""
        seq, wanted = self.samples["seq"], np.asarray(self.result["input_seq"], np.int64)
        if len(seq) == 0:
            return np.full(len(wanted), -1)
        order = np.argsort(seq, kind="stable")
        place = np.clip(np.searchsorted(seq[order], wanted), 0, len(seq) - 1)
        row = order[place]
        return np.where(seq[row] == wanted, row, -1)

    @cached_property
    def newest(self) -> IntArray:
        """Row of the last sample that was certainly there when each tick began, -1 for none, shape (T,).

        The driver hands samples over one by one: at the stamp of one, the one before is there.
        """
        handed = self.samples["handed"]
        return np.maximum(np.searchsorted(handed, self.woke - HANDED_OVER) - 1, np.searchsorted(handed, self.woke) - 2)

    @cached_property
    def clear(self) -> BoolArray:
        """True for ticks whose samples are known: a burst of more than `MOST_READ` is taken by several ticks."""
        if not self.samples_whole:
            return np.zeros(self.result.ticks, bool)
        before = np.concatenate([[-1], self.used[:-1]])
        return np.asarray(self.closed & (self.used >= 0) & (self.newest - before < MOST_READ))

    def solver_failed(self, begin: IntArray, end: IntArray) -> BoolArray:
        """True where the log tells, or may have lost, a failed solver between stamps [ns] (N,) or shortly before."""
        if int(self.live["lost_events"]) > 0:
            return np.ones(len(begin), bool)
        stamps = np.asarray(self.result["live/event/time"], np.int64)
        failed = stamps[np.array([text.startswith(WORDS[Safety.SOLVER_FAILED]) for text in self.log], bool)]
        return np.asarray(((failed > begin[:, None] - QUIET) & (failed < end[:, None])).any(axis=1))

    @cached_property
    def log(self) -> list[str]:
        """Lines of the session's log."""
        return [bytes(text).rstrip(b"\0").decode("utf-8", "replace") for text in self.result["live/event/text"]]
