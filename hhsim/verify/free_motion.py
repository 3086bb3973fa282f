"""Stored motion of the bodies of a scene with a free one, and the contacts of the first, as the referee reads them."""

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.result.body import ON_TABLE, Body
from hhsim.result.reader import Result
from hhsim.result.schema import BETWEEN_COLUMNS
from hhsim.verify.contacts import PALM
from hhsim.verify.file_checks import follows
from hhsim.verify.kinematics import rotations
from hhsim.verify.tick_data import LAG, STUCK, left_out

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MEETS = 1e-4
"""Distance of two hands within which they may bear on each other [m]."""
AT_REST = 1e-11
"""Way in a tick [m] below which a body that rested in the tick before is not moved on."""


class FreeBody:
    """Stored motion of a body of a scene with a free one, and what follows from the poses alone, world."""

    def __init__(self, result: Result, body: Body) -> None:
        free = body.properties
        self.result, self.stored, self.free, self.name = result, body, free, body.name
        self.fixed, self.driven = body.kind == "fixed", body.kind == "driven"
        self.period = 1.0 / result.rate
        self.mass, self.inertia = float(free["mass"]), np.array(free["inertia"], np.float64)
        self.gravity, self.damping = np.array(free["gravity"]), float(free["damping"])
        self.ticks = np.arange(result.ticks)
        # The first tick follows the scene's start; after a recorder's gap the tick before is unknown.
        self.follows = follows(result)
        self.follows[0] = result.live is None or result["live/tick/record"][0] == 0
        # Hands and body have one program: flags of both hands, and ticks in which it was solved more than once.
        hands = [result, *([] if result.other is None else [result.other])]
        self.status = np.bitwise_or.reduce([np.asarray(hand["status"]) for hand in hands])
        self.several = np.max([np.asarray(hand["work/linearisations"]) for hand in hands], axis=0) > 1
        self.place, self.orientation = body.place
        self.vertices = np.asarray(body.vertices)
        # Velocity of the centre of mass [m/s] and angular velocity [rad/s], from before the first tick on, (T + 1, 3).
        self.velocity, self.spin = (np.vstack([free[of], self.of(of)]) for of in ("velocity", "angular_velocity"))
        # Wrench about the centre of mass [N, N·m], (T, 6): of what is no hand, and of all.
        others = [self.of(f"{source}_wrench") for source in ("table", "body") if f"{source}_wrench" in body]
        self.of_others = np.sum(others, axis=0)
        self.borne = self.of("hand_wrench") + self.of_others

    @property
    def joint(self) -> Mapping[str, Any] | None:
        """Its hinge or slider; None without one, or of a fixed body."""
        return None if self.fixed else self.free.get("hinge") or self.free.get("slider")

    def of(self, column: str) -> FloatArray:
        """Dataset of the body."""
        return np.asarray(self.stored[column])

    @cached_property
    def turned(self) -> "Rotation":
        """Rotations of the object from its place before the first tick, T + 1 of them."""
        poses, _ = rotations(np.vstack([self.orientation, self.of("orientation")]))
        return poses * poses[0].inv()

    @cached_property
    def center(self) -> FloatArray:
        """Centre of mass before the first tick and at every tick [m], shape (T + 1, 3)."""
        return self.moved(np.array(self.free["center"]))

    def moved(self, point: FloatArray) -> FloatArray:
        """Point of the object [m], (3,) before the first tick, there and at every tick, shape (T + 1, 3)."""
        return np.asarray(np.vstack([self.place, self.of("position")]) + self.turned.apply(point - self.place))

    @cached_property
    def turn(self) -> FloatArray:
        """Rotation vectors from tick to tick [rad], shape (T, 3)."""
        return np.asarray((self.turned[1:] * self.turned[:-1].inv()).as_rotvec())

    @property
    def extent(self) -> float:
        """Largest extent of its mesh along an axis [m]."""
        return float(np.ptp(self.vertices, axis=0).max())

    @property
    def travel(self) -> FloatArray:
        """Bound on the travel of its farthest points from tick to tick [m], shape (T,)."""
        way = np.linalg.norm(np.diff(self.center, axis=0), axis=1)
        return np.asarray(way + self.extent * np.linalg.norm(self.turn, axis=1))

    @property
    def turned_in_programs(self) -> FloatArray:
        """Bound on the turn between a tick's ends and where its last program began [rad], shape (T,).

        The only program of a tick begins where the tick does. The last of several begins between its ends or, since it
        may take back what others made, beyond them by its own step, which ends a tick.
        """
        step = float(self.result.scene["solver"]["step_tolerance"]) / self.extent
        return np.where(self.several, np.linalg.norm(self.turn, axis=1) + step, 0.0)

    @cached_property
    def whole(self) -> IntArray:
        """Ticks that neither lag nor are stuck; in others the object makes only a fraction of its program's step."""
        return np.asarray(np.flatnonzero(self.status & (LAG | STUCK) == 0))

    @property
    def left_out(self) -> str:
        """The other ticks in words."""
        return left_out(self.status, LAG | STUCK)

    @property
    def size(self) -> FloatArray:
        """Sizes of weight and forces added up, which rounding goes with, and 1 N, shape (T,)."""
        weight = self.mass * float(np.linalg.norm(self.gravity))
        return np.asarray(1.0 + weight + np.abs(self.borne[:, :3]).sum(axis=1))

    @property
    def left_at_rest(self) -> FloatArray:
        """Force that a body at rest may leave unbalanced [N], shape (T,): that of a way too small to be made."""
        radius = np.sqrt(np.linalg.eigvalsh(self.inertia)[0] / self.mass)
        way = np.linalg.norm(self.velocity[:-1], axis=1) + radius * np.linalg.norm(self.spin[:-1], axis=1)
        return np.where(way * self.period <= AT_REST, self.mass * AT_REST / self.period**2, 0.0)

    @cached_property
    def lowest(self) -> FloatArray:
        """Height of the lowest point at every tick [m], shape (T,)."""
        corners = self.vertices - np.array(self.free["center"])
        return np.asarray(self.center[1:, 2] + (corners @ self.turned[1:].as_matrix()[:, 2].T).min(axis=0))

    def unbalanced(self, force: FloatArray) -> FloatArray:
        """Residual of Newton's equation [N], shape (T,), for the forces (T, 3); a fixed body has no velocity."""
        velocity, heavier = self.velocity, 1.0 + self.damping * self.period
        if self.fixed:
            return np.asarray(self.mass / self.period * np.linalg.norm(velocity[1:], axis=1))
        off = heavier * velocity[1:] - velocity[:-1] - self.period * (force / self.mass + self.gravity)
        return np.asarray(self.mass / self.period * np.linalg.norm(off, axis=1))


