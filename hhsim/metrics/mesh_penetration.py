"""Contact points of a stored hand, and its distance and theirs to the object's true mesh: exact but slow.

Spheres that reach out of the mesh hold the hand off.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand, stored_hands
from hhsim.kernels.contact.contact_points import find_contact_pairs
from hhsim.kernels.contact.mesh_distance import hand_mesh_distances
from hhsim.kernels.contact.surface import ContactPoints
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.jit import as_argument
from hhsim.kernels.mesh.bvh import MeshBvh, mesh_signed_distance

RESOLUTION = 1e-4
"""Length of the pieces of a phalanx's axis where it is nearest [m]."""
FAR = 0.02
"""Largest distance that is looked for [m]."""
MOST_CONTACT_ERROR = 1e-3
"""Distance of contacts from the mesh above which a warning is given [m]: a user sees the gap."""
CAPACITY = 64
"""Initial capacity for the pairs of a tick."""
MOST_TICKS = 4000
"""Number of ticks in contact that are examined at most, spread evenly: recordings last minutes."""


def find_contact_points(
    surface: Any,
    shape: HandShape,
    placed: PlacedHand,
    touch: float,
    *,
    chosen: ArrayLike | None = None,
    fingers: ArrayLike | None = None,
) -> ContactPoints:
    """Find all pairs of a hand body and a piece of the surface no more than `touch` [m] apart, or inside each other.

    What contacts/touching of a result counts is within `SolverOptions.touch`. Hands and surface are in the world;
    `chosen` are the ticks to examine, in order, `fingers` those that count, shape (5,): None for all.
    """
    ticks = np.arange(len(placed.joints)) if chosen is None else np.ascontiguousarray(chosen, np.int64)
    counted = np.ones(5, np.bool_) if fingers is None else np.asarray(fingers, np.bool_)
    shape, placed = HandShape(*map(as_argument, shape)), PlacedHand(*map(as_argument, placed))
    count, capacity = -1, max(CAPACITY, 4 * len(ticks))
    while count < 0:
        capacity *= 4
        columns = [np.empty((capacity, 3)) for _ in range(2)]
        pairs = ContactPoints(np.empty(capacity, np.int64), np.empty(capacity, np.int64), *columns)
        count = find_contact_pairs(shape, surface, ticks, *placed, counted, float(touch), pairs)
    return ContactPoints._make(column[:count] for column in pairs)


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
