"""Bodies of a scene: their surfaces and places, how each moves, and the joints that they hang on.

Poses, axes and points of a scene are in the world [m]: those of a body that moves are of the first tick. Its mesh and
its tree alone are in the frame of the body, which `position` and `orientation` place in the world. TOML files of bodies
say what each is, where it is in the frame of its file, and how it moves; docs/toml.md has the keys.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from msgspec import Meta, structs
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.model import SIDES
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.linkage.linkage import chain_of
from hhsim.mesh.mesh import Mesh, mass_properties
from hhsim.motion.csv_table import read_table
from hhsim.motion.npz_arrays import numbers
from hhsim.motion.trajectory import ObjectMotion, as_numbers
from hhsim.ranges import RANGES, check_range
from hhsim.reproducible import norm, principal_axes
from hhsim.system.settings_file import Settings, a_list, between
from hhsim.trees.sphere_tree import SphereTree

Triple: TypeAlias = tuple[float, float, float]
GRAVITY: Triple = (0.0, 0.0, -9.81)
"""[m/s²], world."""
USUAL_FRICTION = 0.6
"""Skin on aluminium (Seo et al. 2009)."""
LEAST_LENGTH = 1e-9
"""A direction or a quaternion that is shorter has none: rounding would choose it."""
MOST_BODIES = 6
"""Largest number of bodies with a surface where one is free."""
JOINT_BOUNDS = {"hinge": (np.pi, "π"), "slider": (100.0, "100")}
"""Bound of a free body's joint from its value at the first tick [rad] or [m], as a number and as text."""
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
        return cls(mass, triple(solid.center), symmetric(inertia), **others)


BodyMotion: TypeAlias = Fixed | Driven | Free
"""How a body moves; the motion of a hand is `hhsim.scene.motion_catalogue.Motion`."""