class FreeMotion(FreeBody):
    """Motion of a free object, and its contacts."""

    def __init__(self, result: Result) -> None:
        super().__init__(result, result.body)
        # Invalid ticks and bodies are found by `_contacts`.
        contacts = result.contacts
        self.tick: IntArray = np.clip(contacts["tick"], 0, result.ticks - 1)
        self.touching: IntArray = np.asarray(contacts["body"], np.int64)
        self.point, self.normal, self.load, self.friction, self.torsion, self.slip = (
            np.asarray(contacts[name])
            for name in ("point", "normal", "normal_force", "friction_force", "torsional_moment", "slip")
        )
        # Other bodies count as the table does; their own motion is not in the slip that is computed here.
        self.of_table, of_body = self.touching <= ON_TABLE, self.touching < ON_TABLE
        # Contacts of another hand, whose poses are in its own result.
        self.of_other = (self.touching > PALM) | of_body
        self.own = ~(self.of_table | self.of_other)

    @cached_property
    def meets_hand(self) -> BoolArray:
        """True for ticks in which the hand may bear on another one, shape (T,)."""
        if self.result.other is None:
            return np.zeros(len(self.ticks), bool)
        # The forces of a tick that lags are of its last program, from where hands may still have come apart.
        left = sum(np.asarray(hand["lag"])[self.ticks] for hand in (self.result, self.result.other))
        return np.asarray(np.asarray(self.result[BETWEEN_COLUMNS[1].name])[self.ticks] <= MEETS + left)

    @cached_property
    def alone(self) -> BoolArray:
        """True for ticks in which no hand bears on what has no contacts in the file, shape (T,): bodies, other hand."""
        found = ~self.meets_hand
        for body in list(self.result.bodies.values())[1:]:
            found &= ~np.asarray(body["hand_wrench"]).any(axis=1)
        return found

    @cached_property
    def force(self) -> FloatArray:
        """Force of each contact on the body it acts on [N], shape (C, 3)."""
        return np.asarray(self.load[:, None] * self.normal + self.friction)

    @property
    def coefficient(self) -> FloatArray:
        """Friction coefficient μ of each contact, shape (C,): of two bodies the geometric mean of theirs."""
        table, *others = (
            one["friction"] if one["table_friction"] is None else one["table_friction"]
            for one in (body.properties for body in self.result.bodies.values())
        )
        # A body of number k has the code -2 - k, and the first one does not touch itself.
        known = np.array([table, table, *(np.sqrt(table * other) for other in others)])
        of_body = known[np.clip(-1 - self.touching, 0, len(known) - 1)]
        return np.asarray(np.where(self.touching >= 0, self.free["friction"], of_body))
