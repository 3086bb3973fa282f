"""The graphic hand against the object's true mesh: what a sphere model does not say of itself.

By hhsim's own distance kernels, not by an independent library. Exact but slow, so a run is looked at in some ticks.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.contact.mesh_distance import hand_mesh_distances
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.jit import as_argument
from hhsim.kernels.mesh.bvh import MeshBvh, mesh_signed_distance

RESOLUTION = 1e-4
"""Length of the pieces that a phalanx's axis is cut into where it is nearest [m]."""
FAR = 0.02
"""Distances from here on are not looked for [m]."""


class ContactError(NamedTuple):
    """Distance of contact points from the mesh [m]: mean and maximum of all, NaN without any; and how many."""

    mean: float
    max: float
    points: int


def mesh_clearance(bvh: MeshBvh, shape: HandShape, placed: PlacedHand, limit: float = FAR) -> FloatArray:
    """Least signed distance [m] of the hand to the mesh at each tick, shape (T,), negative inside.

    Its negative is the design's mesh penetration: the depth of the deepest point of the hand's surface, as long as the
    object is thicker than that, and beyond an upper bound of it. Above the true value by less than 1 µm where the axes
    of the phalanges are outside, by no more than 0.05 mm where one is inside.

    Args:
        bvh: Of the object's closed mesh, world.
        limit: Stands for everything from here on [m].
    """
    distance = np.empty(len(placed.joints))
    radius, palm_center, palm_radius = map(as_argument, shape)
    hand_mesh_distances(
        radius,
        palm_center,
        palm_radius,
        bvh,
        placed.joints,
        placed.position,
        rotation_matrix(placed.orientation),
        float(limit),
        RESOLUTION,
        distance,
    )
    return distance


def contact_error(bvh: MeshBvh, points: ArrayLike) -> ContactError:
    """How far contact points, shape (n, 3) [m], are from the mesh."""
    array = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
    if len(array) == 0:
        return ContactError(np.nan, np.nan, 0)
    distance = np.abs(mesh_signed_distance(bvh, array))
    return ContactError(float(distance.mean()), float(distance.max()), len(array))
