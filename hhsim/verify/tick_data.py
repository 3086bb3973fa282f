"""What the claims of ticks are judged by: the stored hands placed anew, what they touch, and how they are pulled."""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.reader import Result
from hhsim.solver.method import never_penetrates
from hhsim.verify.contacts import PALM, Groups, Pairs, grouped, joined, near_pairs
from hhsim.verify.file_checks import follows, leaves, usable
from hhsim.verify.kinematics import Posed, configurations, own_hand, pose, turn_between
from hhsim.verify.mesh_contacts import ReadyTriangles, near_triangle_pairs, ready_triangles, triangle_groups

FINGERS = ("thumb", "index", "middle", "ring", "little")
STUCK, LAG, INPUT_INVALID, START_INSIDE, CAPACITY_EXCEEDED, ABDUCTION_HELD = 1, 2, 4, 8, 16, 32
"""Flags of a tick's status."""
LENGTH = 1e-9
"""Lengths that differ by this [m] are the same: a thousandth of the smallest that any table shows."""
BLOCK = 1024
"""Ticks whose pairs within the margin are in memory at once."""
ON_THE_WAY = 20.0
"""Offsets."""
NEAR_CONE = 0.03
"""Sine of the angle by which the line between a contact and a border may lean from what the solver pushes along."""
WHY_LENGTH = "a thousandth of the smallest length that a table shows"


class Nearness(NamedTuple):
    """What is near a hand at some ticks.

    | field | meaning | shape |
    |---|---|---|
    | pairs | those that touch, or nearly so | (N,) |
    | nearest | least distance of each body [m]; infinite where no pair is near | (n, 16) |
    | fewest, most | pairs that there can be where contacts are listed | (n,) |
    | fewest_bodies, most_bodies | the same of bodies that have such a pair | (n,) |
    """

    pairs: Pairs
    nearest: FloatArray
    fewest: IntArray
    most: IntArray
    fewest_bodies: IntArray
    most_bodies: IntArray


