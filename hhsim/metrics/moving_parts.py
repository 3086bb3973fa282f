"""Parts of a body over time: their surfaces, where they are, and what of a hand is inside them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.input_hand import InputHand, input_hand, object_depths
from hhsim.metrics.mesh_penetration import contact_error, find_contact_points, ticks_looked_at
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.trajectory import RigidMotion
from hhsim.result.reader import Result
from hhsim.result.schema import DRIVEN_COLUMNS
from hhsim.trees.contact_surface import ContactSurface, contact_surface, jointed_surface
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True, eq=False)
class MovingParts:
    """P rigid parts at T ticks."""

    name: str  # of the body
    names: tuple[str, ...]  # of the parts
    meshes: tuple[Mesh, ...]  # each part's own, in its frame [m]
    trees: tuple[SphereTree, ...]
    world: FloatArray  # position [m] and orientation (w, x, y, z) of each part at each tick, world, (T, P, 7)
    values: Mapping[str, FloatArray]  # of each joint at each tick [rad] or [m], (T,), by the name of its part
    # Motion of the whole body, or of the first one, since the first tick; None where joints alone move.
    carried: RigidMotion | None = None
    free: bool = False  # True for several bodies, each of which goes its own way
    # Motion since the first tick that a driven one of several bodies is to make, world, by its name.
    driven: Mapping[str, RigidMotion] = field(default_factory=dict)

    @cached_property
    def path(self) -> FloatArray:
        """Poses as `world` in the scene's frame, which moves with the whole body; the same wherever the joints are."""
        if self.carried is None:
            return self.world
        moved, joints = self.carried, np.stack([*self.values.values(), np.zeros(len(self.world))], axis=1)
        seen = [
            np.concatenate([moved.seen_points(pose[:, :3]), moved.seen_orientations(pose[:, 3:])], axis=1)
            for pose in self.world.swapaxes(0, 1)
        ]
        rows = slice(None) if self.free else held_rows(joints)
        return np.ascontiguousarray(np.stack(seen, axis=1)[rows])

    def at(self, ticks: slice | IntArray) -> "MovingParts":
        """Return the parts at some ticks."""
        values = {name: values[ticks] for name, values in self.values.items()}
        carried = None if self.carried is None else self.carried.at(ticks)
        driven = {name: motion.at(ticks) for name, motion in self.driven.items()}
        return replace(self, world=self.world[ticks], values=values, carried=carried, driven=driven)

    def motion(self, p: int, ticks: slice = slice(None)) -> RigidMotion:
        """Return the motion of a part's frame in the scene's at some ticks."""
        return RigidMotion(self.path[ticks, p, 3:], self.path[ticks, p, :3])

    def surface(self, kind: str, path: FloatArray | None = None) -> ContactSurface:
        """Return the surface of all parts, `spheres` or `mesh`, and what of them cannot be touched.

        `path` is another way of the parts than theirs, as of `jointed_surface`.
        """
        parts = self.surfaces(kind)
        notes = tuple(f"{name}: {note}" for name, part in zip(self.names, parts) for note in part.notes)
        return ContactSurface(jointed_surface(parts, self.path if path is None else path), notes)

    def surfaces(self, kind: str) -> tuple[ContactSurface, ...]:
        """Return the surface of each part in its frame."""
        if kind not in self._surfaces:
            self._surfaces[kind] = tuple(contact_surface(kind, *of) for of in zip(self.meshes, self.trees))
        return self._surfaces[kind]

    @cached_property
    def _surfaces(self) -> dict[str, tuple[ContactSurface, ...]]:
        """Surfaces so far by their kind: they live as long as the parts."""
        return {}


