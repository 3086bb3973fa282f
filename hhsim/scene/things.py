"""Several things in a scene, each free, fixed or driven, as TOML declares them.

Keys, with their defaults; a shape and its place are as of `hhsim.scene.jointed_thing`::

    table = "under"            # right under the lowest thing; none, or a height [m] in the file's frame

    [[thing]]                  # the first one is free: the motion is of it
    name = "peg"
    mesh = "peg.ply"           # or: box = [0.02, 0.02, 0.06]
    position = [0.0, 0.0, 0.05]
    orientation = [1.0, 0.0, 0.0, 0.0]
    density = 1000.0           # [kg/m³], or: mass = 0.1 [kg]
    friction = 0.6             # with hand and table; of two things it is the geometric mean of both
    torsion = 0.0              # as --torsion [m]
    fixed = false              # true: it stays where it is
    hinge.axis = [0.0, 1.0, 0.0]     # it only turns, by the right hand's rule; without a joint it moves in all ways
    hinge.origin = [0.0, 0.0, 0.0]   # a point of the axis [m]
    hinge.on = "base"                # a thing that bears the hinge, and does not stop it; without one the world
    hinge.limits = [-1.9, 0.4]       # least and greatest angle from where it begins [rad], within ±π; none without
    hinge.friction = 0.0             # largest moment of the hinge's friction [N·m]
    slider.axis = [1.0, 0.0, 0.0]    # in place of a hinge: it only moves along; `on` is as of a hinge
    slider.limits = [-0.1, 0.1]      # least and greatest way from where it begins [m]; none without
    slider.friction = 0.0            # largest force of the slider's friction [N]
    driven.type = "slider"           # in place of these: it goes as recorded, through what is fixed or driven, too;
    driven.motion = [[0.0, 0.0], [1.0, 0.1]]    # keys as of the joint of a part, see `hhsim.scene.jointed_thing`
    poses = { file = "box.npy", rate = 30.0 }   # or by its poses, which have no joint, see `hhsim.scene.things`
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from msgspec import Meta, structs

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion_product, rotation_matrix
from hhsim.linkage.file import names_a_linkage
from hhsim.mesh.catalogue import THINGS, names_a_file
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, TickInput, Trajectory
from hhsim.ranges import RANGES
from hhsim.reproducible import norm
from hhsim.scene.free_object import CLEARANCE, FreeObject, Hinge, Slider
from hhsim.scene.jointed_thing import Joint, Keyframe, Number, Shape, Three, Two, check_no_circle, moved_by
from hhsim.scene.parts_of_thing import require_apart, require_no_joints, shape_mesh
from hhsim.system.settings_file import Settings, between, read_settings, read_toml_text
from hhsim.trees.sphere_tree import SphereTree

Drive: TypeAlias = Callable[[FloatArray], ObjectMotion]
"""Poses of a thing's own frame in that of the scene's file at some times [s], shape (T,)."""
MOST_THINGS = 6


class PoseFile(Settings, frozen=True):
    """File with the poses of a thing, as `hhsim import --object-poses` reads it; the path is relative to the scene's.

    `rate` is that of poses without stamps [Hz], the first of which is at 0 s. `order` and `unit` are those of
    quaternions and positions where the file does not say them.
    """

    file: str
    rate: Annotated[float, between(1e-3, 1e6, "Hz")] | None = None
    order: Literal["wxyz", "xyzw"] | None = None
    unit: Literal["m", "cm", "mm"] | None = None

    def drive(self, shape: Shape, folder: Path) -> Drive:
        """Return the motion of a shape by the poses, in a frame that its position and orientation place in the file's.

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
        turn = np.array(shape.orientation) / norm(np.array(shape.orientation))

        def drive(time: FloatArray) -> ObjectMotion:
            at = np.clip(time, stamps[0], stamps[-1])
            turns = interpolate_orientation(stamps, poses.orientation, at)
            frame = RigidMotion(np.broadcast_to(turn, turns.shape), np.tile(np.array(shape.position), (len(at), 1)))
            places = frame.points(interpolate_monotone(stamps, poses.position, at))
            return ObjectMotion(places, quaternion_product(frame.turn, turns))

        return drive


def along_joint(shape: Shape, joint: Joint) -> Drive:
    """Return the motion of a shape along or about a joint whose motion has been read."""
    return lambda time: ObjectMotion(*moved_by(shape, joint, joint.values(time)))


