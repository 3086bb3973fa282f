"""Parts of a thing in a scene: meshes, sphere trees, and poses at each tick."""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from itertools import combinations
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.linkage.object_mesh import resolve_object
from hhsim.mesh.catalogue import THINGS, names_a_file, object_names, thing_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts, held_rows, placed_mesh
from hhsim.motion.trajectory import RigidMotion, TickInput, Trajectory
from hhsim.scene.jointed_thing import JointedThing, Keyframe, Shape, read_jointed_thing
from hhsim.scene.overlap import Solid, overlap
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.sphere_tree import SphereTree

MOST_OVERLAP, MOST_JOINED_OVERLAP = 1e-4, 1e-3
"""Largest depth [m] of a part in another at the first tick, and in one that it hangs on: hinges are drawn roughly."""
BRANCHING = 8
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
"""Corners of a cube of edge 1 about the origin, and its triangles."""


def box_mesh(edges: Sequence[float], name: str = "") -> Mesh:
    """Return a box about the origin by its edges [m]."""
    return Mesh(_CORNERS * np.asarray(edges, np.float64), _SIDES, name=name, source="box")


@dataclass(frozen=True, eq=False)
class ThingParts:
    """A thing with the meshes of its parts, in their frames [m] and in the order of the parts."""

    name: str
    thing: JointedThing
    meshes: tuple[Mesh, ...]

    @cached_property
    def _begin(self) -> list[RigidMotion]:
        return [RigidMotion(pose[:, 3:], pose[:, :3]) for pose in self.path(np.zeros(1)).swapaxes(0, 1)]

    def path(self, time: FloatArray) -> FloatArray:
        """Return position [m] and orientation of each part in the thing's frame at these times [s], (T, P, 7)."""
        values = self.thing.joint_values(time)
        poses = [np.concatenate(pose, axis=1) for pose in self.thing.poses(values).values()]
        rows = np.broadcast_to(np.stack(poses, axis=1), (len(time), len(poses), 7))
        joints = np.stack([*values.values(), np.zeros(len(time))], axis=1)
        return np.ascontiguousarray(rows[held_rows(joints)])

    @cached_property
    def mesh(self) -> Mesh:
        """All parts where they are at the first tick, as one mesh."""
        return placed_mesh(self.meshes, self._begin, self.name)

    def tree(self, trees: Sequence[SphereTree]) -> SphereTree:
        """Return the tree over the leaves of all parts where they are at the first tick."""
        centers = [moved.points(tree.leaf_center[None])[0] for moved, tree in zip(self._begin, trees)]
        radii = np.concatenate([tree.leaf_radius for tree in trees])
        level = max(tree.depth for tree in trees)
        while BRANCHING**level < len(radii):
            level += 1
        covers = {"cover": "outer"} if all(one.options.get("cover") == "outer" for one in trees) else {}
        tree = build_hierarchy(np.concatenate(centers), radii, level, BRANCHING)
        return replace(tree, mesh_sha256=self.mesh.sha256, options={"thing": self.name, **covers})

    def begun(self, time: float) -> "ThingParts":
        """Return the thing as it moves from a time [s] on, which becomes 0 s."""
        joints = {part.name: part.joint.motion or () for part in self.thing.part if part.joint}
        moved = {name: [(at - time, value) for at, value in motion] for name, motion in joints.items()}
        return replace(self, thing=self.thing.moved(moved))

    def require_apart(self) -> None:
        """Raise InputError for parts that begin inside each other."""
        joined = {frozenset((part.name, part.parent)) for part in self.thing.part if part.parent}
        placed = [placed_mesh([mesh], [moved], mesh.name) for mesh, moved in zip(self.meshes, self._begin)]
        require_apart([part.name for part in self.thing.part], placed, joined)

    def trees(self, make: Callable[[Mesh], SphereTree]) -> tuple[SphereTree, ...]:
        """Return the sphere tree of each part, those of equal meshes made once."""
        made = {mesh.sha256: make(mesh) for mesh in self.meshes}
        return tuple(made[mesh.sha256] for mesh in self.meshes)

    def moving(self, trees: Sequence[SphereTree], ticks: TickInput, where: Trajectory) -> MovingParts:
        """Return the parts at the ticks of a motion, of a thing that is where it begins, or goes where it is moved."""
        time, motion = ticks.time, ticks.object_motion
        path = self.path(time)
        rows = held_rows(path)
        turn = np.broadcast_to(where.object_orientation, (len(path), 4))
        frame = RigidMotion(turn, np.broadcast_to(where.object_position, (len(path), 3)))
        placed = [
            np.concatenate([frame.points(path[:, p, :3]), frame.orientations(path[:, p, 3:])], axis=1)
            for p in range(path.shape[1])
        ]
        names = tuple(part.name for part in self.thing.part)
        path, carried = np.ascontiguousarray(np.stack(placed, axis=1)[rows]), None
        if motion is not None:
            carried = motion.since(motion.position[0], motion.orientation[0])
            for p in range(path.shape[1]):
                path[:, p, :3], path[:, p, 3:] = carried.points(path[:, p, :3]), carried.orientations(path[:, p, 3:])
        return MovingParts(self.name, names, self.meshes, tuple(trees), path, self.thing.joint_values(time), carried)


