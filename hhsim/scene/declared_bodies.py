"""Bodies as OBJECT names them: read with their meshes, given their sphere trees, and put into a scene by a motion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion_from_matrix, rotation_matrix
from hhsim.linkage.file import link_mesh, names_a_linkage, read_linkage, resolve_object
from hhsim.linkage.linkage import HERE, Link, LinkJoint, Robot
from hhsim.mesh.catalogue import BODIES, MESH_LEVEL, OF_BODIES, names_a_body_file, names_a_file, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.metrics.moving_parts import held_rows, placed_mesh
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, TickInput, Trajectory
from hhsim.reproducible import matmul
from hhsim.scene.body import (
    CLEARANCE,
    USUAL_FRICTION,
    Body,
    BodyFile,
    BodyMotion,
    BodySettings,
    Driven,
    Fixed,
    Free,
    HalfSpace,
    Joint,
    Keyframe,
    composed,
    symmetric,
    triple,
)
from hhsim.scene.overlap import Solid, overlap
from hhsim.system.settings_file import read_settings
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.sphere_tree import SphereTree

MOST_OVERLAP, MOST_JOINED_OVERLAP = 1e-4, 1e-3
"""Largest depth [m] of a body in another at the first tick, and in one that it hangs on: hinges are drawn roughly."""
BRANCHING = 8
LEVEL_OF_MANY = 3
"""Usual level of the trees of several bodies of which some are free: each meets others by 1,024 leaves at most."""
UNDER, NONE = "under", "none"
"""Words for a table right under the bodies, and for none."""
ONE = "object"
"""Name of the one body of a mesh without a name."""


@dataclass(frozen=True, eq=False)
class DeclaredBodies:
    """Bodies with their meshes and trees, each in its own frame [m], before a motion places them in the world."""

    name: str
    settings: tuple[BodySettings, ...]  # with the motions of joints read
    meshes: Mapping[str, Mesh]  # of each body but a plane, by its name
    trees: Mapping[str, SphereTree] = field(default_factory=dict)
    # Stamps [s] and poses of the bodies that go by those of a file, as `PoseFile.read`.
    recorded_poses: Mapping[str, tuple[FloatArray, ObjectMotion]] = field(default_factory=dict)
    level: int = MESH_LEVEL  # usual one of a tree
    start_time: float = 0.0  # time [s] of the motions at the first tick

    @classmethod
    def of_mesh(cls, mesh: Mesh, tree: SphereTree | None = None, level: int = MESH_LEVEL) -> "DeclaredBodies":
        """Return one fixed body [m], which goes along where the motion moves the object."""
        name = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in mesh.name) or ONE
        one = BodySettings(name=name, mesh=ONE, fixed=True)
        return cls(mesh.name, (one,), {name: mesh}, {} if tree is None else {name: tree}, level=level)

    @property
    def solids(self) -> tuple[BodySettings, ...]:
        """Bodies with a mesh."""
        return tuple(body for body in self.settings if body.plane is None)

    @property
    def object_bodies(self) -> tuple[BodySettings, ...]:
        """The object of the motion: the first free body, or all bodies with a mesh where none is free."""
        free = [body for body in self.solids if body.is_free]
        return tuple(free[:1]) or self.solids

    @cached_property
    def mesh(self) -> Mesh:
        """Mesh of the object, named for all bodies, where it begins in the frame of the file [m]."""
        posed = [(self.meshes[body.name], self.first_poses[body.name]) for body in self.object_bodies]
        if len(posed) > 1:
            return placed_mesh([mesh for mesh, _ in posed], [pose.frame for _, pose in posed], self.name)
        ((mesh, pose),) = posed
        return replace(mesh if _is_still(pose) else mesh.transformed(*_place(pose)), name=self.name)

    @cached_property
    def tree(self) -> SphereTree:
        """Sphere tree of the object, over the leaves of all of it, where it begins in the frame of the file [m]."""
        posed = [(self.trees[body.name], self.first_poses[body.name]) for body in self.object_bodies]
        about: dict[str, Any] = {OF_BODIES: self.name} if len(self.solids) > 1 else {}
        if len(posed) == 1:
            ((tree, pose),) = posed
            tree = tree if _is_still(pose) else tree.transformed(*_place(pose))
            return replace(tree, options={**tree.options, **about})
        return joined_tree([tree for tree, _ in posed], [pose.frame for _, pose in posed], self.name, self.mesh)

    def with_trees(self, make: Callable[[Mesh], SphereTree]) -> "DeclaredBodies":
        """Return the bodies with their sphere trees, those of equal meshes made once."""
        made = {mesh.sha256: make(mesh) for mesh in {mesh.sha256: mesh for mesh in self.meshes.values()}.values()}
        return replace(self, trees={name: made[mesh.sha256] for name, mesh in self.meshes.items()})

    def starting_at(self, time: float) -> "DeclaredBodies":
        """Return the bodies as they move from a time [s] on, which becomes 0 s."""
        return replace(self, start_time=self.start_time + time)

    def values(self, time: FloatArray) -> dict[str, FloatArray]:
        """Return the values [rad] or [m] of each driven joint at these times [s], (T,), by the name of its body."""
        joints = {body.name: body.joint for body in self.solids if body.joint and body.joint.is_driven}
        return {name: joint.values(time + self.start_time) for name, joint in joints.items()}

    def poses_at(self, time: FloatArray) -> dict[str, ObjectMotion]:
        """Return the poses of each body with a mesh in the frame of the file at these times [s], (T,), by its name.

        A free one is where it begins. Poses of equal values of the joints are equal to the bit.
        """
        bodies, known = {body.name: body for body in self.solids}, dict[str, ObjectMotion]()
        now, steps = time + self.start_time, (len(time), 1)

        def placed(body: BodySettings) -> ObjectMotion:
            if body.name in known:
                return known[body.name]
            place, joint = np.array(body.position), body.joint
            if joint is not None and (joint.is_driven or joint.start):
                own = joint.poses(place, body.turn, joint.values(now))
            else:
                own = ObjectMotion(np.tile(place, steps), np.tile(body.turn, steps))
            if body.name in self.recorded_poses:
                # Before the first pose and after the last one it stands.
                stamps, poses = self.recorded_poses[body.name]
                at = np.clip(now, stamps[0], stamps[-1])
                turns = interpolate_orientation(stamps, poses.orientation, at)
                own = composed(own, ObjectMotion(interpolate_monotone(stamps, poses.position, at), turns))
            known[body.name] = composed(placed(bodies[body.bearer]), own) if body.bearer else own
            return known[body.name]

        found = {name: placed(body) for name, body in bodies.items()}
        if self.recorded_poses:
            return found
        rows = held_rows(np.stack([*self.values(time).values(), np.zeros(len(time))], axis=1))
        return {name: poses.at(rows) for name, poses in found.items()}

    @cached_property
    def first_poses(self) -> dict[str, ObjectMotion]:
        """Poses at the first tick, as of `poses_at`."""
        return self.poses_at(np.zeros(1))

    def placed(self, ticks: TickInput, motion: Trajectory) -> tuple[Body | HalfSpace, ...]:
        """Return the bodies in the world at the ticks of a motion, which places the frame of their file, or moves it.

        Raises InputError for a free body where the motion moves the object.
        """
        moves = ticks.object_motion is not None
        if moves and any(body.is_free for body in self.solids):
            raise InputError(f"in {motion.name or 'the motion'} the object moves as recorded, so it cannot be free")
        time, values = ticks.time, self.values(ticks.time)
        # Poses of the frame of the file, world.
        steps, frame = (len(time), 1), ticks.object_motion
        if frame is None:
            frame = ObjectMotion(np.tile(motion.object_position, steps), np.tile(motion.object_orientation, steps))
        # A body whose frame is the file's goes as the recording has it, without rounding.
        poses = {name: frame if _is_still(own) else composed(frame, own) for name, own in self.poses_at(time).items()}
        found: dict[str, Body | HalfSpace] = {}
        for body in self.solids:
            driven: BodyMotion = Fixed()
            if moves or body.name in self.recorded_poses or body.name in values:
                own = poses[body.name]
                held = own if moves else own.at(held_rows(np.concatenate(own, axis=1)))
                driven = Driven(held, values.get(body.name))
            bearer = poses[body.bearer] if body.bearer else frame
            found[body.name] = self._placed(body, poses[body.name].at(0), bearer.at(0), driven, values)
        meshes = [one.placed_mesh for one in found.values() if isinstance(one, Body)]
        for body in self.settings:
            if body.plane is not None:
                lowest = min(float(mesh.bounds[0, 2]) for mesh in meshes) - CLEARANCE
                height = lowest if body.plane == "under" else body.plane + float(frame.position[0, 2])
                found[body.name] = HalfSpace(body.name, height, body.friction)
        return tuple(found[body.name] for body in self.settings)

    def _placed(
        self, body: BodySettings, pose: ObjectMotion, bearer: ObjectMotion, moves: BodyMotion, values: Mapping[str, Any]
    ) -> Body:
        """Return a body in the world at its first pose, with that of what bears it; a free one ignores `moves`."""
        joint = None
        if body.joint is not None:
            turn, start = rotation_matrix(bearer.orientation), values.get(body.name, [body.joint.value])
            axis = triple((turn * np.array(body.joint.axis)).sum(axis=1))
            origin = triple((turn * np.array(body.joint.origin)).sum(axis=1) + bearer.position)
            joint = structs.replace(body.joint, axis=axis, origin=origin, start=float(start[0]), motion=None)
        placed = Body(
            name=body.name,
            mesh=self.meshes[body.name],
            tree=self.trees[body.name],
            position=pose.position,
            orientation=pose.orientation,
            motion=moves,
            joint=joint,
            friction=USUAL_FRICTION if body.friction is None else body.friction,
            torsion=body.torsion,
        )
        if not body.is_free:
            return placed
        if body.inertia is None or body.center is None or body.mass is None:
            solid = Free.of_mesh(placed.placed_mesh, mass=body.mass, density=body.density or 1000.0)
            return replace(placed, motion=solid)
        turn = rotation_matrix(pose.orientation)
        inertia = matmul(matmul(turn, np.array(body.inertia)), turn.T)
        center = triple((turn * np.array(body.center)).sum(axis=1) + pose.position)
        return replace(placed, motion=Free(body.mass, center, symmetric(inertia)))


def joined_tree(trees: Sequence[SphereTree], moved: Sequence[RigidMotion], name: str, mesh: Mesh) -> SphereTree:
    """Return the tree over the leaves of trees, each moved as at the first tick of its motion, of bodies of a name.

    `mesh` is that of all bodies.
    """
    centers = [motion.points(tree.leaf_center[None])[0] for motion, tree in zip(moved, trees)]
    radii = np.concatenate([tree.leaf_radius for tree in trees])
    level = max(tree.depth for tree in trees)
    while BRANCHING**level < len(radii):
        level += 1
    covers = {"cover": "outer"} if all(tree.options.get("cover") == "outer" for tree in trees) else {}
    joined = build_hierarchy(np.concatenate(centers), radii, level, BRANCHING)
    return replace(joined, mesh_sha256=mesh.sha256, options={OF_BODIES: name, **covers})


def _place(pose: ObjectMotion) -> tuple[FloatArray, FloatArray]:
    return rotation_matrix(pose.orientation[0]), pose.position[0]


def _is_still(poses: ObjectMotion) -> bool:
    """Return True for a frame that is that of the file at each of its poses."""
    return bool((poses.position == 0.0).all() and (poses.orientation == [1.0, 0.0, 0.0, 0.0]).all())


def _require_apart(bodies: DeclaredBodies) -> None:
    """Raise InputError for bodies that begin inside each other."""
    solids = {name: Solid(mesh.transformed(*_place(bodies.first_poses[name]))) for name, mesh in bodies.meshes.items()}
    joined = {frozenset((body.name, body.bearer)) for body in bodies.solids if body.bearer}
    for (outer, solid), (inner, inner_solid) in combinations(solids.items(), 2):
        hinged = frozenset((outer, inner)) in joined
        most, depth = MOST_JOINED_OVERLAP if hinged else MOST_OVERLAP, overlap(solid, inner_solid)
        if depth > most:
            raise InputError(
                f"body '{inner}' begins in body '{outer}': a shift of {1e3 * depth:.3g} mm or more takes them apart; "
                f"expected at most {1e3 * most:g} mm of bodies that {'share a joint' if hinged else 'share no joint'}"
            )


def _of_body_file(word: str, motion: object, solid: bool | None) -> DeclaredBodies:
    """Return the bodies of a TOML file; a script that moves joints does so in place of the file's motions."""
    path = Path(word) if names_a_file(word) else Path(str(files("hhsim.objects") / BODIES / f"{word}.toml"))
    bodies = read_settings(path, BodyFile, "file of bodies").body
    joints = {body.name: body.joint.read(path.parent) for body in bodies if body.joint}
    with named(word):
        if not joints:
            _require_no_joints(motion, path.stem)
        joints |= _moved(joints, motion, {name: name for name in joints})
        settings = BodyFile(tuple(structs.replace(body, joint=joints.get(body.name)) for body in bodies)).body
        meshes = {body.name: _mesh(body, path.parent, solid) for body in settings if body.plane is None}
        recorded_poses = {body.name: body.poses.read(path.parent) for body in settings if body.poses}
    return DeclaredBodies(path.stem, settings, meshes, recorded_poses=recorded_poses)