class SliderSettings(Settings, frozen=True):
    """Slider of a thing; the module's docstring explains the keys."""

    axis: Three
    on: str = ""
    limits: Two | None = None
    friction: Annotated[float, between(*RANGES["slider_friction"][:2])] = 0.0

    def joint(self) -> Hinge | Slider:
        """Return the joint in the frame of the file."""
        return Slider(self.axis, self.limits, self.friction, self.on)


class HingeSettings(SliderSettings, frozen=True):
    """Hinge of a thing; the module's docstring explains the keys."""

    origin: Three = (0.0, 0.0, 0.0)

    def joint(self) -> Hinge:
        """Return the joint in the frame of the file."""
        return Hinge(self.axis, self.origin, self.limits, self.friction, self.on)


class ThingSettings(Shape, frozen=True):
    """One thing; the module's docstring explains the keys."""

    density: Annotated[float, between(*RANGES["density"][:2])] | None = None
    mass: Annotated[float, between(*RANGES["mass"][:2])] | None = None
    friction: Annotated[float, between(*RANGES["friction"][:2])] = 0.6
    torsion: Annotated[float, between(*RANGES["torsion"][:2])] = 0.0
    fixed: bool = False
    hinge: HingeSettings | None = None
    slider: SliderSettings | None = None
    driven: Joint | None = None
    poses: PoseFile | None = None

    @property
    def joint(self) -> Hinge | Slider | None:
        """Its hinge or slider in the frame of the file."""
        settings = self.hinge or self.slider
        return settings.joint() if settings else None

    def check(self) -> None:
        """Check the shape, and that there is one of mass and density, and one of what says how it moves."""
        super().check()
        given = [name for name in ("fixed", "hinge", "slider", "driven", "poses") if getattr(self, name)]
        if len(given) > 1:
            raise InputError(f"thing '{self.name}' has both {' and '.join(given)}; expected one of them")
        if self.mass is not None and self.density is not None:
            raise InputError(f"thing '{self.name}' has both a mass and a density; expected one of them")

    def drive(self, folder: Path, motions: Mapping[str, Sequence[Keyframe]]) -> Drive | None:
        """Return the motion of a driven thing, whose files are in a folder; None for others.

        `motions` has that of joints in place of their own, by the name of the thing.
        """
        if self.poses is not None:
            return self.poses.drive(self, folder)
        if self.driven is None:
            return None
        joint = self.driven.read(folder)
        if self.name in motions:
            joint.check_motion(motions[self.name])
            joint = structs.replace(joint, motion=tuple(motions[self.name]))
        return along_joint(self, joint)

    def free_object(self, mesh: Mesh, table: float | None, rotation: FloatArray, position: FloatArray) -> FreeObject:
        """Return its physical properties, its mesh in the world [m] over a table at a height [m].

        Rotation (3, 3) and position [m] (3,) lead from the frame of the file to the world.
        """
        given: dict[str, Any] = {"density": self.density or 1000.0} if self.mass is None else {"mass": self.mass}
        if self.joint is not None:
            given[self.joint.KIND] = self.joint.placed(rotation, position)
        return FreeObject.of_mesh(mesh, friction=self.friction, torsion=self.torsion, table=table, **given)


class ThingsSettings(Settings, frozen=True):
    """Things in the order of the file."""

    thing: Annotated[tuple[ThingSettings, ...], Meta(min_length=2, max_length=MOST_THINGS, description="2 to 6 things")]
    table: Literal["under", "none"] | Number = "under"

    def check(self) -> None:
        """Check that names differ, that the first thing is free, and that joints are on other things, in no circle."""
        names = [thing.name for thing in self.thing]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"two things have the name '{name}'; expected a name for each")
        first = self.thing[0]
        if first.fixed or first.driven or first.poses:
            found = "fixed" if first.fixed else "driven"
            raise InputError(f"the first thing, '{names[0]}', is {found}; expected the one that the hand moves first")
        bearers = {thing.name: thing.joint.on for thing in self.thing if thing.joint and thing.joint.on}
        check_known("thing", bearers.values(), names)
        check_no_circle(bearers, "one thing that hangs on no other")

    @property
    def joined(self) -> set[frozenset[str]]:
        """Pairs of names of things that a joint joins."""
        return {frozenset((thing.name, thing.joint.on)) for thing in self.thing if thing.joint}


class OtherThing(NamedTuple):
    """Thing beside a free object, in the world before the first tick; unless it is free only its friction counts."""

    name: str
    mesh: Mesh
    tree: SphereTree
    free: FreeObject
    fixed: bool


