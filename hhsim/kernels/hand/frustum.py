"""Sphere against cone frustum as in the paper's Eq. 4 to 7 and 10.

The frustum of a phalanx is the conical part of its round cone (`kernels.round_cone_distance`). Its bottoms are the
circles along which the joint spheres touch it, so that frustum and spheres together are the body that every other
method has, and that penetration is measured of. With l, r_a >= r_b the round cone's length and radii and
sin φ = (r_a - r_b) / l:

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
        ("end", np.float64, (3,)),
        ("axis", np.float64, (3,)),
        ("length", np.float64),
        ("radius", np.float64),
        ("tangent", np.float64),
        ("cosine", np.float64),
        ("sine", np.float64),
        ("sphere", np.float64, (3,)),
        ("sphere_radius", np.float64),
    ],
    align=True,
)
"""One phalanx: a cone frustum and the sphere at its thin end; world.

| field | meaning |
|---|---|
| end | E, centre of the thin bottom [m] |
| axis | u, unit vector from D to E |
| length | |DE| [m], negative where one joint sphere holds the other and no cone lies between them |
| radius | r₂, of the thin bottom [m] |
| tangent, cosine, sine | of φ, the angle between side and axis |
| sphere, sphere_radius | the joint's sphere or the fingertip's hemisphere [m] |
"""


SHAPE = 6
"""Numbers that describe a phalanx apart from where it is: length, radius, tangent, cosine, sine, sphere_radius."""


@jit
def frustum_shapes(hand: HandArrays, shape_out: Array) -> None:
    """What `place_frustum` needs of each phalanx, shape (15, SHAPE); length -1 where spheres leave no cone between."""
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
    """The frustum and end sphere of a phalanx at `pose`, whose kinematics are up to date."""
    body = PHALANX_COUNT * finger + phalanx
    frustum_out.length = shapes[body, 0]
    frustum_out.radius = shapes[body, 1]
    frustum_out.tangent = shapes[body, 2]
    frustum_out.cosine = shapes[body, 3]
    frustum_out.sine = shapes[body, 4]
    thin = shapes[body, 5]
    frustum_out.sphere_radius = thin
    for i in range(3):
        frustum_out.axis[i] = pose.direction[finger, phalanx, i]
        frustum_out.sphere[i] = pose.joints[finger, phalanx + 1, i]
        frustum_out.end[i] = frustum_out.sphere[i] + thin * shapes[body, 4] * frustum_out.axis[i]


@jit_inline
def foot(
    ex: float, ey: float, ez: float, ux: float, uy: float, uz: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Eq. 4 and 6 for a sphere's centre (x, y, z): (along, CO_x, CO_y, CO_z) [m], C the foot on the axis."""
    dx, dy, dz = x - ex, y - ey, z - ez
    along = -(dx * ux + dy * uy + dz * uz)
    return along, dx + along * ux, dy + along * uy, dz + along * uz


@jit_inline
def threshold(along: float, radius: float, thin: float, tangent: float, cosine: float) -> float:
    """Eq. 5: |OC|_Γ [m], at which a sphere of `radius` is tangent to the frustum's side or its extension."""
    return radius / cosine + along * tangent + thin


@jit_inline
def in_range(along: float, radius: float, length: float, sine: float, thin_sphere: bool, thick_sphere: bool) -> bool:
    """Whether C lies where the frustum can be touched by a sphere of `radius` [m].

    At an end that is flat Eq. 7 lets the sphere reach R beyond it; at one that a sphere closes (Eq. 13 at the
    fingertip) the frustum's part ends where a sphere tangent to the side touches the circle that both share, R sin φ
    towards E.
    """
    lowest = -radius * sine if thin_sphere else -radius
    highest = length - radius * sine if thick_sphere else length + radius
    return lowest <= along <= highest