def _mesh(body: BodySettings, folder: Path, solid: bool | None) -> Mesh:
    """Load the mesh of a body, in its own frame [m]; InputError names the body."""
    if body.box is not None:
        return box_mesh(body.box, body.name)
    known = body.mesh in object_names()
    solid = True if solid is None and body.is_free else solid
    with named(f"body '{body.name}'"):
        mesh, _ = resolve_object(body.mesh if known else folder / body.mesh, body.unit, solid=solid)
    return replace(mesh, name=body.name)


def linkage_bodies(
    path: Path, motion: object = None, *, free: Mapping[str, Any] | None = None, solid: bool | None = None
) -> tuple[tuple[BodySettings, ...], dict[str, Mesh]]:
    """Return the links of a URDF or MJCF file as bodies, and their meshes [m] by their names, each in its own frame.

    What hangs on no joint stands still, or is free with `--free`, unless the file fixes it to the world: in a URDF by a
    link named `world`, in an MJCF that has joints by having none itself. A joint follows the motion where that has
    values for its name or its link's, or where both have one joint alone. Any other one stands where the file begins,
    at the value nearest to 0 within its limits (URDF) or at its ref (MJCF), or is free with `--free`.

    Args:
        path: The file.
        motion: A script may move joints.
        free: None where everything stands but what the motion moves; else `mass`, `density`, `friction`, `torsion` of
            the only link in place of the file's [kg, kg/m³, 1, m], and `table`: under, none, or a height [m].
        solid: As for `load_object`.

    Raises:
        InputError: As `read_linkage`; values of joints beyond their limits, driven joints on what is free, or `free`
            properties of one body where there are several.
    """
    linkage = read_linkage(path)
    with named(path):
        given = dict(free or {})
        table = given.pop("table", None)
        if given and len(linkage.links) > 1:
            raise InputError(f"{next(iter(given))} is of one body; it has {len(linkage.links)}, which state their own")
        own = {child: _settings(joint) for child, joint in linkage.joint_of.items() if joint.type != "free"}
        words = {linkage.joint_of[child].name: child for child in own} | {child: child for child in own}
        named_by = list(dict(getattr(motion, "joints", ())))
        if len(named_by) == len(own) == 1:
            words.setdefault(named_by[0], *own)
        # A joint that nothing moves stands by a motion of one value.
        standing = {child: joint.moved(((0.0, joint.value),)) for child, joint in own.items() if free is None}
        joints = {**own, **standing, **_moved(own, motion, words)}
        bodies = [_of_link(linkage, link, joints, free is not None, given) for link in linkage.links]
        if free is not None:
            if not any(body.is_free for body in bodies):
                raise InputError("nothing is free: its links are fixed to the world, or moved by the motion")
            usual = (NONE if linkage.on_world else UNDER) if linkage.table is None else linkage.table
            plane: Any = usual if table is None else table
            if plane != NONE:
                name = "table" if all(body.name != "table" for body in bodies) else "table-under-all"
                bodies.append(BodySettings(name=name, plane=plane))
        solids = {body.name for body in bodies if solid or (solid is None and body.is_free)}
        meshes = {link.name: link_mesh(link, str(path), link.name in solids or solid) for link in linkage.links}
        first = linkage.links[0].name
        meshes[first] = replace(meshes[first], warnings=(*meshes[first].warnings, *linkage.notes))
        return BodyFile(tuple(bodies)).body, meshes


