"""What became of a free object in a run: its motion, the forces on it, and the contacts that bore them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import AnyArray
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.mesh import Mesh
from hhsim.motion.object_motion import ObjectMotion, RigidMotion
from hhsim.motion.trajectory import TickPhase
from hhsim.result.reader import Result

ON_TABLE = -1
"""Stands for the table where contacts name a body of the hand."""
PALM = 15
SLIPS = 1e-6
"""A contact that goes further than this in a tick [m] slips: 1 mm/s."""
RAISED = 0.9
"""A hand that goes up takes an object along that comes at least this share of the way."""


class Datasets(Protocol):
    """Datasets of a result by name, those of /tick and of /contact."""

    def __getitem__(self, name: str, /) -> AnyArray:
        """The dataset, world."""


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A run's free object, world frame.

    Attributes:
        datasets: Of the result.
        properties: `FreeObject.to_json` of `hhsim.scene.free_object`.
        corners: Of the box around the object before the first tick [m], shape (8, 3).
        first: Its pose then, shapes (3,) and (4,).
        stiffness: Of the hand's springs, diagonal of G, shape (21,).
        offset: Clearance that contacts keep [m].
    """

    datasets: Datasets
    properties: Mapping[str, Any]
    corners: AnyArray
    first: ObjectMotion
    stiffness: AnyArray
    offset: float

    def __getitem__(self, name: str) -> AnyArray:
        return self.datasets[name]

    @cached_property
    def moved(self) -> RigidMotion:
        """From where the object was before the first tick to where it is at the ticks."""
        poses = ObjectMotion(self["object/position"], self["object/orientation"])
        return poses.since(*self.first)

    @cached_property
    def center(self) -> AnyArray:
        """Centre of mass at the ticks [m], shape (T, 3)."""
        ticks = len(self["object/position"])
        center = np.tile(np.array(self.properties["center"], np.float64), (ticks, 1))
        return self.moved.points(center)

    @property
    def weight(self) -> float:
        """M g [N]."""
        return float(self.properties["mass"] * np.linalg.norm(self.properties["gravity"]))

    @cached_property
    def of_hand(self) -> NDArray[np.bool_]:
        """Which contacts are of the hand, and not of the table, shape (C,)."""
        return np.asarray(self["contact/body"] != ON_TABLE)

    @cached_property
    def friction(self) -> AnyArray:
        """μ of each contact, shape (C,)."""
        of_hand = self.properties["friction"]
        table = self.properties["table_friction"]
        return np.asarray(np.where(self.of_hand, of_hand, of_hand if table is None else table))

    @property
    def raised(self) -> float:
        """How far the centre comes above where it is at the first tick [m]."""
        height = self.center[:, 2]
        return float((height - height[0]).max())

    @cached_property
    def friction_share(self) -> AnyArray:
        """The most that a contact of the hand rubs at each tick, as a share of what it can bear; shape (T,).

        With torsion as one more direction of friction; 0 where nothing is borne, infinite where friction has no room.
        """
        rub = np.linalg.norm(self["contact/friction_force"], axis=1)[self.of_hand]
        normal, tick = self["contact/normal_force"][self.of_hand], self["contact/tick"][self.of_hand]
        twist = np.abs(self["contact/torsional_moment"][self.of_hand])
        limit, torsion = self.friction[self.of_hand], float(self.properties["torsion"])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.nan_to_num(rub / (limit * normal), posinf=np.inf)
            if torsion > 0.0:
                share = np.hypot(share, np.nan_to_num(twist / (torsion * normal), posinf=np.inf))
        most = np.zeros(len(self["object/position"]))
        np.maximum.at(most, tick, share)
        return most

    def displacement(self, first: int, last: int) -> float:
        """The farthest that a corner of the object's box is at one tick from where it is at another [m]."""
        ends = RigidMotion(*(values[[first, last]] for values in self.moved))
        there = ends.points(np.broadcast_to(self.corners, (2, 8, 3)))
        return float(np.linalg.norm(there[1] - there[0], axis=1).max())

    def first_to_slip(self, part: slice) -> str:
        """The part of the hand whose contact slips first in some ticks, with the tick; "" where none does."""
        tick = self["contact/tick"]
        slips = self.of_hand & (self["contact/slip"] > SLIPS) & (tick >= part.start) & (tick < part.stop)
        at = np.flatnonzero(slips)
        if at.size == 0:
            return ""
        at = at[tick[at] == tick[at[0]]]
        worst = int(at[self["contact/slip"][at].argmax()])
        return f"{body_name(int(self['contact/body'][worst]))} at tick {int(tick[worst]):,}"

    def left_behind(self, phases: "tuple[TickPhase, ...] | list[TickPhase]", palm: AnyArray) -> str:
        """Why the object did not come along in the first lift; "" where it did, or where nothing was lifted.

        Args:
            phases: Of the motion.
            palm: Where the user's palm is at the ticks [m], shape (T, 3).
        """
        for phase in phases:
            part = slice(phase.first_tick, min(phase.last_tick + 1, len(palm)))
            if phase.name != "lift" or part.start >= len(palm):
                continue
            last = part.stop - 1
            wanted, came = (float(values[last, 2] - values[part.start, 2]) for values in (palm, self.center))
            if wanted <= 0.0 or came >= RAISED * wanted:
                return ""
            first = self.first_to_slip(part)
            why = f"the first contact to slip is of the {first}" if first else "no contact of the hand slips in it"
            return f"in the lift the object comes {1e3 * came:.1f} mm of {1e3 * wanted:.1f} mm: {why}"
        return ""


def body_name(body: int) -> str:
    """What people call a body of the hand."""
    return "palm" if body == PALM else f"{FINGERS[body // 3]}'s {('first', 'second', 'last')[body % 3]} phalanx"


def result_free_run(result: Result) -> FreeRun | None:
    """The free object of a result; None where it has none."""
    if not result.free:
        return None
    mesh = Mesh(result.static["object/vertices"], result.static["object/faces"])
    first = ObjectMotion(result.static["object/position"], result.static["object/orientation"])
    solver = result.scene["solver"]
    springs = [solver["stiffness"][name] for name in ("translation", "rotation", "flexion")]
    stiffness = np.repeat(np.array(springs, np.float64), (3, 3, 15))
    return FreeRun(result, result.scene["free"], mesh.box_corners, first, stiffness, solver["offset"])
