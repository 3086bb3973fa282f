"""Ticks as the referee judges them, in the world: bodies, postures of the hands, near pairs and the coupling's pull."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.result.reader import Result
from hhsim.result.schema import HANDS_APART
from hhsim.solver.method import methods_that
from hhsim.system.counted import counted
from hhsim.verify.contacts import Pairs, Pieces, joined, meetings, meetings_of_two, near_pairs, parts_that_may_meet
from hhsim.verify.file_checks import usable
from hhsim.verify.kinematics import Posed, configurations, own_hand, pose, rotations, turn_between
from hhsim.verify.tree_checks import leaves

FINGERS = ("thumb", "index", "middle", "ring", "little")
STUCK, LAG, INPUT_INVALID, START_INSIDE, CAPACITY_EXCEEDED, ABDUCTION_HELD, NO_PLACE, SNAP = 1, 2, 4, 8, 16, 32, 64, 128
"""Flags of a tick's status."""
LENGTH = 1e-9
"""Tolerance of lengths [m]: a thousandth of the smallest that any table shows."""
BLOCK = 1024
"""Ticks whose near pairs are in memory at once."""
FARTHEST_BEARING = 20.0
"""Largest distance of pairs that bear a force, as a multiple of `offset`."""
WHY_LENGTH = "a thousandth of the smallest length that a table shows"


def left_out(status: IntArray, flags: int) -> str:
    """Return in words how many ticks some flags keep from a claim, by their statuses (T,); "" for none."""
    count = int(np.count_nonzero(status & flags))
    return f"left out: {counted(count, 'tick')} of other states" if count else ""