def _moved(joints: Mapping[str, Joint], motion: object, words: Mapping[str, str]) -> dict[str, Joint]:
    """Return the joints that a script moves by its `words`, which mean the names of their bodies.

    Raises UnknownNameError for another word, InputError for values beyond the limits.
    """
    given: Mapping[str, Sequence[Keyframe]] = dict(getattr(motion, "joints", ()))
    check_known("joint", given, words)
    found: dict[str, Joint] = {}
    for word, keyframes in given.items():
        with named(f"joint '{word}'"):
            found[words[word]] = joints[words[word]].moved(keyframes)
    return found


def _of_link(
    linkage: Robot, link: Link, joints: Mapping[str, Joint], free: bool, given: Mapping[str, Any]
) -> BodySettings:
    joint, own = linkage.joint_of.get(link.name), link.inertial
    frame = HERE if joint is None else joint.frame
    about: dict[str, Any] = {"friction": link.friction, "torsion": link.torsion or 0.0}
    if own is not None and not {"mass", "density"} & set(given):
        about["mass"] = own.mass
        if own.center is not None and own.inertia is not None:
            about |= {"center": triple(own.center), "inertia": symmetric(own.inertia)}
    about |= given
    if joint is None or joint.type == "free":
        about["fixed"] = not free or (joint is None and linkage.on_world)
    else:
        about["joint"] = joints[link.name]
    w, x, y, z = quaternion_from_matrix(frame.rotation).tolist()
    about |= {"position": triple(frame.position), "orientation": (w, x, y, z)}
    return BodySettings(name=link.name, mesh=link.name, **about)


