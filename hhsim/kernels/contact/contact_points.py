"""Penetration and contact points of stored hands, measured apart from the solver.

The paper (Section V-D) defines penetration as the biggest one between the graphic finger and the object's spheres in a
cycle; here the palm counts too. Phalanges are placed by their stored joints.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.surface import ContactPoints, Walk, cone_contacts, cone_distance
from hhsim.kernels.hand.hand_shape import HandShape, StoredHands, stored_phalanx
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PALM_BODY, PHALANX_COUNT, placed_sphere
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.round_cone import RoundCone
from hhsim.kernels.sphere_tree import STACK_SIZE

SURE = 1e-12
"""Tolerance of distances, well above their rounding [m]."""
RESERVE = 2e-3
"""Distance beyond the limit up to which a part is measured [m]: until it has moved so far it need not be again."""
_PHALANGES = FINGER_COUNT * PHALANX_COUNT


@jit
def _placed_part(
    shape: HandShape, joints: Array, position: Array, rotation: Array, part: int
) -> tuple[RoundCone, tuple[float, float, float, float, float, float]]:
    """Return a phalanx, or a sphere of the palm after these, and the centres of its ends [m]."""
    if part < _PHALANGES:
        f, k = part // PHALANX_COUNT, part % PHALANX_COUNT
        cone, b = stored_phalanx(shape, joints, f, k), joints[f, k + 1]
        return cone, (cone.x, cone.y, cone.z, b[0], b[1], b[2])
    c = shape.palm_center[part - _PHALANGES]
    cone = placed_sphere(position, rotation, c[0], c[1], c[2], shape.palm_radius[part - _PHALANGES])
    return cone, (cone.x, cone.y, cone.z, cone.x, cone.y, cone.z)


@jit
def _farthest_moved(ends: tuple[float, float, float, float, float, float], seen: Array) -> float:
    """Compute the larger distance [m] of the ends of a body from where they were last tested."""
    first = (ends[0] - seen[0]) ** 2 + (ends[1] - seen[1]) ** 2 + (ends[2] - seen[2]) ** 2
    last = (ends[3] - seen[3]) ** 2 + (ends[4] - seen[4]) ** 2 + (ends[5] - seen[5]) ** 2
    return math.sqrt(max(first, last))


@jit_allocating
def clearances(surface: Any, hand: StoredHands, limit: float, palm_out: Array, finger_out: Array) -> None:
    """Compute the least signed distances [m] of palm, (T,), and fingers, (T, 5), up to `limit`; NaN for a bad pose.

    A part that was farther than the limit is measured again after its ends have moved by the excess, as in
    `find_contact_pairs`.
    """
    shape, joints, position, rotation = hand
    stack = np.empty(STACK_SIZE, dtype=np.int64)
    parts = _PHALANGES + shape.palm_radius.shape[0]
    free, seen = np.full(parts, -1.0), np.zeros((parts, 6))
    for tick in range(joints.shape[0]):
        palm_out[tick] = limit
        finger_out[tick, :] = limit
        for part in range(parts):
            f = part // PHALANX_COUNT
            best = finger_out[tick, f] if part < _PHALANGES else palm_out[tick]
            cone, ends = _placed_part(shape, joints[tick], position[tick], rotation[tick], part)
            if math.isnan(cone.x + cone.y + cone.z + cone.length):
                best = np.nan
            elif not math.isnan(best) and _farthest_moved(ends, seen[part]) + SURE >= free[part]:
                start = limit + RESERVE if best == limit else best
                found = cone_distance(surface, cone, start, stack)
                free[part] = found - limit if start > limit else -1.0
                for i in range(6):
                    seen[part, i] = ends[i]
                best = min(best, found)
            if part < _PHALANGES:
                finger_out[tick, f] = best
            else:
                palm_out[tick] = best


@jit_allocating
def find_contact_pairs(
    shape: HandShape,
    surface: Any,
    chosen: Indices,
    joints: Array,
    position: Array,
    orientation: Array,
    fingers: NDArray[np.bool_],
    touch: float,
    pairs_out: ContactPoints,
) -> int:
    """Find the pairs of a hand body and a piece of the surface no more than `touch` [m] apart, or inside each other.

    Ticks are `chosen` in order, and `fingers`, shape (5,), besides the palm. Poses are joints [m], shape (T, 5, 4, 3),
    and the palm's position [m] and orientation (w, x, y, z), world; a body that is not finite has no pair. A body that
    was farther than `touch` from every piece is tested again after its ends have moved by the excess: no point of the
    hull of two spheres moves further. Returns the number of pairs, -1 if they or the walk do not fit.
    """
    walk = Walk(np.empty(STACK_SIZE, np.int64), np.empty(pairs_out.tick.shape[0], np.int64), np.empty(0, np.int64))
    rotation = np.empty((3, 3))
    count = 0
    parts = _PHALANGES + shape.palm_radius.shape[0]
    free, seen = np.full(parts, -1.0), np.zeros((parts, 6))
    for tick in chosen:
        quaternion_to_matrix(orientation[tick], rotation)
        for part in range(parts):
            if part < _PHALANGES and not fingers[part // PHALANX_COUNT]:
                continue
            cone, ends = _placed_part(shape, joints[tick], position[tick], rotation, part)
            if not math.isfinite(cone.x + cone.y + cone.z + cone.length):
                continue
            if _farthest_moved(ends, seen[part]) + SURE < free[part]:
                continue
            after, clearance = cone_contacts(surface, cone, touch, walk, count, pairs_out)
            if after < 0:
                return -1
            free[part] = clearance - touch if after == count else -1.0
            for i in range(6):
                seen[part, i] = ends[i]
            for i in range(count, after):
                pairs_out.tick[i] = tick
                pairs_out.body[i] = min(part, PALM_BODY)
            count = after
    return count
