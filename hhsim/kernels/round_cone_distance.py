"""Signed distances in closed form: sphere to sphere, sphere to round cone.

A phalanx of the paper (cone frustum, a sphere at each joint, a hemisphere at the tip) is a *round cone*, the hull of
two spheres with centres a, b and radii r_a >= r_b a length l apart. It is the union of the spheres with centre
x(s) = a + s (b - a) and radius r(s) = r_a - s (r_a - r_b), 0 <= s <= 1, so its distance to a sphere is the least of the
sphere-to-sphere distances over s. With t and h the axial and radial coordinates of the other centre and
sin φ = (r_a - r_b) / l that minimum lies at s = clamp((t - h tan φ) / l, 0, 1): one formula for all the cases of
the paper's Eq. 4 to 7 and 13. Where one sphere holds the other (l <= r_a - r_b), the round cone is the larger sphere,
and s = 0. A signed distance is negative inside.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import fused, least_above, product
from hhsim.kernels.jit import Array, jit_inline


class RoundCone(NamedTuple):
    """A round cone as the queries take it; a sphere is one of length 0."""

    x: float  # a, centre of the larger sphere [m]
    y: float
    z: float
    ux: float  # unit axis from a to b
    uy: float
    uz: float
    length: float  # [m]
    tan_slope: float  # with the next as of `cone_slope`
    inverse_length: float
    radius: float  # of the larger sphere [m]
    drop: float  # radius less that of the smaller sphere [m]


@jit_inline
def sphere_cone(x: float, y: float, z: float, radius: float) -> RoundCone:
    """Return a sphere as a round cone."""
    return RoundCone(x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, radius, 0.0)


@jit_inline
def cone_slope(length: float, radius_a: float, radius_b: float) -> tuple[float, float]:
    """Compute (tan φ, 1 / length) of a round cone with radius_a >= radius_b; (0, 0) if it is the larger sphere."""
    drop = radius_a - radius_b
    if length <= drop or length <= 0.0:
        return 0.0, 0.0
    sine = drop / length
    return sine / math.sqrt(1.0 - sine * sine), 1.0 / length


@jit_inline
def round_cone_parameter(
    dx: float, dy: float, dz: float, ux: float, uy: float, uz: float, tan_slope: float, inverse_length: float
) -> float:
    """Compute the axis parameter s in [0, 1] of the sphere of a round cone nearest to the point a + (dx, dy, dz)."""
    t = product(dx, dy, dz, ux, uy, uz)
    px, py, pz = fused(-t, ux, dx), fused(-t, uy, dy), fused(-t, uz, dz)
    h = math.sqrt(product(px, py, pz, px, py, pz))
    return min(max(fused(-h, tan_slope, t) * inverse_length, 0.0), 1.0)


class Spheres(NamedTuple):
    """Centres and radii [m], each of shape (n,)."""

    x: Array
    y: Array
    z: Array
    radius: Array


@jit_inline
def round_cone_distances(
    spheres: Spheres, count: int, cone: RoundCone, distance_out: Array, parameter_out: Array
) -> None:
    """Compute signed distances [m] and axis parameters of `count` spheres and a round cone, on the vector unit."""
    ax, ay, az, ux, uy, uz, length, tan_slope, inverse_length, radius_a, radius_drop = cone
    x, y, z, radius = spheres
    for i in range(count):
        dx, dy, dz = x[i] - ax, y[i] - ay, z[i] - az
        t = product(dx, dy, dz, ux, uy, uz)
        px, py, pz = fused(-t, ux, dx), fused(-t, uy, dy), fused(-t, uz, dz)
        h2 = product(px, py, pz, px, py, pz)
        s = fused(-math.sqrt(h2), tan_slope, t) * inverse_length
        s = 0.0 if s < 0.0 else s
        s = 1.0 if s > 1.0 else s
        along = fused(-s, length, t)
        distance_out[i] = math.sqrt(fused(along, along, h2)) + fused(s, radius_drop, -radius_a) - radius[i]
        parameter_out[i] = s


@jit_inline
def sphere_pair_distances(
    hand: Spheres, others: Spheres, count: int, position: Array, rotation: Array, distance_out: Array
) -> None:
    """Compute signed distances [m] of sphere pairs, the hand's in the palm frame (position, rotation), others world."""
    hand_x, hand_y, hand_z, hand_radius = hand
    object_x, object_y, object_z, object_radius = others
    px, py, pz = position[0], position[1], position[2]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for i in range(count):
        x, y, z = hand_x[i], hand_y[i], hand_z[i]
        dx = px - object_x[i] + product(r00, r01, r02, x, y, z)
        dy = py - object_y[i] + product(r10, r11, r12, x, y, z)
        dz = pz - object_z[i] + product(r20, r21, r22, x, y, z)
        distance_out[i] = math.sqrt(product(dx, dy, dz, dx, dy, dz)) - hand_radius[i] - object_radius[i]


@jit_inline
def least_distance(distance: Array, start: int, stop: int) -> float:
    """Return the least of distance[start:stop], 1e300 if there is none."""
    return min(least_above(distance, start, stop, -np.inf), 1e300)


@jit_inline
def count_within(distance: Array, start: int, stop: int, limit: float) -> int:
    """Count the values of distance[start:stop] up to a limit."""
    within = 0
    for i in range(np.uint64(start), np.uint64(stop)):
        within += 1 if distance[i] <= limit else 0
    return within