@dataclass(frozen=True, eq=False)
class JudgedBody:
    """A body in a frame of its own, and where that is at n ticks."""

    mesh: Mesh  # [m]
    pieces: Pieces  # leaf spheres or triangles, whichever the hand touches
    first: int  # number of its first piece among those of all bodies
    turn: FloatArray  # rotation matrix to the world (n, 3, 3)
    shift: FloatArray  # translation to the world [m] (n, 3)

    def seen_points(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return points [m], shape (m, ..., 3), at the ticks of these rows as the body sees them."""
        flat = points.reshape(len(points), math.prod(points.shape[1:-1]), 3) - self.shift[rows][:, None]
        return np.asarray(np.einsum("tji,tkj->tki", self.turn[rows], flat).reshape(points.shape))

    def seen(self, posed: Posed, rows: IntArray) -> Posed:
        """Return the hands of these rows as the body sees them."""
        here = posed.at(rows)
        axes = np.einsum("tji,tfj->tfi", self.turn[rows], here.axes)
        joints, palm, position = (self.seen_points(points, rows) for points in (here.joints, here.palm, here.position))
        return Posed(joints, axes, palm, position)

    def placed(self, pairs: Pairs, rows: IntArray) -> Pairs:
        """Return pairs that the body sees, of ticks that are places in these rows, in the world."""
        pairs = pairs._replace(leaf=pairs.leaf + self.first)
        at = rows[pairs.tick]
        point, normal = (np.einsum("nij,nj->ni", self.turn[at], of) for of in (pairs.point, pairs.normal))
        return pairs._replace(point=point + self.shift[at], normal=normal)


class JudgedTicks:
    """Ticks of a replay or a session, judged lazily; a slow library looks at those that are `asked`, None: all."""

    def __init__(self, result: Result, asked: IntArray | None = None) -> None:
        self.result = result
        self.numbers = np.arange(result.ticks)
        self.asked = self.numbers if asked is None else asked
        self.hand = own_hand(result)
        self.options = result.scene["solver"]
        self.fingers = np.array([name in self.options["fingers"] for name in FINGERS])  # True for modelled ones
        self.status: IntArray = np.asarray(result["status"])
        self.shown = configurations(result, "graphic")
        # Haptic hand, which holds its last usable value.
        last_usable = np.maximum.accumulate(np.where(usable(result), self.numbers, 0))
        self.wanted = configurations(result, "haptic").at(last_usable)
        self.posed = pose(self.hand, self.shown)
        # Stiffness of the coupling: palm 3 [N/m] and 3 [N·m/rad], flexion 15 [N·m/rad]; and its rows' factors, to N.
        g = self.options["stiffness"]
        self.diagonal = np.repeat([g["translation"], g["rotation"], g["flexion"]], [3, 3, 15]).astype(np.float64)
        self.scale = np.sqrt(g["translation"] / self.diagonal)
        # Whether the method promises that nothing penetrates, and the hand touched triangles.
        self.safe, self.on_mesh = self.options["method"] in methods_that("never_penetrates"), result.surface == "mesh"
        self.self_contact = bool(self.options.get("self_contact", False))
        keeps_apart = result.body.is_free or result.scene.get(HANDS_APART)
        self.other = result.other if keeps_apart else None  # other of two hands that keep apart
        # Largest distances [m] of a touching and of a candidate pair, and of one that bears a force.
        self.touch, self.margin = float(self.options["touch"]), float(self.options["margin"])
        self.bearing = max(self.touch, FARTHEST_BEARING * float(self.options["offset"]))

    @cached_property
    def pull(self) -> FloatArray:
        """Pull of the coupling G (q_g − q_h) at all ticks, shape (T, 21)."""
        here, there = self.shown, self.wanted
        turn = turn_between(there.orientation, here.orientation)
        bend = (here.flexion - there.flexion).reshape(-1, 15)
        return np.concatenate([here.position - there.position, turn, bend], axis=1) * self.diagonal

    @cached_property
    def bodies(self) -> tuple[JudgedBody, ...]:
        """Object, or parts of a body."""
        found, first, moved = list[JudgedBody](), 0, self.result.meshes_moved() or (None,)
        for body, motion in zip(self.result.bodies.values(), moved, strict=True):
            mesh = Mesh(np.array(body.vertices), np.array(body.faces), name=body.group)
            pieces = Pieces.of_triangles(mesh.triangles) if self.on_mesh else Pieces.of_balls(*leaves(body))
            turn, shift = np.tile(np.eye(3), (len(self.numbers), 1, 1)), np.zeros((len(self.numbers), 3))
            if motion is not None:
                turn, shift = rotations(motion.turn)[0].as_matrix(), motion.shift
            found.append(JudgedBody(mesh, pieces, first, turn, shift))
            first += len(pieces.radius)
        return tuple(found)

    @cached_property
    def moved(self) -> FloatArray:
        """Travel of the farthest joint beside a body since the tick before [m], shape (T,); infinite at the first."""
        seen = [body.seen_points(self.posed.joints, self.numbers) for body in self.bodies]
        ways = [np.linalg.norm(np.diff(joints, axis=0), axis=3).max(axis=(1, 2), initial=0.0) for joints in seen]
        return np.concatenate([[np.inf], np.max(ways, axis=0)])

    @cached_property
    def last_step(self) -> FloatArray:
        """Upper bound of the farthest joint's travel in the last step of a settled tick [m], shape (T,)."""
        return np.minimum(self.moved, float(self.options["step_tolerance"]))

    @cached_property
    def _least_leaf(self) -> float:
        # Rolling on an edge or a corner of a mesh has the hand's radius alone.
        return 0.0 if self.on_mesh else float(min(body.pieces.radius.min() for body in self.bodies))

    @property
    def rolling(self) -> float:
        """Least radius at which hand and object roll on each other [m]."""
        return self._least_leaf + float(min(self.hand.radius.min(), self.hand.palm_radius.min()))

    @cached_property
    def bearing_within(self) -> FloatArray:
        """Largest distance of a pair that bears a force in a settled tick [m], of each body, shape (T, 16).

        The last program keeps contacts `offset` away to first order; the second order is half the step's square over
        the radius of a body on an edge, and up to as much again for turning joints and palm.
        """
        phalanges = np.minimum(self.hand.radius[:, :-1], self.hand.radius[:, 1:]).ravel()
        rolling = self._least_leaf + np.append(phalanges, self.hand.palm_radius.min())
        settled = float(self.options["offset"]) + self.last_step[:, None] ** 2 / rolling
        return np.clip(settled, self.touch, self.bearing)

    @cached_property
    def meetings(self) -> Pairs:
        """Pairs of the hand's own parts that touch, or nearly so; none without self-contact."""
        may = parts_that_may_meet(self.hand, self.fingers & self.self_contact)
        return meetings(self.hand, self.posed, may, 2.0 * self.bearing)

    def of_other_hand(self, near: float) -> Pairs:
        """Pairs with the other hand's bodies that are within `near` [m]; none where it is not seen."""
        if self.other is None:
            return self.pairs.at(np.zeros(0, np.int64))
        theirs = own_hand(self.other), pose(own_hand(self.other), configurations(self.other, "graphic"))
        return meetings_of_two((self.hand, theirs[0]), (self.posed, theirs[1]), near)

    @cached_property
    def against_other_hand(self) -> Pairs:
        """Pairs with the other hand that touch, or nearly so."""
        return self.of_other_hand(2.0 * self.bearing)

    @property
    def squeezed(self) -> BoolArray:
        """Ticks that say that moving parts left the hand no place."""
        return np.asarray(self.status & NO_PLACE > 0)

    @cached_property
    def _near(self) -> tuple[Pairs, FloatArray]:
        """Pairs that touch, or nearly so, and least distances (T, 16); distant pairs are measured, and not kept."""
        reach = max(2.0 * self.bearing, self.margin if self.result.body.is_free else 0.0)
        kept, nearest = list[Pairs](), list[FloatArray]()
        for rows in np.array_split(self.numbers, range(BLOCK, len(self.numbers), BLOCK)):
            of_bodies = list[Pairs]()
            for body in self.bodies:
                seen = near_pairs(self.hand, body.seen(self.posed, rows), body.pieces, self.fingers, reach)
                of_bodies.append(body.placed(seen, rows))
            found = joined(of_bodies)
            pairs = found.within(2.0 * self.bearing)
            kept.append(pairs._replace(tick=rows[pairs.tick]))
            nearest.append(found.nearest(len(rows)))
        return joined(kept), np.concatenate(nearest)

    @property
    def pairs(self) -> Pairs:
        """Pairs that touch, or nearly so."""
        return self._near[0]

    @property
    def nearest(self) -> FloatArray:
        """Least distance of each body [m], infinite for none near, shape (T, 16)."""
        return self._near[1]

    @cached_property
    def forces(self) -> FloatArray:
        """Force of each body [N], the palm's last, shape (T, 16, 3)."""
        phalanx = np.asarray(self.result["force/phalanx"]).reshape(len(self.numbers), -1, 3)
        palm = np.asarray(self.result["force/total"]) - phalanx.sum(axis=1)
        return np.concatenate([phalanx, palm[:, None]], axis=1)
