"""Several things in a scene, each free or fixed, as TOML declares them.

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
    hinge.friction = 0.0             # largest moment of the hinge's friction [N·m]; none on a free thing
    slider.axis = [1.0, 0.0, 0.0]    # in place of a hinge: it only moves along; `on` is as of a hinge
    slider.limits = [-0.1, 0.1]      # least and greatest way from where it begins [m]; none without
    slider.friction = 0.0            # largest force of the slider's friction [N]
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.catalogue import THINGS, names_a_file
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import Trajectory
from hhsim.ranges import RANGES
from hhsim.reproducible import norm
from hhsim.scene.free_object import CLEARANCE, FreeObject, Hinge, Slider
from hhsim.scene.jointed_thing import Number, Shape, Three, Two, check_no_circle
from hhsim.scene.parts_of_thing import require_apart, shape_mesh
from hhsim.system.settings_file import Settings, between, read_settings, read_toml_text
from hhsim.trees.sphere_tree import SphereTree

MOST_THINGS = 6


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

    @property
    def joint(self) -> Hinge | Slider | None:
        """Its hinge or slider in the frame of the file."""
        settings = self.hinge or self.slider
        return settings.joint() if settings else None

    def check(self) -> None:
        """Check the shape and the joint, for one of mass and density, and that what is fixed has no joint."""
        super().check()
        if self.hinge and self.slider:
            raise InputError(f"thing '{self.name}' has both a hinge and a slider; expected one of them")
        if self.fixed and self.joint:
            raise InputError(f"thing '{self.name}' is fixed and has a {self.joint.KIND}; expected one of them")
        if self.mass is not None and self.density is not None:
            raise InputError(f"thing '{self.name}' has both a mass and a density; expected one of them")

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
        if self.thing[0].fixed:
            raise InputError(f"the first thing, '{names[0]}', is fixed; expected the one that the hand moves first")
        bearers = {thing.name: thing.joint.on for thing in self.thing if thing.joint and thing.joint.on}
        check_known("thing", bearers.values(), names)
        check_no_circle(bearers, "one thing that hangs on no other")
        free = [thing.name for thing in self.thing if not thing.fixed]
        for thing in self.thing:
            if thing.joint and thing.joint.friction > 0.0 and thing.joint.on in free:
                kind = thing.joint.KIND
                raise InputError(f"the {kind} of '{thing.name}' is on a free thing; expected {kind}.friction = 0")

    @property
    def joined(self) -> set[frozenset[str]]:
        """Pairs of names of things that a joint joins."""
        return {frozenset((thing.name, thing.joint.on)) for thing in self.thing if thing.joint}


class OtherThing(NamedTuple):
    """Thing beside a free object, in the world before the first tick; of a fixed one only the friction counts."""

    name: str
    mesh: Mesh
    tree: SphereTree
    free: FreeObject
    fixed: bool


@dataclass(frozen=True, eq=False)
class Things:
    """Several things with their meshes, in the frame of the file [m]."""

    name: str
    settings: ThingsSettings
    meshes: tuple[Mesh, ...]

    @property
    def mesh(self) -> Mesh:
        """Mesh of the first one, named for all."""
        return replace(self.meshes[0], name=self.name)

    def named(self, tree: SphereTree) -> SphereTree:
        """Return the first thing's tree with the name of the scene, by which a script finds its placement."""
        return replace(tree, options={**tree.options, "thing": self.name})

    def placed(
        self, mesh: Mesh, tree: SphereTree, motion: Trajectory, ticks: int, tree_of: Callable[[Mesh], SphereTree]
    ) -> tuple[tuple[OtherThing, ...], MovingParts, FreeObject]:
        """Return the others, room for the poses of all at so many ticks, and the first one as a free object.

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
        given = list(zip(settings.thing, meshes, trees, free))[1:]
        parts = MovingParts(
            self.name, names, tuple(meshes), tuple(trees), np.zeros((ticks, len(names), 7)), {}, free=True
        )
        others = tuple(OtherThing(of.name, one, its, own, of.fixed) for of, one, its, own in given)
        return others, parts, free[0]


def names_things(word: str) -> bool:
    """Return True if a word means several things: a name of the catalogue, or a TOML file, with tables [[thing]]."""
    path = _path_of(word)
    text = read_toml_text(path, "thing of several parts, or several things")
    return re.search(r"^\s*\[\[\s*thing\s*\]\]", text, re.MULTILINE) is not None


def _path_of(word: str) -> Path:
    return Path(word) if names_a_file(word) else Path(str(files("hhsim.objects") / THINGS / f"{word}.toml"))


def load_things(word: str, *, solid: bool = True) -> Things:
    """Load several things: a name of the catalogue, or a TOML file.

    Without `solid` the triangles of mesh files are taken as they are. Raises InputError for a file that cannot be used,
    or things that begin inside each other.
    """
    path = _path_of(word)
    settings = read_settings(path, ThingsSettings, "scene of several things")
    with named(word):
        meshes: Sequence[Mesh] = [
            shape_mesh(thing, path.parent, solid).transformed(
                rotation_matrix(np.array(thing.orientation) / norm(np.array(thing.orientation))),
                np.array(thing.position),
            )
            for thing in settings.thing
        ]
        require_apart([thing.name for thing in settings.thing], meshes, settings.joined)
    return Things(path.stem, settings, tuple(meshes))
