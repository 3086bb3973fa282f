"""An object that is free: a rigid body with mass, friction and gravity, on a table or on none."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hhsim.errors import InputError
from hhsim.mesh.mass_properties import mass_properties
from hhsim.mesh.mesh import Mesh
from hhsim.ranges import check_range

Triple = tuple[float, float, float]
GRAVITY: Triple = (0.0, 0.0, -9.81)
"""[m/s²], world."""
CLEARANCE = 5e-7
"""How far below an object a table right under it is [m]: as far as contacts keep off, so that it rests at once."""
USUAL_FRICTION = 0.6
"""Skin on aluminium (Seo et al. 2009)."""
LAW = "Coulomb with de Saxcé's correction, cone of 4 directions turned to the load; impacts inelastic; implicit Euler"
"""What is solved, for results to say."""


@dataclass(frozen=True)
class FreeObject:
    """What a free object is besides its surface.

    Attributes:
        mass: [kg].
        center: Centre of mass [m], in the frame of the scene's mesh, which is the world's at the first tick.
        inertia: About the centre [kg·m²], in the same axes, row by row.
        friction: μ of hand and object.
        torsion: Torsional moment that a contact with the hand can bear, over its normal force [m]; 0: none.
        table: Height z of a horizontal plane that the object rests on [m], world; None: there is none.
        table_friction: μ of table and object; as `friction` unless told.
        gravity: [m/s²], world.
        damping: Rate at which both velocities die out by themselves [1/s].
        velocity: Of the centre at the start [m/s], world.
        angular_velocity: At the start [rad/s], world.

    Raises:
        InputError: A number out of its range (`hhsim.ranges`), or an inertia that no body has.
    """

    mass: float
    center: Triple
    inertia: tuple[Triple, Triple, Triple]
    friction: float = USUAL_FRICTION
    torsion: float = 0.0
    table: float | None = None
    table_friction: float | None = None
    gravity: Triple = GRAVITY
    damping: float = 0.0
    velocity: Triple = (0.0, 0.0, 0.0)
    angular_velocity: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Raise InputError for numbers out of their ranges, and for an inertia that is not positive definite."""
        for name in ("mass", "friction", "torsion", "damping"):
            check_range(name, getattr(self, name))
        for name in ("table", "table_friction"):
            if getattr(self, name) is not None:
                check_range(name, getattr(self, name))
        for name in ("gravity", "velocity", "angular_velocity"):
            for component in getattr(self, name):
                check_range(name, component)
        if not (np.isfinite(self.center).all() and np.isfinite(self.inertia).all()):
            raise InputError("the centre or the inertia of the free object is not finite")
        inertia = np.array(self.inertia)
        if not np.allclose(inertia, inertia.T, rtol=1e-9, atol=0.0 if inertia.any() else 1.0):
            raise InputError("the inertia of the free object is not symmetric")
        if np.linalg.eigvalsh(inertia)[0] <= 0.0:
            raise InputError("the inertia of the free object is not positive: is its mesh flat?")

    @classmethod
    def of_mesh(cls, mesh: Mesh, *, mass: float | None = None, density: float = 1000.0, **others: Any) -> Self:
        """A solid of one density.

        Args:
            mesh: Its surface [m], closed.
            mass: [kg]; by the density where it is None.
            density: [kg/m³].
            others: The other attributes.

        Raises:
            MeshError: The mesh encloses nothing.
            InputError: As the class.
        """
        check_range("density", density)
        solid = mass_properties(mesh)
        mass = density * solid.volume if mass is None else mass
        inertia = mass / solid.volume * solid.inertia
        return cls(mass, _triple(solid.center), _rows(0.5 * (inertia + inertia.T)), **others)

    @property
    def of_table(self) -> float:
        """μ of table and object."""
        return self.friction if self.table_friction is None else self.table_friction

    def to_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """What `to_json` made.

        Raises:
            InputError: Values that are none of a free object.
        """
        try:
            rows = {name: _triple(value) for name, value in values.items() if name in _VECTORS}
            return cls(**{**values, **rows, "inertia": _rows(values["inertia"])})
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the free object cannot be read: {error}") from error


_VECTORS = ("center", "gravity", "velocity", "angular_velocity")


def _triple(values: ArrayLike) -> Triple:
    x, y, z = (float(value) for value in np.asarray(values, np.float64))
    return (x, y, z)


def _rows(values: ArrayLike) -> tuple[Triple, Triple, Triple]:
    a, b, c = np.asarray(values, np.float64)
    return (_triple(a), _triple(b), _triple(c))