def require_apart(names: Sequence[str], meshes: Sequence[Mesh], joined: Container[frozenset[str]] = ()) -> None:
    """Raise InputError for meshes in the world that begin inside each other; `joined` has those that share a joint."""
    solids = [Solid(mesh) for mesh in meshes]
    for (one, solid), (other, its) in combinations(zip(names, solids), 2):
        hinged = frozenset((one, other)) in joined
        most, depth = MOST_JOINED_OVERLAP if hinged else MOST_OVERLAP, overlap(solid, its)
        if depth > most:
            raise InputError(
                f"part '{other}' begins {1e3 * depth:.3g} mm inside part '{one}'; expected at most "
                f"{1e3 * most:g} mm of parts that {'share a joint' if hinged else 'share no joint'}"
            )


def load_thing(word: str | Path, motion: object = None, *, solid: bool = True) -> ThingParts:
    """Load a thing of several parts and their meshes, moved by the motion's joints if it is a script that has some.

    `word` is a name of the catalogue, or a TOML file; without `solid` the triangles of mesh files are taken as they
    are. Raises UnknownNameError for no such thing, mesh, or joint; InputError for a file that cannot be used, or parts
    that begin inside each other.
    """
    path = Path(word)
    if not names_a_file(str(word)):
        check_known("thing", [str(word)], thing_names())
        path = Path(str(files("hhsim.objects") / THINGS / f"{word}.toml"))
    thing = read_jointed_thing(path)
    with named(word):
        thing = thing.moved(dict(getattr(motion, "joints", ())))
        found = ThingParts(path.stem, thing, tuple(shape_mesh(part, path.parent, solid) for part in thing.part))
        found.require_apart()
    return found


def shape_mesh(part: Shape, folder: Path, solid: bool) -> Mesh:
    """Load the mesh of a shape, in its own frame [m]; InputError names the part."""
    if part.box is not None:
        return box_mesh(part.box, part.name)
    known = part.mesh in object_names()
    with named(f"part '{part.name}'"):
        mesh, _ = resolve_object(part.mesh if known else folder / part.mesh, part.unit, solid=solid)
    return replace(mesh, name=part.name)


def require_no_joints(motion: object, word: str) -> None:
    """Raise InputError for a script that moves joints, on an object that has none."""
    joints: Sequence[tuple[str, Sequence[Keyframe]]] = getattr(motion, "joints", ())
    if joints:
        names = ", ".join(name for name, _ in joints)
        raise InputError(f"{getattr(motion, 'name', 'the motion')} moves the joint {names}; {word} has none")
