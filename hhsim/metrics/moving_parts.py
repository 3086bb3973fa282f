"""Parts of a thing over time: their surfaces, where they are, and what of a hand is inside them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import TouchedObject
from hhsim.metrics.metrics import Penetration, penetration
from hhsim.motion.object_motion import ObjectMotion, RigidMotion
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.jointed_surface import jointed_surface
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True, eq=False)
class MovingParts:
    """P rigid parts at T ticks.

    Attributes:
        name: Of the thing.
        names: Of the parts.
        meshes, trees: Each part's own, in its frame [m].
        path: Position [m] and orientation (w, x, y, z) of each part at each tick, in the scene's frame, (T, P, 7).
        values: Of each joint at each tick [rad] or [m], (T,), by the name of its part.
    """

    name: str
    names: tuple[str, ...]
    meshes: tuple[Mesh, ...]
    trees: tuple[SphereTree, ...]
    path: FloatArray
    values: Mapping[str, FloatArray]

    def pose(self, p: int) -> ObjectMotion:
        """Return the poses of a part in the scene's frame."""
        return ObjectMotion(self.path[:, p, :3], self.path[:, p, 3:])

    def surface(self, kind: str) -> ContactSurface:
        """Return the surface of all parts, `spheres` or `mesh`, and what of them cannot be touched."""
        parts = self.surfaces(kind)
        notes = tuple(f"{name}: {note}" for name, part in zip(self.names, parts) for note in part.notes)
        return ContactSurface(jointed_surface([part.arrays for part in parts], self.path), notes)

    def surfaces(self, kind: str) -> tuple[ContactSurface, ...]:
        """Return the surface of each part in its frame."""
        if kind not in self._surfaces:
            self._surfaces[kind] = tuple(contact_surface(kind, *of) for of in zip(self.meshes, self.trees))
        return self._surfaces[kind]

    @cached_property
    def _surfaces(self) -> dict[str, tuple[ContactSurface, ...]]:
        """Surfaces so far by their kind: they live as long as the parts."""
        return {}

    def seen(self, p: int, hand: PlacedHand, ticks: slice = slice(None)) -> PlacedHand:
        """Return the hand at some ticks as a part sees it."""
        pose = self.pose(p).at(ticks)
        moved = RigidMotion(pose.orientation, pose.position)
        joints, position = moved.seen_points(hand.joints), moved.seen_points(hand.position)
        return PlacedHand(joints, position, moved.seen_orientations(hand.orientation))

    def penetration(
        self, kind: str, shape: HandShape, hand: PlacedHand, fingers: BoolArray, ticks: slice
    ) -> Penetration:
        """Compute depths in the part that a hand is deepest in, as `hhsim.metrics.metrics.penetration`."""
        depths = [
            penetration(part.arrays, *shape, *self.seen(p, hand, ticks), fingers)
            for p, part in enumerate(self.surfaces(kind))
        ]
        return Penetration(*(np.max(values, axis=0) for values in zip(*depths)))


@dataclass(frozen=True, eq=False)
class TouchedParts(TouchedObject):
    """Parts on which contacts are looked for."""

    parts: MovingParts
    kind: str  # surface that is touched

    def contact_error(self, placed: PlacedHand, contact: BoolArray) -> FloatArray:
        """See `TouchedObject.contact_error`: the largest of any part."""
        errors = [
            TouchedObject(mesh, part.arrays, self.shape, self.fingers, self.touch).contact_error(
                self.parts.seen(p, placed), contact
            )
            for p, (mesh, part) in enumerate(zip(self.parts.meshes, self.parts.surfaces(self.kind)))
        ]
        found: Any = np.fmax.reduce(errors)
        return np.asarray(found)


def held_rows(values: FloatArray) -> IntArray:
    """Return for each row, (T, ...), the first of those right before that it equals: poses of one value are one."""
    flat = values.reshape(len(values), -1)
    changed = np.ones(len(flat), bool)
    changed[1:] = (flat[1:] != flat[:-1]).any(axis=1)
    return np.maximum.accumulate(np.where(changed, np.arange(len(flat)), 0))
