"""A free body as its engine takes it: mass, friction, gravity, a joint, and the table."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.ranges import check_range
from hhsim.scene.body import USUAL_FRICTION, Free, Joint
from hhsim.system.settings_file import typed

if TYPE_CHECKING:
    from hhsim.motion.trajectory import RigidMotion
    from hhsim.solver.options import SolverOptions
    from hhsim.trees.contact_surface import ContactSurface

LAW = "Coulomb with de Saxcé's correction, cone of 4 directions turned to the load; impacts inelastic; implicit Euler"
"""Contact law, as results state it."""


JOINT_BOUNDS = {"hinge": (np.pi, "π"), "slider": (100.0, "100")}
"""Bound of a joint's limits from the start [rad] or [m], as a number and as text."""


@dataclass(frozen=True)
class FreeObject(Free):
    """Free body as its engine takes it, over a table; InputError for a number out of its range."""

    friction: float = USUAL_FRICTION  # μ of hand and object
    torsion: float = 0.0  # largest torsional moment of a contact with the hand over its normal force [m]; 0: none
    table: float | None = None  # height z of a horizontal plane under the object [m], world; None: there is none
    table_friction: float | None = None  # μ of table and object; None: as `friction`
    joint: Joint | None = None  # its value is 0 at the start; without one it moves in all directions
    name: str = ""  # by which joints of other bodies are on it

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("friction", "torsion", "table", "table_friction"):
            if getattr(self, name) is not None or not name.startswith("table"):
                check_range(name, getattr(self, name))
        if self.joint is not None and self.joint.limits is not None:
            (least, most), (bound, text) = self.joint.limits, JOINT_BOUNDS[self.joint.type]
            if not -bound <= least <= most <= bound:
                given = f"{self.joint.type} limits {least:g} to {most:g} {self.joint.unit}"
                raise InputError(f"{given}; expected values from the start within ±{text}")

    def to_json(self) -> dict[str, Any]:
        """Return all fields as plain values; a joint, as `hinge` or `slider`, and a name only where there is one."""
        plain = {name: value for name, value in asdict(self).items() if name != "joint" and (value or name != "name")}
        if (joint := self.joint) is None:
            return plain
        origin = {"origin": joint.origin} if joint.type == "hinge" else {}
        own = {"limits": joint.limits, "friction": joint.friction, "on": joint.on}
        return plain | {joint.type: {"axis": joint.axis, **origin, **own}}

    @property
    def motion(self) -> Free:
        """Motion of a body of a scene."""
        return Free(**{each.name: getattr(self, each.name) for each in fields(Free)})

    @property
    def pivot(self) -> FloatArray:
        """Centre of mass, or the point of the hinge's axis nearest to it [m], world at the start, shape (3,)."""
        center = np.array(self.center)
        if self.joint is None or self.joint.type == "slider":
            return center
        axis, origin = self.joint.direction, np.array(self.joint.origin)
        pivot: FloatArray = origin + ((center - origin) * axis).sum() * axis
        return pivot

    @property
    def of_table(self) -> float:
        """μ of table and object."""
        return self.friction if self.table_friction is None else self.table_friction

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Return what `to_json` stored; InputError for values that describe no free object."""
        plain = dict(values)
        joints = [{"type": kind, **plain.pop(kind)} for kind in JOINT_BOUNDS if isinstance(plain.get(kind), Mapping)]
        if len(joints) > 1:
            raise InputError("the free object has a hinge and a slider; expected one of them")
        return typed(plain | ({"joint": joints[0]} if joints else {}), cls, "free object")


class EngineBody(NamedTuple):
    """Object of a scene of several: surface, in the world at first, and properties.

    Of a fixed one, and of a driven one, which goes by its motion since the first tick, only friction counts.
    """

    surface: "ContactSurface"
    free: FreeObject
    fixed: bool = False
    name: str = ""
    motion: "RigidMotion | None" = None

    @property
    def moves_freely(self) -> bool:
        """True unless it is fixed or driven."""
        return not self.fixed and self.motion is None


def require_free(options: "SolverOptions") -> None:
    """Raise an InputError unless a free object can be solved with these options."""
    qp = options.qp
    for wrong, message in (
        (options.method != "coupled", f"method {options.method} has no free objects: coupled has"),
        (qp != "active-set", f"a free object is solved for by hhsim's own QP solver, not {qp}: use active-set"),
        (options.force != "kkt", "with a free object the forces are the program's own: use the force model kkt"),
    ):
        if wrong:
            raise InputError(message)
