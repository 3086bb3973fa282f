"""What the claims of ticks are judged by: the stored hands placed anew, what they touch, and how they are pulled."""

from functools import cached_property

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.reader import Result
from hhsim.solver.method import never_penetrates
from hhsim.verify.contacts import PALM, Pairs, joined, near_pairs
from hhsim.verify.file_checks import follows, leaves
from hhsim.verify.kinematics import Posed, configurations, own_hand, pose, turn_between
from hhsim.verify.mesh_contacts import near_triangle_pairs, ready_triangles

FINGERS = ("thumb", "index", "middle", "ring", "little")
STUCK, LAG, INPUT_INVALID, START_INSIDE, CAPACITY_EXCEEDED, ABDUCTION_HELD = 1, 2, 4, 8, 16, 32
"""Flags of a tick's status."""
LENGTH = 1e-9
"""Lengths that differ by this [m] are the same: a thousandth of the smallest that any table shows."""
ON_THE_WAY = 20.0
"""Offsets."""
NEAR_CONE = 0.03
"""Sine of the angle by which the line between a contact and a border may lean from what the solver pushes along."""
WHY_LENGTH = "a thousandth of the smallest length that a table shows"


class JudgedTicks:
    """The ticks of a result as the referee has them; what is dear is worked out when it is first asked for.

    Args:
        result: Of a replay or a session.
        chosen: Ticks whose distances and forces are judged, ascending.

    Attributes:
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

    def __init__(self, result: Result, chosen: IntArray) -> None:
        """Place the hands of all ticks."""
        self.result, self.chosen = result, chosen
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
        good = np.ones(self.result.ticks, bool)
        for values in haptic:
            good &= np.isfinite(values).reshape(len(values), -1).all(axis=1)
        good &= np.linalg.norm(haptic.orientation, axis=1) > 0.0
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

    @property
    def bearing(self) -> float:
        """Pairs no farther apart than this bear a hand that is on its way [m]: its last step was not the last."""
        return max(self.touch, ON_THE_WAY * float(self.options["offset"]))

    def bearing_at(self, i: int) -> Pairs:
        """Pairs that can bear a force at a chosen tick."""
        if self.status[self.chosen[i]] & LAG == 0:
            return self.touching.of(i)
        pairs = self.pairs.within(self.bearing).of(i)
        return self._with_sides(pairs) if self.on_mesh else pairs

    def _with_sides(self, pairs: Pairs) -> Pairs:
        """And with those at a triangle's border once more that lean little from its normal, along that normal.

        That is how such a row of the program pushes: its contact slides on over the border.
        """
        across = self._face_normals[pairs.leaf]
        side = np.sign((across * pairs.normal).sum(axis=1))
        lean = np.linalg.norm(np.cross(across, pairs.normal), axis=1)
        leaning = np.flatnonzero((lean > 0.0) & (lean <= NEAR_CONE))
        return joined([pairs, pairs.at(leaning)._replace(normal=(side[:, None] * across)[leaning])])

    @cached_property
    def _face_normals(self) -> FloatArray:
        return ready_triangles(stored_mesh(self.result).triangles).normal.T

    @cached_property
    def candidates(self) -> Pairs:
        """Pairs of the chosen ticks within the margin, and a nanometre more."""
        near = 2.0 * self.bearing
        if self.safe:
            near = max(near, float(self.options["margin"]) + 2.0 * LENGTH)
        if self.on_mesh:
            triangles = stored_mesh(self.result).triangles
            return near_triangle_pairs(self.hand, self.chosen_posed, triangles, self.fingers, near)
        center, radius = leaves(self.result)
        return near_pairs(self.hand, self.chosen_posed, center, radius, self.fingers, near)

    @cached_property
    def pairs(self) -> Pairs:
        """Pairs of the chosen ticks that touch, or nearly so."""
        return self.candidates.within(2.0 * self.bearing)

    @cached_property
    def touching(self) -> Pairs:
        """Those that touch."""
        return self.pairs.within(self.touch)

    @cached_property
    def miscounted(self) -> BoolArray:
        """Chosen ticks whose stored number of touching pairs is not the referee's, shape (len(chosen),)."""
        least, greatest = self.pair_counts(self.pairs, self.touch)
        counted = np.asarray(self.result["contacts/touching"])[self.chosen]
        return np.asarray((counted < least) | (counted > greatest))

    def pair_counts(self, pairs: Pairs, limit: float) -> tuple[IntArray, IntArray]:
        """Least and greatest number of pairs that a chosen tick can have within a limit [m], shapes (len(chosen),).

        A leaf is one piece. Of a triangle the solver counts face, edges and corners, and those of its neighbours once:
        at least one of each body that is near, and no more than all seven of each.
        """
        size = len(self.chosen)
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
        return max(0.0, -float(self.pairs.distance.min(initial=0.0)))

    def stored_forces(self, ticks: IntArray) -> FloatArray:
        """Force of each body [N], the palm's last, shape (n, 16, 3)."""
        phalanx = np.asarray(self.result["force/phalanx"])[ticks].reshape(-1, PALM, 3)
        palm = np.asarray(self.result["force/total"])[ticks] - phalanx.sum(axis=1)
        return np.concatenate([phalanx, palm[:, None]], axis=1)
