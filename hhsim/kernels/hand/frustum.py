"""Distance of a sphere to a cone frustum as in the paper's Eq. 4 to 7 and 10.

The frustum of a phalanx is the conical part of its round cone (`kernels.round_cone_distance`). Its bottoms are the
circles along which the joint spheres touch it, so that frustum and spheres together are the body of every other method.
With l, r_a >= r_b the round cone's length and radii and sin φ = (r_a - r_b) / l:

    D = joint + r_a sin φ u,   E = end + r_b sin φ u,   r₁ = r_a cos φ,   r₂ = r_b cos φ,   |DE| = l cos² φ,

u from the thick end to the thin one. D is the thick bottom and E the thin one: with C the foot of a sphere's centre O
on the axis, k = CE / DE (Eq. 6) is 0 at E and 1 at D. Here `along` is k |DE|, so that (r₁ - r₂) k = along tan φ.
"""

import math

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Record, jit, jit_inline

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

SHAPE = 6
"""Number of values of a phalanx that do not move: length, radius, tangent, cosine, sine, sphere_radius."""


@jit
def frustum_shapes(hand: HandArrays, shape_out: Array) -> None:
    """Compute the shape of each phalanx for `place_frustum`, (15, SHAPE); length -1 if there is no cone."""
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            tangent = hand.tan_slope[f, k]
            cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
            thin = hand.radius[f, k + 1]
            row = shape_out[PHALANX_COUNT * f + k]
            row[0] = hand.length[f, k] * cosine * cosine if hand.inverse_length[f, k] > 0.0 else -1.0
            row[1] = thin * cosine
            row[2] = tangent
            row[3] = cosine
            row[4] = tangent * cosine
            row[5] = thin


@jit
def place_frustum(shapes: Array, pose: Record, finger: int, phalanx: int, frustum_out: Record) -> None:
    """Place the frustum and end sphere of a phalanx at `pose`, whose kinematics are up to date."""
    shape = shapes[PHALANX_COUNT * finger + phalanx]
    frustum_out.length, frustum_out.radius, frustum_out.tangent = shape[0], shape[1], shape[2]
    frustum_out.cosine, frustum_out.sine, frustum_out.sphere_radius = shape[3], shape[4], shape[5]
    for i in range(3):
        frustum_out.axis[i] = pose.direction[finger, phalanx, i]
        frustum_out.sphere[i] = pose.joints[finger, phalanx + 1, i]
        frustum_out.end[i] = frustum_out.sphere[i] + shape[5] * shape[4] * frustum_out.axis[i]


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
