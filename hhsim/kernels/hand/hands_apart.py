"""Distance between two hands of which positions are stored: spheres of the palms, round cones of the phalanges."""

import math

from hhsim.kernels.hand.hand_shape import HandShape, stored_phalanx
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, placed_sphere
from hhsim.kernels.jit import Array, as_bool, as_int64, jit, jit_allocating
from hhsim.kernels.round_cone_distance import RoundCone
from hhsim.kernels.round_cone_pair import round_cone_pair

PHALANGES = FINGER_COUNT * PHALANX_COUNT


@jit
def _body(shape: HandShape, joints: Array, position: Array, rotation: Array, i: int) -> RoundCone:
    """Return body i of a placed hand: 15 phalanges, finger by finger, then the spheres of the palm."""
    if i < PHALANGES:
        return stored_phalanx(shape, joints, i // PHALANX_COUNT, i % PHALANX_COUNT)
    c = shape.palm_center[i - PHALANGES]
    return placed_sphere(position, rotation, c[0], c[1], c[2], shape.palm_radius[i - PHALANGES])


@jit_allocating
def hands_apart(
    shape: HandShape,
    joints: Array,
    position: Array,
    rotation: Array,
    other_shape: HandShape,
    other_joints: Array,
    other_position: Array,
    other_rotation: Array,
    out: Array,
) -> None:
    """Compute the least signed distance [m] of two hands at each tick, (T,), negative where one is in the other.

    Poses are as of `kernels.contact.penetration.clearances`; NaN where a joint is.
    """
    count, others = PHALANGES + shape.palm_radius.shape[0], PHALANGES + other_shape.palm_radius.shape[0]
    for tick in range(joints.shape[0]):
        best, missing = math.inf, as_bool(False)
        for i in range(count):
            body = _body(shape, joints[tick], position[tick], rotation[tick], as_int64(i))
            for j in range(others):
                other = _body(other_shape, other_joints[tick], other_position[tick], other_rotation[tick], as_int64(j))
                x, y, z = body.x - other.x, body.y - other.y, body.z - other.z
                # Farther by the balls that hold both than the least so far: the exact distance cannot be less.
                far = math.sqrt(x * x + y * y + z * z) - body.length - other.length - body.radius - other.radius
                missing = missing or math.isnan(far)
                if far <= best:
                    best = min(best, round_cone_pair(body, other)[0])
        out[tick] = math.nan if missing else best
