"""A free body as its engine takes it: mass, friction, gravity, a joint, and the table."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.ranges import check_range
from hhsim.reproducible import norm
from hhsim.scene.body import USUAL_FRICTION, Free, Joint, JointType, Triple
from hhsim.system.settings_file import typed

if TYPE_CHECKING:
    from hhsim.motion.trajectory import RigidMotion
    from hhsim.solver.options import SolverOptions
    from hhsim.trees.contact_surface import ContactSurface

LAW = "Coulomb with de Saxcé's correction, cone of 4 directions turned to the load; impacts inelastic; implicit Euler"
"""Contact law, as results state it."""


class _Joint:
    """Joint with an axis and limits, a hinge or a slider; InputError for an axis of length 0, or limits without 0."""

    KIND: ClassVar[JointType]
    VALUES: ClassVar[tuple[str, float, str, str]]  # what they are, their unit, and their bound as number and as text

    axis: Triple
    limits: tuple[float, float] | None
    friction: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.axis).all() and norm(np.array(self.axis)) > 1e-9):
            raise InputError(f"the axis of the {self.KIND} has no direction; expected one such as [0.0, 1.0, 0.0]")
        check_range(f"{self.KIND}_friction", self.friction)
        least, most = self.limits or (0.0, 0.0)
        values, bound, unit, text = self.VALUES
        if not -bound <= least <= 0.0 <= most <= bound:
            expected = f"expected {values} from the start, with 0, within ±{text}"
            raise InputError(f"{self.KIND} limits {least:g} to {most:g} {unit}; {expected}")

    @property
    def direction(self) -> FloatArray:
        """Unit vector along the axis, world, shape (3,)."""
        axis = np.array(self.axis)
        return np.asarray(axis / norm(axis))


@dataclass(frozen=True)
class Hinge(_Joint):
    """Hinge of a free object, in the world or on another body, about which alone it turns."""

    KIND: ClassVar[JointType] = "hinge"
    VALUES = ("angles", np.pi, "rad", "π")

    axis: Triple  # direction, of any length, world
    origin: Triple  # a point of the axis [m], world
    limits: tuple[float, float] | None = None  # least and greatest angle from the first tick on [rad], within ±π
    friction: float = 0.0  # largest moment of its dry friction [N·m]
    on: str = ""  # name of the body that bears it, which the object goes through; "": the world

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.origin).all():
            raise InputError("the origin of the hinge is not finite; expected a point of its axis")


@dataclass(frozen=True)
class Slider(_Joint):
    """Slider of a free object, in the world or on another body, along which alone it moves."""

    KIND: ClassVar[JointType] = "slider"
    VALUES = ("ways", 100.0, "m", "100")

    axis: Triple  # direction, of any length, world
    limits: tuple[float, float] | None = None  # least and greatest way from the first tick on [m]
    friction: float = 0.0  # largest force of its dry friction [N]
    on: str = ""  # as of a hinge


@dataclass(frozen=True)
class FreeObject(Free):
    """Free body as its engine takes it, over a table; InputError for a number out of its range, or two joints."""

    friction: float = USUAL_FRICTION  # μ of hand and object
    torsion: float = 0.0  # largest torsional moment of a contact with the hand over its normal force [m]; 0: none
    table: float | None = None  # height z of a horizontal plane under the object [m], world; None: there is none
    table_friction: float | None = None  # μ of table and object; None: as `friction`
    hinge: Hinge | None = None  # without a hinge or a slider it moves in all directions
    slider: Slider | None = None
    name: str = ""  # by which joints of other bodies are on it

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("friction", "torsion", "table", "table_friction"):
            if getattr(self, name) is not None or not name.startswith("table"):
                check_range(name, getattr(self, name))
        if self.hinge and self.slider:
            raise InputError("the free object has a hinge and a slider; expected one of them")

    def to_json(self) -> dict[str, Any]:
        """Return all fields as plain values; a joint and a name only where there is one."""
        return {name: value for name, value in asdict(self).items() if value or name not in ("hinge", "slider", "name")}

    @property
    def joint(self) -> Hinge | Slider | None:
        """Its hinge or slider."""
        return self.hinge or self.slider

    @property
    def motion(self) -> Free:
        """Motion of a body of a scene."""
        return Free(**{each.name: getattr(self, each.name) for each in fields(Free)})

    def stated_joint(self) -> Joint | None:
        """Return its joint as that of a body of a scene, at the value 0."""
        if (own := self.joint) is None:
            return None
        return Joint(own.KIND, own.axis, getattr(own, "origin", (0.0, 0.0, 0.0)), own.limits, own.friction, own.on)

    @property
    def pivot(self) -> FloatArray:
        """Centre of mass, or the point of the hinge's axis nearest to it [m], world at the start, shape (3,)."""
        center = np.array(self.center)
        if self.hinge is None:
            return center
        axis, origin = self.hinge.direction, np.array(self.hinge.origin)
        pivot: FloatArray = origin + ((center - origin) * axis).sum() * axis
        return pivot

    @property
    def of_table(self) -> float:
        """μ of table and object."""
        return self.friction if self.table_friction is None else self.table_friction

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Return what `to_json` stored; InputError for values that describe no free object."""
        return typed(values, cls, "free object")


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