def _settings(joint: LinkJoint) -> Joint:
    return Joint(
        type="slider" if joint.type == "slider" else "hinge",
        axis=triple(joint.axis),
        origin=triple(joint.origin),
        on=joint.parent,
        limits=joint.limits,
        friction=joint.friction,
        start=joint.start,
    )


def _require_no_joints(motion: object, word: str) -> None:
    """Raise InputError for a script that moves joints, on an object that has none."""
    if names := ", ".join(dict(getattr(motion, "joints", ()))):
        raise InputError(f"{getattr(motion, 'name', 'the motion')} moves the joint {names}; {word} has none")


def load_object(
    object_: str | Path | Mesh,
    motion: object = None,
    *,
    unit: str | None = None,
    size: float | None = None,
    solid: bool | None = None,
    free: Mapping[str, Any] | None = None,
) -> DeclaredBodies:
    """Load what OBJECT means: a name of the catalogue, a mesh file, a URDF or MJCF, a file of bodies, or a mesh [m].

    Joints are moved by the motion, if it is a script that has some. `free` is of a URDF or MJCF, see `linkage_bodies`.
    `unit` and `size` are of a mesh file, see `hhsim.linkage.file.resolve_object`; `solid` is as for
    `hhsim.mesh.mesh.load_mesh`, but None makes solids of free bodies. Raises UnknownNameError for no such object, mesh
    or joint; InputError for a file that cannot be used, or bodies that begin inside each other.
    """
    if isinstance(object_, Mesh):
        return DeclaredBodies.of_mesh(object_)
    word = str(object_)
    if not names_a_linkage(object_) and not names_a_body_file(word):
        mesh, level = resolve_object(object_, unit, size, solid)
        _require_no_joints(motion, word)
        return DeclaredBodies.of_mesh(mesh, level=level)
    if unit is not None or size is not None:
        raise InputError(f"unit and size are for mesh files; {object_} has its size")
    if names_a_linkage(object_):
        settings, meshes = linkage_bodies(Path(word), motion, free=free, solid=solid)
        found = DeclaredBodies(Path(word).stem, settings, meshes)
    else:
        found = _of_body_file(word, motion, solid)
    # Where corners meet each other the leaves count no more.
    many = solid is not False and len(found.solids) > 1 and any(body.is_free for body in found.solids)
    found = replace(found, level=LEVEL_OF_MANY if many else MESH_LEVEL)
    with named(object_):
        _require_apart(found)
    return found
