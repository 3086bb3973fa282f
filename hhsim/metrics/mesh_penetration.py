"""Distance of the graphic hand, and of its contacts, to the object's true mesh: exact but slow.

Spheres that reach out of the mesh hold the hand off.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand, stored_hands
from hhsim.kernels.contact.mesh_distance import hand_mesh_distances
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.metrics import Penetration, penetration

RESOLUTION = 1e-4
"""Length of the pieces of a phalanx's axis where it is nearest [m]."""
FAR = 0.02
"""Largest distance that is looked for [m]."""
MOST_CONTACT_ERROR = 1e-3
"""Distance of contacts from the mesh above which a warning is given [m]: a user sees the gap."""
MOST_TICKS = 4000
"""Number of ticks in contact that are examined at most, spread evenly: recordings last minutes."""


def mesh_clearance(bvh: MeshBvh, shape: HandShape, placed: PlacedHand, limit: float = FAR) -> FloatArray:
    """Least signed distance [m] of the hand to the mesh at each tick, shape (T,), negative inside, at most `limit` [m].

    Its negative is the design's mesh penetration: the depth of the hand's deepest point while the object is thicker
    than that, and an upper bound beyond. Above the true value by less than 1 µm where the axes of the phalanges are
    outside, by at most 0.05 mm where one is inside. `bvh` is that of the object's closed mesh, world.
    """
    distance = np.empty(len(placed.joints))
    hand_mesh_distances(stored_hands(shape, placed), bvh, float(limit), RESOLUTION, distance)
    return distance


def contact_error(bvh: MeshBvh, points: ArrayLike) -> FloatArray:
    """Distances of contact points, shape (n, 3) [m], from the mesh [m], shape (n,)."""
    return np.abs(mesh_signed_distance(bvh, np.ascontiguousarray(points, np.float64)))


def sampled(ticks: IntArray, count: int, also: Sequence[int] = ()) -> IntArray:
    """Return `count` of some ticks, evenly spread with both ends, or all if there are fewer; and `also`."""
    spread = ticks[np.linspace(0, ticks.size - 1, min(count, ticks.size)).astype(int)] if ticks.size else ticks
    return np.unique(np.concatenate([spread, np.array(also, np.int64)]).astype(np.int64))


def ticks_looked_at(contact: BoolArray) -> IntArray:
    """Examined ticks, ascending: all in contact (mask (T,)), or `MOST_TICKS` of them, spread evenly."""
    return sampled(np.flatnonzero(contact), MOST_TICKS)


@dataclass(frozen=True, eq=False)
class TouchedObject:
    """Object on which contacts are looked for, and its mesh."""

    mesh: Mesh  # True surface [m], world
    surface: Any  # surface of the solver, world, such as the leaf spheres
    shape: HandShape  # sizes of the hand
    fingers: BoolArray  # True for modelled fingers, shape (5,)
    touch: float  # largest distance of a touching pair [m]

    def penetration(self, placed: PlacedHand, ticks: slice = slice(None)) -> Penetration:
        """Depths of the hand at some ticks in the surface, as `hhsim.metrics.metrics.penetration`."""
        return penetration(self.surface, self.shape, placed, self.fingers)

    def contact_error(self, placed: PlacedHand, contact: BoolArray) -> FloatArray:
        """Largest distance of a contact point of each tick from the mesh [m], shape (T,).

        NaN without contact and in ticks that are not examined. A contact point is the point of a hand body nearest to a
        touched piece of the surface. `placed` is the shown hand [m], world; `contact` has the ticks where something may
        touch, shape (T,).
        """
        error = np.full(len(contact), np.nan)
        chosen = ticks_looked_at(contact)
        if chosen.size == 0:
            return error
        found = find_contact_points(self.surface, self.shape, placed, self.touch, chosen=chosen, fingers=self.fingers)
        if len(found.tick) == 0:
            return error
        # A hand at rest touches at the same points over and over.
        points, place = np.unique(np.round(found.point, 12), axis=0, return_inverse=True)
        bvh = build_mesh_bvh(self.mesh.vertices, self.mesh.faces, signed=False)
        error[found.tick] = 0.0
        np.maximum.at(error, found.tick, contact_error(bvh, points)[place.ravel()])
        return error
