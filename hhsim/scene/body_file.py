"""TOML files of bodies: what each is, where it is, and how it moves; docs/toml.md has the keys."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion_product
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.ranges import RANGES
from hhsim.reproducible import norm
from hhsim.scene.body import LEAST_LENGTH, Joint, Number, Three, check_names
from hhsim.system.settings_file import Settings, between

Drive: TypeAlias = Callable[[FloatArray], ObjectMotion]
"""Poses of a body's frame in that of its file at some times [s], shape (T,)."""
MOST_BODIES = 6
"""Largest number of bodies with a surface where one is free."""
Edge = Annotated[float, between(1e-3, 10.0, "m")]


class PoseFile(Settings, frozen=True):
    """File with the poses of a body, as `hhsim import --object-poses` reads it; the path is relative to the bodies'.

    `rate` is that of poses without stamps [Hz], the first of which is at 0 s. `order` and `unit` are those of
    quaternions and positions where the file does not say them.
    """

    file: str
    rate: Annotated[float, between(1e-3, 1e6, "Hz")] | None = None
    order: Literal["wxyz", "xyzw"] | None = None
    unit: Literal["m", "cm", "mm"] | None = None

    def drive(self, position: Three, turn: FloatArray, folder: Path) -> Drive:
        """Return the motion of a body by the poses, in a frame that a position [m] and a unit quaternion place.

        Before the first pose and after the last one it stands. Raises InputError for poses that are missing, and
        TrajectoryError for a file that has none.
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

        def drive(time: FloatArray) -> ObjectMotion:
            at = np.clip(time, stamps[0], stamps[-1])
            turns = interpolate_orientation(stamps, poses.orientation, at)
            frame = RigidMotion(np.broadcast_to(turn, turns.shape), np.tile(np.array(position), (len(at), 1)))
            places = frame.points(interpolate_monotone(stamps, poses.position, at))
            return ObjectMotion(places, quaternion_product(frame.turn, turns))

        return drive


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
            chain = [name]
            while bearer := bearers.get(chain[-1]):
                chain.append(bearer)
                if bearer in chain[:-1]:
                    circle = " on ".join(chain[chain.index(bearer) :])
                    raise InputError(f"joints in a circle: {circle}; expected one body that hangs on no other")
            if solid[on].is_free and not solid[name].is_free:
                raise InputError(f"body '{name}' is driven on '{on}', which is free; expected one that is not")
        planes = [body.name for body in self.body if body.plane is not None]
        if len(planes) > 1:
            raise InputError(f"bodies {' and '.join(planes)} are planes; expected one at most")
        if not solid:
            raise InputError(f"body '{names[0]}' is a plane; expected a body with a mesh or a box, too")
        if any(body.is_free for body in self.body) and len(solid) > MOST_BODIES:
            raise InputError(f"{len(solid)} bodies, of which some are free; expected up to {MOST_BODIES}")