Number = Annotated[float, between(-100.0, 100.0)]
Three = tuple[Number, Number, Number]
Coordinate = Annotated[float, between(-1000.0, 1000.0)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Keyframe = tuple[Annotated[float, between(0.0, 1e6)], Number]
Edge = Annotated[float, between(1e-3, 10.0, "m")]


class JointRecording(Settings, frozen=True):
    """Columns of a CSV file, or arrays of an .npz, that hold a joint's values; the path is relative to the bodies'.

    An .npy has the rate of its rows [Hz], the first of which is at 0 s, and the number of a column, from 0 on; one of
    nested dictionaries the keys of an array with slashes between.
    """

    file: str
    column: str | int
    time: str | None = None
    rate: Annotated[float, between(1e-3, 1e6, "Hz")] | None = None

    def check(self) -> None:
        """Check that an .npy has a column and a rate, and any other file names."""
        rows, numbered = Path(self.file).suffix == ".npy", isinstance(self.column, int)
        fits = (self.rate and self.time is None) if rows else not numbered and self.rate is None
        if not fits:
            expected = "column = 0 and rate = 30.0, no time" if rows else "names of column and time, no rate"
            raise InputError(f"{self.file} has {'no names and no stamps' if rows else 'names'}; expected {expected}")

    def read(self, folder: Path) -> tuple[Keyframe, ...]:
        """Return (time [s], value) of each sample; InputError for no such file or column, or what is no number."""
        from hhsim.recordings.content import ROWS, Content

        path, names = folder / self.file, (self.time or "t", str(self.column))
        content = Content(path, what="a joint's values")
        with named(path):
            if path.suffix not in (".npy", ".npz"):
                time, values = read_table(content.text, strict=True).numbers(names)[0].T
            elif isinstance(self.column, int):
                rows = as_numbers("array", content.arrays.get(ROWS, ()))
                if rows.ndim != 2 or not 0 <= self.column < rows.shape[1]:
                    raise InputError(f"no column {self.column} in an array of shape {rows.shape}; expected (T, 7)")
                values = rows[:, self.column]
            else:
                check_known("array", names if self.rate is None else names[1:], content.arrays)
                values = numbers(content.arrays, names[1])
                if self.rate is None:
                    time = numbers(content.arrays, names[0])
            if self.rate is not None:
                time = np.arange(len(values)) / self.rate
            if time.ndim != 1 or time.shape != values.shape:
                raise InputError(f"shapes {time.shape} and {values.shape}; expected (T,) of both")
            if not (len(time) and np.isfinite(time).all() and np.isfinite(values).all()):
                missing = " or ".join(names) if isinstance(self.column, str) else f"column {self.column}"
                raise InputError(f"{missing} is empty or lacks a number; expected one a sample")
        return tuple(zip(time.tolist(), values.tolist(), strict=True))


class Joint(Settings, frozen=True):
    """Hinge or slider of a body on the world or on another body; docs/toml.md explains the keys.

    Axis and origin are in the frame of what bears it; of a body in a scene in the world at the first tick. Raises
    InputError for an axis of length 0, limits or times out of order, or a value beyond the limits.
    """

    type: Literal["hinge", "slider"]
    axis: Vector  # direction, of any length, by the right hand's rule
    origin: Vector = (0.0, 0.0, 0.0)  # a point of the axis [m]; of a slider without meaning
    limits: tuple[Number, Number] | None = None  # least and greatest value [rad] or [m]; None: there are none
    friction: Annotated[float, between(*RANGES["hinge_friction"][:2])] = 0.0  # largest moment [N·m] or force [N]
    on: str = ""  # name of the body that bears it and does not stop it; "": the world
    start: Number | None = None  # value at the first tick [rad] or [m]; None: 0
    motion: Annotated[tuple[Keyframe, ...], a_list("[[0.0, 0.0], [1.0, 1.5]]")] | None = None
    recording: JointRecording | None = None

    def check(self) -> None:
        """Check the axis, the order of the limits and of the times, and each value against the limits."""
        if not (np.isfinite(self.axis).all() and norm(np.array(self.axis)) > LEAST_LENGTH):
            raise InputError(f"the axis of the {self.type} has length 0; expected one such as [0.0, 1.0, 0.0]")
        if not np.isfinite(self.origin).all():
            raise InputError(f"the origin of the {self.type} is not finite; expected a point of its axis")
        check_range(f"{self.type}_friction", self.friction)
        if self.limits is not None and self.limits[0] > self.limits[1]:
            least, most = self.limits
            raise InputError(f"limits are reversed: {least:g} is above {most:g}; expected the least value first")
        given = [name for name in ("motion", "recording", "start") if getattr(self, name) is not None]
        if len(given) > 1:
            raise InputError(f"both a {' and a '.join(given)}; expected one of them")
        times = [time for time, _ in self.motion or ()]
        for number, (before, after) in enumerate(pairwise(times), start=2):
            if after <= before:
                raise InputError(f"motion[{number}] is at {after:g} s, not after {before:g} s; expected rising times")
        values = {f"motion[{number}]": value for number, (_, value) in enumerate(self.motion or (), start=1)}
        least, most = self.limits or (-np.inf, np.inf)
        for what, value in values.items() if self.is_driven else [("start", self.value)]:
            if not least <= value <= most:
                raise InputError(
                    f"{what} has the value {value:g}, beyond the limits; expected {least:g} to {most:g} {self.unit}"
                )

    @property
    def value(self) -> float:
        """Value at the first tick [rad] or [m], where no motion is told."""
        return self.start or 0.0

    @property
    def direction(self) -> FloatArray:
        """Unit vector along the axis, shape (3,)."""
        axis = np.array(self.axis)
        return np.asarray(axis / norm(axis))

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "rad" if self.type == "hinge" else "m"

    @property
    def is_driven(self) -> bool:
        """True if the joint moves as recorded; otherwise forces move what is on it."""
        return self.motion is not None or self.recording is not None

    def read(self, folder: Path) -> "Joint":
        """Return the joint with the motion of its recording, whose path is relative to a folder."""
        if self.recording is None:
            return self
        keyframes = self.recording.read(folder)
        with named(folder / self.recording.file):
            return structs.replace(self, motion=keyframes, recording=None)

    def moved(self, motion: Sequence[Keyframe]) -> "Joint":
        """Return the joint driven by another motion; InputError for a value beyond the limits."""
        return structs.replace(self, motion=tuple(motion), recording=None, start=None)

    def values(self, time: FloatArray) -> FloatArray:
        """Return the joint's values [rad] or [m] at these times [s], (T,); its recording has been read."""
        if self.motion is None:
            return np.full(len(time), self.value)
        times, values = np.array(self.motion).T
        found: FloatArray = np.interp(time, times, values)
        return found

    def poses(self, position: FloatArray, orientation: FloatArray, values: FloatArray) -> ObjectMotion:
        """Return the poses of a body on the joint at each value, (T,), in the frame of what bears the joint.

        `position` [m], (3,), and `orientation` (w, x, y, z), (4,), are those at the value 0.
        """
        place, turn = np.tile(position, (len(values), 1)), np.tile(orientation, (len(values), 1))
        along = values[:, None] * self.direction
        if self.type == "slider":
            return ObjectMotion(place + along, turn)
        moved, origin = quaternion(along), np.array(self.origin)
        about = (rotation_matrix(moved) * (place - origin)[:, None, :]).sum(axis=-1)
        return ObjectMotion(origin + about, quaternion_product(moved, turn))


@dataclass(frozen=True, eq=False)
class Body:
    """Rigid body with a surface; mesh and tree [m] are in its frame, all else is in the world at the first tick.

    Raises InputError for a number out of its range.
    """

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
        if self.free_joint is not None and self.limits is not None:
            (least, most), (bound, text) = self.limits, JOINT_BOUNDS[self.free_joint.type]
            if not -bound <= least <= most <= bound:
                given = f"{self.free_joint.type} limits {least:g} to {most:g} {self.free_joint.unit}"
                raise InputError(f"{given}; expected values from the start within ±{text}")

    @property
    def is_free(self) -> bool:
        """True if forces move it."""
        return isinstance(self.motion, Free)

    @property
    def free_joint(self) -> Joint | None:
        """Joint on which forces move it."""
        return self.joint if self.is_free else None

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and greatest value of its joint, less that at the first tick [rad] or [m]; None without limits."""
        if self.joint is None or self.joint.limits is None:
            return None
        least, most = self.joint.limits
        return least - self.joint.value, most - self.joint.value

    @cached_property
    def solid(self) -> Free:
        """Mass, centre and inertia: those of its motion, or of its mesh where forces do not move it."""
        return self.motion if isinstance(self.motion, Free) else Free.of_mesh(self.placed_mesh)

    @property
    def pivot(self) -> FloatArray:
        """Centre of mass, or the point of its hinge's axis nearest to it [m], world at the first tick, shape (3,)."""
        center, joint = np.array(self.solid.center), self.free_joint
        if joint is None or joint.type == "slider":
            return center
        axis, origin = joint.direction, np.array(joint.origin)
        pivot: FloatArray = origin + ((center - origin) * axis).sum() * axis
        return pivot

    def properties(self, plane: "HalfSpace | None") -> dict[str, Any]:
        """Return what counts of it and of a plane where a body is free, as plain values, limits less the joint's value.

        A joint is named by its type, and only where there is one.
        """
        table = (None, None) if plane is None else (plane.height, plane.friction)
        plain = {**asdict(self.solid), "friction": self.friction, "torsion": self.torsion}
        plain |= dict(zip(("table", "table_friction"), table))
        if (joint := self.free_joint) is None:
            return plain
        origin = {"origin": joint.origin} if joint.type == "hinge" else {}
        own = {"limits": self.limits, "friction": joint.friction, "on": joint.on}
        return plain | {joint.type: {"axis": joint.axis, **origin, **own}}

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


def triple(values: ArrayLike) -> Triple:
    """Return three numbers as a tuple."""
    x, y, z = np.asarray(values, np.float64).tolist()
    return (x, y, z)


def symmetric(inertia: FloatArray) -> tuple[Triple, Triple, Triple]:
    """Return an inertia row by row, without what rounding left of asymmetry."""
    first, second, third = (triple(row) for row in 0.5 * (inertia + inertia.T))
    return first, second, third


def composed(base: ObjectMotion, poses: ObjectMotion) -> ObjectMotion:
    """Return poses, each given in the frame `base` of its moment, in the frame in which `base` itself is given."""
    return ObjectMotion(base.frame.points(poses.position), base.frame.orientations(poses.orientation))


def check_names(names: Sequence[str]) -> None:
    """Raise InputError for two bodies of one name, or one with the name of a hand, which pairs of contacts have too."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two bodies have the name '{name}'; expected a name for each")
        if name in SIDES:
            raise InputError(f"a body has the name '{name}', which is a hand's; expected another name")


class PoseFile(Settings, frozen=True):
    """File with the poses of a body, as `hhsim import --object-poses` reads it; the path is relative to the bodies'.

    `rate` is that of poses without stamps [Hz], the first of which is at 0 s. `order` and `unit` are those of
    quaternions and positions where the file does not say them.
    """

    file: str
    rate: Annotated[float, between(1e-3, 1e6, "Hz")] | None = None
    order: Literal["wxyz", "xyzw"] | None = None
    unit: Literal["m", "cm", "mm"] | None = None

    def read(self, folder: Path) -> tuple[FloatArray, ObjectMotion]:
        """Return stamps [s], (T,), and poses of a body in a frame that its position and orientation place.

        Raises InputError for poses that are missing, and TrajectoryError for a file that has none.
        """
        from hhsim.recordings.object_poses import read_stamped_poses
        from hhsim.recordings.registry import ReadOptions

        path = folder / self.file
        stamps, poses = read_stamped_poses(path, ReadOptions(pose_order=self.order, pose_unit=self.unit))
        with named(path):
            if stamps is None:
                if self.rate is None:
                    raise InputError("has no stamps; expected rate = 30.0 beside the file's name")
                stamps = np.arange(len(poses.position)) / self.rate
            missing = ~np.isfinite(np.concatenate(poses, axis=1)).all(axis=1)
            if missing.any():
                raise InputError(f"lacks the pose of row {int(np.argmax(missing))}; expected one in each row")
        return stamps, poses


class BodySettings(Settings, frozen=True, kw_only=True):
    """One body; docs/toml.md explains the keys."""

    name: Annotated[str, Meta(pattern=r"\A[A-Za-z0-9_-]+\Z", description="letters, digits, - and _")]
    mesh: str = ""
    unit: str | None = None
    box: tuple[Edge, Edge, Edge] | None = None
    plane: Literal["under"] | Number | None = None
    position: Three = (0.0, 0.0, 0.0)
    orientation: tuple[Number, Number, Number, Number] = (1.0, 0.0, 0.0, 0.0)
    fixed: bool = False
    density: Annotated[float, between(*RANGES["density"][:2])] | None = None
    mass: Annotated[float, between(*RANGES["mass"][:2])] | None = None
    center: Three | None = None
    inertia: tuple[Three, Three, Three] | None = None
    friction: Annotated[float, between(*RANGES["friction"][:2])] | None = None
    torsion: Annotated[float, between(*RANGES["torsion"][:2])] = 0.0
    joint: Joint | None = None
    poses: PoseFile | None = None

    def check(self) -> None:
        """Check that there is one shape, one of what says how it moves, one of mass and density, and an orientation."""
        shapes = [name for name in ("mesh", "box", "plane") if getattr(self, name) not in (None, "")]
        if len(shapes) != 1:
            found = f"both a {' and a '.join(shapes)}" if shapes else "no mesh and no box"
            raise InputError(f"body '{self.name}' has {found}; expected one of them")
        if norm(np.array(self.orientation)) < LEAST_LENGTH:
            raise InputError("orientation has length 0; expected (w, x, y, z) such as [1.0, 0.0, 0.0, 0.0]")
        for names in (("fixed", "joint", "poses"), ("mass", "density")):
            given = [name for name in names if getattr(self, name)]
            if len(given) > 1:
                raise InputError(f"body '{self.name}' has both {' and '.join(given)}; expected one of them")
        if (self.inertia is None) != (self.center is None) or (self.inertia is not None and self.mass is None):
            raise InputError(f"body '{self.name}' has one of inertia and center without the other, or without a mass")
        if self.plane is not None and (self.joint or self.poses):
            raise InputError(f"body '{self.name}' is a plane, which stays where it is; expected no joint and no poses")

    @property
    def is_free(self) -> bool:
        """True if forces move it: it is neither fixed nor driven."""
        driven = self.poses is not None or (self.joint is not None and self.joint.is_driven)
        return not (self.fixed or driven or self.plane is not None)

    @property
    def bearer(self) -> str:
        """Name of the body that its joint is on; "" for the world, or without a joint."""
        return self.joint.on if self.joint else ""

    @property
    def turn(self) -> FloatArray:
        """Orientation as a unit quaternion (w, x, y, z), (4,)."""
        given = np.array(self.orientation)
        return np.asarray(given / norm(given))


class BodyFile(Settings, frozen=True):
    """Bodies in the order of the file."""

    body: Annotated[tuple[BodySettings, ...], Meta(min_length=1, description="at least one table [[body]]")]

    def check(self) -> None:
        """Check names, joints on other bodies, in no circle, driven ones on none that is free, and the number."""
        names = [body.name for body in self.body]
        check_names(names)
        solid = {body.name: body for body in self.body if body.plane is None}
        bearers = {body.name: body.bearer for body in self.body if body.bearer}
        check_known("body", bearers.values(), solid)
        for name, on in bearers.items():
            chain_of(name, bearers, "body")
            if solid[on].is_free and not solid[name].is_free:
                raise InputError(f"body '{name}' is driven on '{on}', which is free; expected one that is not")
        planes = [body.name for body in self.body if body.plane is not None]
        if len(planes) > 1:
            raise InputError(f"bodies {' and '.join(planes)} are planes; expected one at most")
        if not solid:
            raise InputError(f"body '{names[0]}' is a plane; expected a body with a mesh or a box, too")
        if any(body.is_free for body in self.body) and len(solid) > MOST_BODIES:
            raise InputError(f"{len(solid)} bodies, of which some are free; expected up to {MOST_BODIES}")