@dataclass(frozen=True, eq=False)
class Things:
    """Several things with their meshes, in the frame of the file [m], and the motion of the driven ones."""

    name: str
    settings: ThingsSettings
    meshes: tuple[Mesh, ...]
    drives: tuple[Drive | None, ...]

    @property
    def mesh(self) -> Mesh:
        """Mesh of the first one, named for all."""
        return replace(self.meshes[0], name=self.name)

    def named(self, tree: SphereTree) -> SphereTree:
        """Return the first thing's tree with the name of the scene, by which a script finds its placement."""
        return replace(tree, options={**tree.options, "thing": self.name})

    def placed(
        self, mesh: Mesh, tree: SphereTree, motion: Trajectory, ticks: TickInput, tree_of: Callable[[Mesh], SphereTree]
    ) -> tuple[tuple[OtherThing, ...], MovingParts, FreeObject]:
        """Return the others, room for the poses of all at the ticks, and the first one as a free object.

        Mesh and tree are the first one's where the motion places it, world; `tree_of` makes those of the others.
        """
        settings, place = self.settings, (rotation_matrix(motion.object_orientation), motion.object_position)
        meshes = [mesh, *(one.transformed(*place) for one in self.meshes[1:])]
        trees = [tree, *(tree_of(one).transformed(*place) for one in self.meshes[1:])]
        table = None
        if settings.table != "none":
            lowest = min(float(one.bounds[0, 2]) for one in meshes) - CLEARANCE
            table = lowest if settings.table == "under" else float(settings.table) + float(motion.object_position[2])
        free = [thing.free_object(one, table, *place) for thing, one in zip(settings.thing, meshes)]
        names = tuple(thing.name for thing in settings.thing)
        if any(one.joint and one.joint.on == names[0] for one in free):
            free[0] = replace(free[0], name=names[0])
        driven = {
            name: _driven(drive, ticks.time, motion) for name, drive in zip(names, self.drives) if drive is not None
        }
        given = list(zip(settings.thing, meshes, trees, free))[1:]
        parts = MovingParts(
            *(self.name, names, tuple(meshes), tuple(trees), np.zeros((ticks.tick_count, len(names), 7)), {}),
            free=True,
            driven=driven,
        )
        others = tuple(OtherThing(of.name, one, its, own, of.fixed) for of, one, its, own in given)
        return others, parts, free[0]


def names_things(word: str) -> bool:
    """Return True if a word means several things: a name of the catalogue, or a TOML file, with tables [[thing]]."""
    path = _path_of(word)
    if names_a_linkage(path):
        return False
    text = read_toml_text(path, "thing of several parts, or several things")
    return re.search(r"^\s*\[\[\s*thing\s*\]\]", text, re.MULTILINE) is not None


def _path_of(word: str) -> Path:
    return Path(word) if names_a_file(word) else Path(str(files("hhsim.objects") / THINGS / f"{word}.toml"))


def load_things(word: str, motion: object = None, *, solid: bool = True) -> Things:
    """Load several things: a name of the catalogue, or a TOML file.

    Joints of driven things are moved by the motion, if it is a script that has some. Without `solid` the triangles of
    mesh files are taken as they are. Raises InputError for a file that cannot be used, a joint that no thing has, or
    things that begin inside each other.
    """
    path = _path_of(word)
    settings = read_settings(path, ThingsSettings, "scene of several things")
    motions: dict[str, Sequence[Keyframe]] = dict(getattr(motion, "joints", ()))
    with named(word):
        joints = [thing.name for thing in settings.thing if thing.driven]
        if joints:
            check_known("joint", motions, joints)
        else:
            require_no_joints(motion, path.stem)
        drives = tuple(thing.drive(path.parent, motions) for thing in settings.thing)
        meshes = []
        for thing, drive in zip(settings.thing, drives):
            begin = np.zeros(1)
            place, turn = drive(begin) if drive else moved_by(thing, None, begin)
            meshes.append(shape_mesh(thing, path.parent, solid).transformed(rotation_matrix(turn[0]), place[0]))
        require_apart([thing.name for thing in settings.thing], meshes, settings.joined)
    return Things(path.stem, settings, tuple(meshes), drives)


def _driven(drive: Drive, time: FloatArray, placed: Trajectory) -> RigidMotion:
    """Return the motion of a driven thing since 0 s, at some times [s], in a world where a hand's motion places it."""
    begun = np.concatenate([[0.0], time])
    poses, ways = drive(begun), (len(begun), 1)
    frame = RigidMotion(np.tile(placed.object_orientation, ways), np.tile(placed.object_position, ways))
    world = ObjectMotion(frame.points(poses.position), frame.orientations(poses.orientation))
    return world.at(slice(1, None)).since(world.position[0], world.orientation[0])
