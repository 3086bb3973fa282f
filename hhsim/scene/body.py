"""Bodies of a scene: their surfaces and places, how each moves, and the joints that they hang on.

Poses, axes and points are in the world [m]: those of a body that moves are of the first tick. Its mesh and its tree
alone are in the frame of the body, which `position` and `orientation` place in the world.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import SIDES
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh, mass_properties
from hhsim.motion.trajectory import ObjectMotion
from hhsim.ranges import check_range
from hhsim.reproducible import norm, principal_axes
from hhsim.trees.sphere_tree import SphereTree

Triple: TypeAlias = tuple[float, float, float]
JointType: TypeAlias = Literal["hinge", "slider"]
GRAVITY: Triple = (0.0, 0.0, -9.81)
"""[m/s²], world."""
USUAL_FRICTION = 0.6
"""Skin on aluminium (Seo et al. 2009)."""
LEAST_LENGTH = 1e-9
"""A direction or a quaternion that is shorter has none: rounding would choose it."""
CLEARANCE = 5e-7
"""Distance [m] between a body and a table right under it: the clearance of contacts, so that it rests at once."""


@dataclass(frozen=True)
class Fixed:
    """Motion of a body that stays where it is."""


@dataclass(frozen=True, eq=False)
class Driven:
    """Motion of a body that goes as recorded, or as a script says."""

    poses: ObjectMotion  # of the body's frame at each tick, world
    values: FloatArray | None = None  # of the joint at each tick [rad] or [m], (T,), where one moves it

    def first(self, count: int) -> "Driven":
        """Return the motion in the first ticks, at most `count`."""
        return Driven(self.poses.at(slice(count)), None if self.values is None else self.values[:count])


@dataclass(frozen=True)
class Free:
    """Motion of a body that forces move; InputError for a number out of its range, or an inertia of no body."""

    mass: float  # [kg]
    center: Triple  # centre of mass at the first tick [m], world
    inertia: tuple[Triple, Triple, Triple]  # about the centre [kg·m²] at the first tick, world axes, row by row
    gravity: Triple = field(default=GRAVITY, kw_only=True)  # [m/s²], world
    damping: float = field(default=0.0, kw_only=True)  # decay rate of both velocities [1/s]
    velocity: Triple = field(default=(0.0, 0.0, 0.0), kw_only=True)  # initial velocity of the centre [m/s], world
    angular_velocity: Triple = field(default=(0.0, 0.0, 0.0), kw_only=True)  # initial [rad/s], world

    def __post_init__(self) -> None:
        for name in ("mass", "damping"):
            check_range(name, getattr(self, name))
        for name in ("gravity", "velocity", "angular_velocity"):
            for value in getattr(self, name):
                check_range(name, value)
        if not (np.isfinite(self.center).all() and np.isfinite(self.inertia).all()):
            raise InputError("the centre or the inertia of the free object is not finite")
        inertia = np.array(self.inertia)
        if not np.allclose(inertia, inertia.T, rtol=1e-9, atol=0.0 if inertia.any() else 1.0):
            raise InputError("the inertia of the free object is not symmetric")
        if principal_axes(inertia)[0][0] <= 0.0:
            raise InputError("the inertia of the free object is not positive: is its mesh flat?")

    @classmethod
    def of_mesh(cls, mesh: Mesh, *, mass: float | None = None, density: float = 1000.0, **others: Any) -> Self:
        """Return the motion of a solid of uniform density [kg/m³], or of a mass [kg]; its mesh is in the world.

        `others` are the other attributes. Raises MeshError for a mesh that encloses nothing, InputError as the class.
        """
        check_range("density", density)
        solid = mass_properties(mesh)
        mass = density * solid.volume if mass is None else mass
        inertia = mass / solid.volume * solid.inertia
        first, second, third = (triple(row) for row in 0.5 * (inertia + inertia.T))
        return cls(mass, triple(solid.center), (first, second, third), **others)


BodyMotion: TypeAlias = Fixed | Driven | Free
"""How a body moves; the motion of a hand is `hhsim.scene.motion_catalogue.Motion`."""


@dataclass(frozen=True)
class Joint:
    """Hinge or slider of a body on the world or on another body; InputError for an axis of length 0, or bad limits."""

    type: JointType
    axis: Triple  # direction, of any length, by the right hand's rule
    origin: Triple = (0.0, 0.0, 0.0)  # a point of the axis [m]; of a slider without meaning
    limits: tuple[float, float] | None = None  # least and greatest value [rad] or [m]; None: there are none
    friction: float = 0.0  # largest moment [N·m] or force [N] of its dry friction
    on: str = ""  # name of the body that bears it and does not stop it; "": the world
    value: float = 0.0  # at the first tick [rad] or [m]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.axis).all() and norm(np.array(self.axis)) > LEAST_LENGTH):
            raise InputError(f"the axis of the {self.type} has no direction; expected one such as [0.0, 1.0, 0.0]")
        if not np.isfinite(self.origin).all():
            raise InputError(f"the origin of the {self.type} is not finite; expected a point of its axis")
        check_range(f"{self.type}_friction", self.friction)
        least, most = self.limits or (self.value, self.value)
        if not least <= self.value <= most:
            raise InputError(
                f"the {self.type} begins at {self.value:g} {self.unit}, beyond its limits; "
                f"expected {least:g} to {most:g} {self.unit}"
            )

    @property
    def direction(self) -> FloatArray:
        """Unit vector along the axis, shape (3,)."""
        axis = np.array(self.axis)
        return np.asarray(axis / norm(axis))

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "rad" if self.type == "hinge" else "m"


@dataclass(frozen=True, eq=False)
class Body:
    """Rigid body with a surface; mesh and tree [m] are in its frame, all else is in the world at the first tick."""

    name: str
    mesh: Mesh
    tree: SphereTree
    position: FloatArray = field(default_factory=lambda: np.zeros(3))  # of its frame [m], (3,)
    orientation: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))  # (w, x, y, z)
    motion: BodyMotion = Fixed()
    joint: Joint | None = None  # without one it stands in the world, or moves in all directions
    friction: float = USUAL_FRICTION  # μ with hands; of two bodies it is the geometric mean of both
    torsion: float = 0.0  # largest torsional moment of a contact over its normal force [m]; 0: none

    def __post_init__(self) -> None:
        for name in ("friction", "torsion"):
            check_range(name, getattr(self, name))

    @cached_property
    def placed_mesh(self) -> Mesh:
        """Mesh at the first tick [m], world."""
        return self.mesh.transformed(rotation_matrix(self.orientation), self.position)

    @cached_property
    def placed_tree(self) -> SphereTree:
        """Sphere tree at the first tick [m], world."""
        return self.tree.transformed(rotation_matrix(self.orientation), self.position)


@dataclass(frozen=True)
class HalfSpace:
    """Fixed body that fills all below a height, such as a table; it stops bodies, and hands go through it."""

    name: str
    height: float  # of its surface [m], world
    friction: float | None = None  # μ with bodies; None: each body's own

    def __post_init__(self) -> None:
        check_range("table", self.height)
        if self.friction is not None:
            check_range("table_friction", self.friction)


def check_names(names: Sequence[str]) -> None:
    """Raise InputError for two bodies of one name, or one with the name of a hand, which pairs of contacts have too."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two bodies have the name '{name}'; expected a name for each")
        if name in SIDES:
            raise InputError(f"a body has the name '{name}', which is a hand's; expected another name")


def triple(values: ArrayLike) -> Triple:
    """Return three numbers as a tuple."""
    x, y, z = np.asarray(values, np.float64).tolist()
    return (x, y, z)