class JudgedTicks:
    """The ticks of a result as the referee has them; what is dear is worked out when it is first asked for.

    Args:
        result: Of a replay or a session.
        chosen: Ticks whose distances and forces are judged, ascending.
        asked: Those of them at which a library is asked, which is dear; None: all.

    Attributes:
        asked: Their places in `chosen`.
        hand: As the file has it.
        fingers: Which ones the scene models, shape (5,).
        status: Flags of all ticks, shape (T,).
        numbers: Of all ticks, shape (T,).
        shown: The graphic hand of all ticks.
        wanted: The user's hand of all ticks: what the solver was given, and held on to where it was not finite.
        shown_posed, wanted_posed: Where they are.
        chosen_shown, chosen_posed: The graphic hand of the chosen ticks, and where it is.
        diagonal: Of the coupling: palm 3 [N/m] and 3 [N·m/rad], flexion 15 [N·m/rad].
        scale: Of the same 21 rows, to N.
    """

    def __init__(self, result: Result, chosen: IntArray, asked: IntArray | None = None) -> None:
        """Place the hands of all ticks."""
        self.result, self.chosen = result, chosen
        self.asked = np.arange(len(chosen)) if asked is None else np.flatnonzero(np.isin(chosen, asked))
        self.hand = own_hand(result)
        self.options = result.scene["solver"]
        self.fingers = np.array([name in self.options["fingers"] for name in FINGERS])
        self.status: IntArray = np.asarray(result["status"])
        self.numbers = np.arange(result.ticks)
        self.shown = configurations(result, "graphic")
        self.wanted = self._last_good(configurations(result, "haptic"))
        self.shown_posed, self.wanted_posed = pose(self.hand, self.shown), pose(self.hand, self.wanted)
        self.chosen_shown = self.shown.at(chosen)
        self.chosen_posed = Posed(*(values[chosen] for values in self.shown_posed))
        g = self.options["stiffness"]
        self.diagonal = np.repeat([g["translation"], g["rotation"], g["flexion"]], [3, 3, 15]).astype(np.float64)
        self.scale = np.sqrt(g["translation"] / self.diagonal)

    def _last_good(self, haptic: HandConfiguration) -> HandConfiguration:
        good = usable(self.result)
        last = np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))
        return haptic.at(last)

    @property
    def safe(self) -> bool:
        """Whether the method promises that nothing penetrates."""
        return never_penetrates(self.options["method"])

    @property
    def on_mesh(self) -> bool:
        """Whether the hand touched the triangles of the mesh, and not spheres."""
        return self.result.surface == "mesh"

    @property
    def touch(self) -> float:
        """Pairs no farther apart than this touch [m]."""
        return float(self.options["touch"])

    @cached_property
    def stuck(self) -> IntArray:
        """Ticks that are stuck and whose tick before is in the file."""
        return np.flatnonzero((self.status & STUCK > 0) & follows(self.result))

    @cached_property
    def pull(self) -> FloatArray:
        """G (q_g − q_h) of all ticks, shape (T, 21)."""
        here, there = self.shown, self.wanted
        turn = turn_between(there.orientation, here.orientation)
        bend = (here.flexion - there.flexion).reshape(-1, 15)
        return np.concatenate([here.position - there.position, turn, bend], axis=1) * self.diagonal

    @cached_property
    def moved(self) -> FloatArray:
        """How far the farthest joint moved since the tick before [m], shape (T,); the first counts as far."""
        moved = np.linalg.norm(np.diff(self.shown_posed.joints, axis=0), axis=3).max(axis=(1, 2), initial=0.0)
        return np.concatenate([[np.inf], moved])

    @cached_property
    def last_step(self) -> FloatArray:
        """How far the farthest joint moved at most in the last step of each tick [m], if it settled, shape (T,)."""
        return np.minimum(self.moved, float(self.options["step_tolerance"]))

    @cached_property
    def _least_leaf(self) -> float:
        # What rolls on an edge or a corner of a mesh has its own radius alone.
        return 0.0 if self.on_mesh else float(leaves(self.result)[1].min())

    @property
    def rolling(self) -> float:
        """Least radius at which hand and object roll on each other [m]."""
        return self._least_leaf + float(min(self.hand.radius.min(), self.hand.palm_radius.min()))

    @property
    def bearing(self) -> float:
        """Pairs no farther apart than this bear a hand that is on its way [m]: its last step was not the last."""
        return max(self.touch, ON_THE_WAY * float(self.options["offset"]))

    @cached_property
    def bearing_within(self) -> FloatArray:
        """Pairs no farther apart than this can bear a force [m], of each body at the chosen ticks, shape (n, 16).

        The last program of a tick that settles keeps its contacts `offset` away to first order; they end as much
        farther away as they bend in its step. That is half of its square over the radius where a body rolls on an edge,
        and up to as much again where joints and palm turn.
        """
        phalanges = np.minimum(self.hand.radius[:, :-1], self.hand.radius[:, 1:]).ravel()
        rolling = self._least_leaf + np.append(phalanges, self.hand.palm_radius.min())
        settled = float(self.options["offset"]) + self.last_step[self.chosen, None] ** 2 / rolling
        late = self.status[self.chosen, None] & LAG > 0
        return np.where(late, self.bearing, np.clip(settled, self.touch, self.bearing))

    def bearing_at(self, i: int) -> Pairs:
        """Pairs that can bear a force at a chosen tick."""
        pairs = self.pairs.of(i)
        pairs = pairs.at(np.flatnonzero(pairs.distance <= self.bearing_within[i, pairs.body]))
        return self._with_sides(pairs) if self.on_mesh and self.status[self.chosen[i]] & LAG else pairs

    def _with_sides(self, pairs: Pairs) -> Pairs:
        """And with those at a triangle's border once more that lean little from its normal, along that normal.

        That is how such a row of the program pushes: its contact slides on over the border.
        """
        across = self._triangles.normal.T[pairs.leaf]
        side = np.sign((across * pairs.normal).sum(axis=1))
        lean = np.linalg.norm(np.cross(across, pairs.normal), axis=1)
        leaning = np.flatnonzero((lean > 0.0) & (lean <= NEAR_CONE))
        return joined([pairs, pairs.at(leaning)._replace(normal=(side[:, None] * across)[leaning])])

    @cached_property
    def _triangles(self) -> ReadyTriangles:
        return ready_triangles(stored_mesh(self.result).triangles)

    @cached_property
    def pieces(self) -> Groups:
        """Spheres or triangles, whichever the hand touched."""
        if self.on_mesh:
            return triangle_groups(stored_mesh(self.result).triangles)
        return grouped(*leaves(self.result))

    def _nearness(self, places: IntArray, reach: float) -> Nearness:
        """What is within `reach` [m] at some chosen ticks: of pairs that do not touch, which are many, only counts."""
        parts = []
        for block in np.array_split(places, range(BLOCK, len(places), BLOCK)):
            posed, size = Posed(*(values[block] for values in self.chosen_posed)), len(block)
            if self.on_mesh:
                found = near_triangle_pairs(self.hand, posed, self._triangles, self.pieces, self.fingers, reach)
            else:
                found = near_pairs(self.hand, posed, self.pieces, self.fingers, reach)
            pairs = found.within(2.0 * self.bearing)
            counts = self.pair_counts(found, self.surely, size)[0], self.pair_counts(found, self.margin, size)[1]
            bodies = (found.within(limit).bodies(size) for limit in (self.surely - LENGTH, self.margin + LENGTH))
            parts.append(Nearness(pairs._replace(tick=block[pairs.tick]), found.nearest(size), *counts, *bodies))
        pairs = joined([part.pairs for part in parts])
        return Nearness(pairs, *(np.concatenate(values) for values in zip(*(part[1:] for part in parts))))

    @cached_property
    def near(self) -> Nearness:
        """What is near at all chosen ticks; the numbers of listed pairs and bodies count where a library is asked."""
        wide = len(self.asked) == len(self.chosen) or self.result.free
        return self._nearness(np.arange(len(self.chosen)), self._listed if wide else 2.0 * self.bearing)

    @cached_property
    def listed(self) -> Nearness:
        """What is near where a library is asked, as far as contacts are listed."""
        return self.near if len(self.asked) == len(self.chosen) else self._nearness(self.asked, self._listed)

    @property
    def _listed(self) -> float:
        return max(2.0 * self.bearing, self.margin + 2.0 * LENGTH if self.safe else 0.0)

    @property
    def margin(self) -> float:
        """Pairs no farther apart than this [m] are candidates."""
        return float(self.options["margin"])

    @property
    def surely(self) -> float:
        """Pairs no farther apart than this [m] are listed: of triangles, what a step that ends a tick may reach."""
        return min(self.margin, 2.0 * float(self.options["step_tolerance"])) if self.on_mesh else self.margin

    @property
    def pairs(self) -> Pairs:
        """Pairs of the chosen ticks that touch, or nearly so."""
        return self.near.pairs

    @cached_property
    def touching(self) -> Pairs:
        """Those that touch."""
        return self.pairs.within(self.touch)

    @cached_property
    def miscounted(self) -> BoolArray:
        """Chosen ticks whose stored number of touching pairs is not the referee's, shape (len(chosen),)."""
        least, greatest = self.pair_counts(self.pairs, self.touch, len(self.chosen))
        counted = np.asarray(self.result["contacts/touching"])[self.chosen]
        return np.asarray((counted < least) | (counted > greatest))

    def pair_counts(self, pairs: Pairs, limit: float, size: int) -> tuple[IntArray, IntArray]:
        """Least and greatest number of pairs that each of `size` ticks can have within a limit [m], shapes (size,).

        A leaf is one piece. Of a triangle the solver counts face, edges and corners, and those of its neighbours once:
        at least one of each body that is near, and no more than all seven of each.
        """
        sure, possible = (pairs.within(limit + slack) for slack in (-LENGTH, LENGTH))
        greatest = np.bincount(possible.tick, minlength=size)
        if self.on_mesh:
            return sure.bodies(size), 7 * greatest
        return np.bincount(sure.tick, minlength=size), greatest

    @property
    def sphere_penetration(self) -> float:
        """Deepest in the leaf spheres [m]; NaN where they were not what the hand touched."""
        if self.on_mesh:
            return float("nan")
        return max(0.0, -float(self.near.nearest.min(initial=0.0)))

    def stored_forces(self, ticks: IntArray) -> FloatArray:
        """Force of each body [N], the palm's last, shape (n, 16, 3)."""
        phalanx = np.asarray(self.result["force/phalanx"])[ticks].reshape(-1, PALM, 3)
        palm = np.asarray(self.result["force/total"])[ticks] - phalanx.sum(axis=1)
        return np.concatenate([phalanx, palm[:, None]], axis=1)