@dataclass(frozen=True, eq=False)
class TouchedObject:
    """Object on which contacts are looked for, or its parts, and their meshes."""

    mesh: Mesh  # True surface [m], world
    surface: Any  # surface of the solver, world, such as the leaf spheres
    shape: HandShape  # sizes of the hand
    fingers: BoolArray  # True for modelled fingers, shape (5,)
    touch: float  # largest distance of a touching pair [m]
    parts: MovingParts | None = None  # parts in place of mesh and surface; None for an object that stands still
    kind: str = ""  # surface of the parts that is touched

    @property
    def _pieces(self) -> Iterator[tuple[Mesh, Any, RigidMotion | None]]:
        """Mesh, surface and motion of each part, or of the object, which has no motion."""
        if self.parts is None:
            yield self.mesh, self.surface, None
            return
        for p, (mesh, part) in enumerate(zip(self.parts.meshes, self.parts.surfaces(self.kind))):
            yield mesh, part.arrays, self.parts.motion(p)

    def penetration(self, placed: PlacedHand, ticks: slice = slice(None)) -> Penetration:
        """Depths of the hand at some ticks, in its deepest part, as `hhsim.metrics.metrics.penetration`."""
        depths = []
        for _, surface, motion in self._pieces:
            seen = placed if motion is None else motion.at(ticks).seen_hand(placed)
            depths.append(penetration(surface, self.shape, seen, self.fingers))
        return Penetration(*(np.max(values, axis=0) for values in zip(*depths)))

    def input_hand(self, hand: HandModel, haptic: HandConfiguration, shown: PlacedHand, *ticks: BoolArray) -> InputHand:
        """See `hhsim.metrics.input_hand.input_hand`; of parts the depth is the deepest one's, and `free` is NaN."""
        found = []
        for mesh, surface, motion in self._pieces:
            depths, user, graphic = object_depths(surface, mesh, self.shape, self.fingers), haptic, shown
            if motion is not None:
                place, turn = motion.seen_points(haptic.position), motion.seen_orientations(haptic.orientation)
                user, graphic = haptic._replace(position=place, orientation=turn), motion.seen_hand(shown)
            found.append(input_hand(hand, depths, user, graphic, *ticks))
        if self.parts is None:
            return found[0]
        return found[0]._replace(depth=max(each.depth for each in found), free=np.nan)

    def contact_error(self, placed: PlacedHand, contact: BoolArray) -> FloatArray:
        """Largest distance of a contact point of each tick from the mesh [m], shape (T,).

        NaN without contact and in ticks that are not examined. A contact point is the point of a hand body nearest to a
        touched piece of the surface. `placed` is the shown hand [m], world; `contact` has the ticks where something may
        touch, shape (T,).
        """
        error, chosen = np.full(len(contact), np.nan), ticks_looked_at(contact)
        for mesh, surface, motion in self._pieces if chosen.size else ():
            seen = placed if motion is None else motion.seen_hand(placed)
            found = find_contact_points(surface, self.shape, seen, self.touch, chosen=chosen, fingers=self.fingers)
            if len(found.tick):
                # A hand at rest touches at the same points over and over.
                points, place = np.unique(np.round(found.point, 12), axis=0, return_inverse=True)
                bvh = build_mesh_bvh(mesh.vertices, mesh.faces, signed=False)
                error[found.tick] = np.fmax(error[found.tick], 0.0)
                np.maximum.at(error, found.tick, contact_error(bvh, points)[place.ravel()])
        return error


def placed_mesh(meshes: Sequence[Mesh], moved: Sequence[RigidMotion], name: str = "object") -> Mesh:
    """Return meshes as one, each moved as at the first tick of its motion."""
    vertices = [motion.points(mesh.vertices[None])[0] for motion, mesh in zip(moved, meshes)]
    first = np.cumsum([0, *map(len, vertices)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first)])
    warnings = tuple(dict.fromkeys(warning for mesh in meshes for warning in mesh.warnings))
    return Mesh(np.concatenate(vertices), faces, name=name, source="parts", warnings=warnings)


def bodies_mesh(result: Result) -> Mesh:
    """Return the meshes of a result's bodies as one, where they are at the first tick, world."""
    bodies = list(result.bodies.values())
    if len(bodies) == 1:
        return bodies[0].mesh
    return placed_mesh(
        [body.mesh for body in bodies], [body.moved(slice(1)) for body in bodies], str(result.scene["object_name"])
    )


def held_rows(values: FloatArray) -> IntArray:
    """Return for each row, (T, ...), the first of those right before that it equals: poses of one value are one."""
    flat = values.reshape(len(values), -1)
    changed = np.ones(len(flat), bool)
    changed[1:] = (flat[1:] != flat[:-1]).any(axis=1)
    return np.maximum.accumulate(np.where(changed, np.arange(len(flat)), 0))


def result_parts(result: Result) -> MovingParts | None:
    """Return the bodies of a result that has several; None for one. InputError for arrays of no tree."""
    if len(result.bodies) == 1:
        return None
    bodies = list(result.bodies.values())
    meshes, trees = tuple(body.mesh for body in bodies), tuple(body.tree for body in bodies)
    joints = {body.name: body["joint"] for body in bodies if "joint" in body}
    driven = {
        body.name: RigidMotion(*(np.asarray(body[column.name]) for column in DRIVEN_COLUMNS))
        for body in bodies
        if DRIVEN_COLUMNS[0].name in body
    }
    world = np.stack([np.concatenate(body.poses(), axis=1) for body in bodies], axis=1)
    carried = result.moved_since_first() if result.frame else None
    name = str(result.scene["object_name"])
    return MovingParts(name, tuple(result.bodies), meshes, trees, world, joints, carried, result.body.is_free, driven)
