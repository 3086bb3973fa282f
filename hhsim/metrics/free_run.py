"""Motion, forces and contacts of a free object in a run."""

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
"""Body of a contact with the table; -2 and below are those with other things."""
PALM = 15
SLIPS = 1e-6
"""Smallest travel of a slipping contact in a tick [m]: 1 mm/s."""
RAISED = 0.9
"""Smallest share of the hand's rise in which the object counts as raised."""


class Datasets(Protocol):
    """Datasets of /tick and of /contact by name."""

    def __getitem__(self, name: str, /) -> AnyArray:
        """Return the dataset."""


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Free object of a run, world frame."""

    datasets: Datasets  # datasets of the result, world
    properties: Mapping[str, Any]  # `FreeObject.to_json` of `hhsim.scene.free_object`
    corners: AnyArray  # corners of the box around the object before the first tick [m], shape (8, 3)
    first: ObjectMotion  # pose of the object then, shapes (3,) and (4,)
    stiffness: AnyArray  # diagonal of G, the hand's springs, shape (21,)
    offset: float  # clearance that contacts keep [m]

    def __getitem__(self, name: str) -> AnyArray:
        return self.datasets[name]

    @cached_property
    def moved(self) -> RigidMotion:
        """Motion of the object from before the first tick to each tick."""
        return ObjectMotion(self["object/position"], self["object/orientation"]).since(*self.first)

    @cached_property
    def center(self) -> AnyArray:
        """Centre of mass at the ticks [m], shape (T, 3)."""
        ticks = len(self["object/position"])
        center = np.tile(np.array(self.properties["center"], np.float64), (ticks, 1))
        return self.moved.points(center)

    @property
    def weight(self) -> float:
        """Weight M g [N]."""
        return float(self.properties["mass"] * np.linalg.norm(self.properties["gravity"]))

    @cached_property
    def of_hand(self) -> NDArray[np.bool_]:
        """True for contacts of this hand, not of the table or another hand, shape (C,)."""
        body = self["contact/body"]
        return np.asarray((body > ON_TABLE) & (body <= PALM))

    @cached_property
    def friction(self) -> AnyArray:
        """Friction coefficient μ of each contact, shape (C,)."""
        of_hand, table = self.properties["friction"], self.properties["table_friction"]
        return np.asarray(np.where(self["contact/body"] <= ON_TABLE, of_hand if table is None else table, of_hand))

    @property
    def raised(self) -> float:
        """Largest rise of the centre above its place at the first tick [m]."""
        height = self.center[:, 2]
        return float((height - height[0]).max())

    @cached_property
    def friction_share(self) -> AnyArray:
        """Largest share of its friction limit that a contact of the hand uses at each tick; shape (T,).

        Torsion counts as one more direction of friction; 0 without force, infinite where the limit is 0.
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
        """Largest displacement of a corner of the object's box between two ticks [m]."""
        ends = RigidMotion(*(values[[first, last]] for values in self.moved))
        there = ends.points(np.broadcast_to(self.corners, (2, 8, 3)))
        return float(np.linalg.norm(there[1] - there[0], axis=1).max())

    def first_to_slip(self, part: slice) -> str:
        """Body of the hand whose contact slips first in some ticks, with the tick, in words; "" for none."""
        tick = self["contact/tick"]
        slips = self.of_hand & (self["contact/slip"] > SLIPS) & (tick >= part.start) & (tick < part.stop)
        at = np.flatnonzero(slips)
        if at.size == 0:
            return ""
        at = at[tick[at] == tick[at[0]]]
        worst = int(at[self["contact/slip"][at].argmax()])
        return f"{body_name(int(self['contact/body'][worst]))} at tick {int(tick[worst]):,}"

    def left_behind(self, phases: "tuple[TickPhase, ...] | list[TickPhase]", palm: AnyArray) -> str:
        """Reason why the object did not come along in the first lift; "" where it did, or nothing was lifted.

        `palm` is the user's palm at the ticks [m], shape (T, 3).
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
    """Name of a body of the hand."""
    return "palm" if body == PALM else f"{FINGERS[body // 3]}'s {('first', 'second', 'last')[body % 3]} phalanx"


def result_free_run(result: Result) -> FreeRun | None:
    """Build the free object of a result; None where it has none."""
    if not result.free:
        return None
    mesh = Mesh(result.static["object/vertices"], result.static["object/faces"])
    first = ObjectMotion(result.static["object/position"], result.static["object/orientation"])
    solver = result.scene["solver"]
    springs = [solver["stiffness"][name] for name in ("translation", "rotation", "flexion")]
    stiffness = np.repeat(np.array(springs, np.float64), (3, 3, 15))
    return FreeRun(result, result.scene["free"], mesh.box_corners, first, stiffness, solver["offset"])
