"""How far the contacts of a run are from the object's true mesh: what a sphere model hides from its own figures.

A hand that rests on spheres which reach out of the mesh floats over what the user sees, with no depth at all.
"""

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
"""Contacts farther from the mesh than this [m] are worth a warning: a user sees the gap."""
MOST_TICKS = 4000
"""Of a run with more ticks in contact, so many are looked at, spread evenly: a recording may be of ten minutes."""


def ticks_looked_at(contact: BoolArray) -> IntArray:
    """The ticks that the figure is of, ascending: all in contact, or `MOST_TICKS` of them, spread evenly.

    Args:
        contact: Ticks where something may touch, shape (T,).
    """
    near = np.flatnonzero(contact)
    if near.size == 0:
        return near
    return np.unique(near[np.linspace(0, near.size - 1, min(MOST_TICKS, near.size)).astype(int)])


@dataclass(frozen=True, eq=False)
class TouchedObject:
    """What contacts are looked for on, and measured against.

    Attributes:
        mesh: The object's true surface [m], world.
        surface: What the solver had for it, world: such as its leaf spheres.
        shape: Sizes of the hand.
        fingers: Which fingers are modelled, shape (5,).
        touch: A body and a piece of the surface no further apart than this touch [m].
    """

    mesh: Mesh
    surface: Any
    shape: HandShape
    fingers: BoolArray
    touch: float

    def contact_error(self, placed: PlacedHand, contact: BoolArray) -> FloatArray:
        """Farthest that a contact point of a tick is from the mesh [m], shape (T,).

        NaN where nothing touches and where nobody looked. A contact point is that of a hand body which is nearest to
        a piece of the surface that it touches.

        Args:
            placed: Where the shown hand is at each of T ticks [m], world.
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
