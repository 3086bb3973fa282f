"""Distance of the graphic hand to the object's true mesh by hhsim's own kernels: exact but slow."""

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
"""Length of the pieces of a phalanx's axis where it is nearest [m]."""
FAR = 0.02
"""Largest distance that is looked for [m]."""


class ContactError(NamedTuple):
    """Mean and maximum distance of contact points from the mesh [m], NaN without any; and their number."""

    mean: float
    max: float
    points: int


def mesh_clearance(bvh: MeshBvh, shape: HandShape, placed: PlacedHand, limit: float = FAR) -> FloatArray:
    """Least signed distance [m] of the hand to the mesh at each tick, shape (T,), negative inside, at most `limit` [m].

    Its negative is the design's mesh penetration: the depth of the hand's deepest point while the object is thicker
    than
    that, and an upper bound beyond. Above the true value by less than 1 µm where the axes of the phalanges are outside,
    by
    at most 0.05 mm where one is inside. `bvh` is that of the object's closed mesh, world.
    """
    distance = np.empty(len(placed.joints))
    radius, palm_center, palm_radius = map(as_argument, shape)
    hand = radius, palm_center, palm_radius
    place = placed.joints, placed.position, rotation_matrix(placed.orientation)
    hand_mesh_distances(*hand, bvh, *place, float(limit), RESOLUTION, distance)
    return distance


def contact_error(bvh: MeshBvh, points: ArrayLike) -> ContactError:
    """Distances of contact points, shape (n, 3) [m], from the mesh."""
    array = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
    if len(array) == 0:
        return ContactError(np.nan, np.nan, 0)
    distance = np.abs(mesh_signed_distance(bvh, array))
    return ContactError(float(distance.mean()), float(distance.max()), len(array))
