"""Shapes of stored hands: round cones, the cone frustums of the paper, and the distance of two hands.

The frustum of a phalanx (Eq. 4 to 7 and 10) is the conical part of its round cone (`kernels.round_cone`). Its bottoms
are the circles along which the joint spheres touch it, so that frustum and spheres together are the body of every other
method. With l, r_a >= r_b the round cone's length and radii and sin φ = (r_a - r_b) / l:

    D = joint + r_a sin φ u,   E = end + r_b sin φ u,   r₁ = r_a cos φ,   r₂ = r_b cos φ,   |DE| = l cos² φ,

u from the thick end to the thin one. D is the thick bottom and E the thin one: with C the foot of a sphere's centre O
on the axis, k = CE / DE (Eq. 6) is 0 at E and 1 at D. Here `along` is k |DE|, so that (r₁ - r₂) k = along tan φ.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays, placed_sphere
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_allocating, jit_inline
from hhsim.kernels.round_cone import RoundCone, cone_slope, round_cone_pair


class HandShape(NamedTuple):
    """Sizes of a hand [m]: phalanx_radius (5, 4); palm_center (P, 3), palm frame, and palm_radius (P,)."""

    phalanx_radius: Array
    palm_center: Array
    palm_radius: Array


class StoredHands(NamedTuple):
    """A hand at T ticks, world: joints (T, 5, 4, 3) and the palm's position (T, 3) [m] and rotation (T, 3, 3)."""

    shape: HandShape
    joints: Array
    position: Array
    rotation: Array


@jit
def stored_phalanx(shape: HandShape, joints: Array, finger: int, phalanx: int) -> RoundCone:
    """Return a phalanx as a round cone, from joints [m], shape (5, 4, 3), world; not a number where they are not."""
    a, b = joints[finger, phalanx], joints[finger, phalanx + 1]
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(x * x + y * y + z * z)
    radius, tip_radius = shape.phalanx_radius[finger, phalanx], shape.phalanx_radius[finger, phalanx + 1]
    slope, inverse = cone_slope(length, radius, tip_radius)
    ux, uy, uz = x * inverse, y * inverse, z * inverse
    return RoundCone(a[0], a[1], a[2], ux, uy, uz, length, slope, inverse, radius, radius - tip_radius)


FRUSTUM = np.dtype(
    [
        ("end", np.float64, (3,)),  # E, centre of the thin bottom [m]
        ("axis", np.float64, (3,)),  # u, unit vector from D to E
        ("length", np.float64),  # |DE| [m], negative if one joint sphere holds the other: there is no cone
        ("radius", np.float64),  # r₂, of the thin bottom [m]
        ("tangent", np.float64),  # of φ, the angle between side and axis
        ("cosine", np.float64),
        ("sine", np.float64),
        ("sphere", np.float64, (3,)),  # centre of the joint's sphere or the fingertip's hemisphere [m]
        ("sphere_radius", np.float64),  # [m]
    ],
    align=True,
)
"""One phalanx: a cone frustum and the sphere at its thin end; world."""


@jit
def frustum_shapes(hand: HandArrays, frustums_out: Record) -> None:
    """Write what of the frustum of each phalanx does not move, (15,)."""
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            tangent, thin, frustum = hand.tan_slope[f, k], hand.radius[f, k + 1], frustums_out[PHALANX_COUNT * f + k]
            cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
            frustum.length = hand.length[f, k] * cosine * cosine if hand.inverse_length[f, k] > 0.0 else -1.0
            frustum.radius, frustum.sphere_radius = thin * cosine, thin
            frustum.tangent, frustum.cosine, frustum.sine = tangent, cosine, tangent * cosine


@jit
def place_frustum(pose: Record, finger: int, phalanx: int, frustum: Record) -> None:
    """Place the frustum and end sphere of a phalanx at `pose`, whose kinematics are up to date."""
    for i in range(3):
        frustum.axis[i] = pose.direction[finger, phalanx, i]
        frustum.sphere[i] = pose.joints[finger, phalanx + 1, i]
        frustum.end[i] = frustum.sphere[i] + frustum.sphere_radius * frustum.sine * frustum.axis[i]


@jit_inline
def foot(
    ex: float, ey: float, ez: float, ux: float, uy: float, uz: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Compute (along, CO_x, CO_y, CO_z) [m] of a sphere's centre O, C the foot on the axis (Eq. 4 and 6)."""
    dx, dy, dz = x - ex, y - ey, z - ez
    along = -(dx * ux + dy * uy + dz * uz)
    return along, dx + along * ux, dy + along * uy, dz + along * uz


@jit_inline
def threshold(along: float, radius: float, thin: float, tangent: float, cosine: float) -> float:
    """Compute |OC|_Γ [m] (Eq. 5), at which a sphere is tangent to the frustum's side or its extension."""
    return radius / cosine + along * tangent + thin


@jit_inline
def in_range(along: float, radius: float, length: float, sine: float, thin_sphere: bool, thick_sphere: bool) -> bool:
    """Return True if C lies where a sphere of `radius` [m] can touch the frustum.

    Eq. 7 lets the sphere reach R beyond a flat end. At an end that a sphere closes (Eq. 13 at the fingertip) the
    frustum ends where a sphere tangent to the side touches the circle that both share, R sin φ towards E.
    """
    lowest = -radius * sine if thin_sphere else -radius
    highest = length - radius * sine if thick_sphere else length + radius
    return lowest <= along <= highest


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
