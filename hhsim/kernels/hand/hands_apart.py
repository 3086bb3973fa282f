"""Distance between two hands of which positions are stored: spheres of the palms, round cones of the phalanges."""

import math

from hhsim.kernels.hand.hand_shape import StoredHands, stored_phalanx
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, placed_sphere
from hhsim.kernels.jit import Array, as_bool, as_int64, jit, jit_allocating
from hhsim.kernels.round_cone_distance import RoundCone
from hhsim.kernels.round_cone_pair import round_cone_pair

PHALANGES = FINGER_COUNT * PHALANX_COUNT


@jit
def _body(hand: StoredHands, tick: int, i: int) -> RoundCone:
    """Return body i of a hand: 15 phalanges, finger by finger, then the spheres of the palm."""
    shape = hand.shape
    if i < PHALANGES:
        return stored_phalanx(shape, hand.joints[tick], i // PHALANX_COUNT, i % PHALANX_COUNT)
    c, radius = shape.palm_center[i - PHALANGES], shape.palm_radius[i - PHALANGES]
    return placed_sphere(hand.position[tick], hand.rotation[tick], c[0], c[1], c[2], radius)


@jit_allocating
def hands_apart(hand: StoredHands, other_hand: StoredHands, out: Array) -> None:
    """Compute the least signed distance [m] of two hands at each tick, (T,), negative inside; NaN where a joint is."""
    count = PHALANGES + hand.shape.palm_radius.shape[0]
    others = PHALANGES + other_hand.shape.palm_radius.shape[0]
    for tick in range(hand.joints.shape[0]):
        best, missing = math.inf, as_bool(False)
        for i in range(count):
            body = _body(hand, tick, as_int64(i))
            for j in range(others):
                other = _body(other_hand, tick, as_int64(j))
                x, y, z = body.x - other.x, body.y - other.y, body.z - other.z
                # Farther by the balls that hold both than the least so far: the exact distance cannot be less.
                far = math.sqrt(x * x + y * y + z * z) - body.length - other.length - body.radius - other.radius
                missing = missing or math.isnan(far)
                if far <= best:
                    best = min(best, round_cone_pair(body, other)[0])
        out[tick] = math.nan if missing else best
