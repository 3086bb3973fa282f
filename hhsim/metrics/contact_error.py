"""Distance of a run's contacts to the object's true mesh: spheres that reach out of it hold the hand off."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.contact_points import find_contact_points

MOST_CONTACT_ERROR = 1e-3
"""Distance of contacts from the mesh above which a warning is given [m]: a user sees the gap."""
MOST_TICKS = 4000
"""Number of ticks in contact that are examined at most, spread evenly: recordings last minutes."""


def ticks_looked_at(contact: BoolArray) -> IntArray:
    """Examined ticks, ascending: all in contact (mask (T,)), or `MOST_TICKS` of them, spread evenly."""
    near = np.flatnonzero(contact)
    if near.size == 0:
        return near
    return np.unique(near[np.linspace(0, near.size - 1, min(MOST_TICKS, near.size)).astype(int)])


@dataclass(frozen=True, eq=False)
class TouchedObject:
    """Object on which contacts are looked for, and its mesh."""

    mesh: Mesh  # True surface [m], world
    surface: Any  # surface of the solver, world, such as the leaf spheres
    shape: HandShape  # sizes of the hand
    fingers: BoolArray  # True for modelled fingers, shape (5,)
    touch: float  # largest distance of a touching pair [m]

    def contact_error(self, placed: PlacedHand, contact: BoolArray) -> FloatArray:
        """Largest distance of a contact point of each tick from the mesh [m], shape (T,).

        NaN without contact and in ticks that are not examined. A contact point is the point of a hand body nearest to a
        touched piece of the surface.

        Args:
            placed: Shown hand at each of T ticks [m], world.
            contact: Ticks where something may touch, shape (T,).
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
        distance = np.abs(mesh_signed_distance(bvh, points))[place.ravel()]
        error[found.tick] = 0.0
        np.maximum.at(error, found.tick, distance)
        return error
