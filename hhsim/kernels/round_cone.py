"""Signed distances of round cones, in closed form: to spheres, and to each other.

A phalanx of the paper (cone frustum, a sphere at each joint, a hemisphere at the tip) is a *round cone*, the hull of
two spheres with centres a, b and radii r_a >= r_b a length l apart. It is the union of the spheres with centre
x(s) = a + s (b - a) and radius r(s) = r_a - s (r_a - r_b), 0 <= s <= 1, so its distance to a sphere is the least of the
sphere-to-sphere distances over s. With t and h the axial and radial coordinates of the other centre and
sin φ = (r_a - r_b) / l that minimum lies at s = clamp((t - h tan φ) / l, 0, 1): one formula for all the cases of
the paper's Eq. 4 to 7 and 13. Where one sphere holds the other (l <= r_a - r_b), the round cone is the larger sphere,
and s = 0. A signed distance is negative inside.

Signed distance of two round cones, exact: the least over the interior and the four edges of the axis parameters.

With x and y the lengths along the unit axes u and v, the distance |w + x u - y v| + k_u x + k_v y less the radii is
convex. Inside, its unit normal n obeys n u = -k_u and n v = k_v, which leaves two, one a side of the plane of the axes.
On an edge one cone is a sphere. Each candidate is evaluated where it lies, so that none can be below the least.
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
    spheres: Spheres, start: int, stop: int, cone: RoundCone, distance_out: Array, parameter_out: Array
) -> None:
    """Compute signed distances [m] and axis parameters of spheres [start, stop) and a round cone."""
    ax, ay, az, ux, uy, uz, length, tan_slope, inverse_length, radius_a, radius_drop = cone
    x, y, z, radius = spheres
    # Signed indices would be checked for negative values, which keeps the loop off the vector unit.
    for i in range(np.uint64(start), np.uint64(stop)):
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
def sphere_distances(spheres: Spheres, start: int, stop: int, ball: RoundCone, distance_out: Array) -> None:
    """Compute signed distances [m] of spheres [start, stop) and a round cone that is a sphere."""
    x, y, z, radius = spheres
    for i in range(np.uint64(start), np.uint64(stop)):
        dx, dy, dz = x[i] - ball.x, y[i] - ball.y, z[i] - ball.z
        distance_out[i] = math.sqrt(product(dx, dy, dz, dx, dy, dz)) - ball.radius - radius[i]


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


@jit_inline
def round_cone_pair(first: RoundCone, second: RoundCone) -> tuple[float, float, float, float, float, float]:
    """Compute signed distance [m], both axis parameters, and the unit normal from the second to the first.

    Where the nearest axis points coincide the normal is across both axes; where these are parallel, it is across one.
    """
    s, t = _interior(first, second)
    t = _parameter(second, first, s)
    s = _parameter(first, second, t)
    best = _distance(first, second, s, t)
    for i in range(4):
        end = float(i % 2)
        if i < 2:
            one, other = end, _parameter(second, first, end)
        else:
            one, other = _parameter(first, second, end), end
        distance = _distance(first, second, one, other)
        if distance < best:
            best, s, t = distance, one, other
    x, y, z = _between(first, second, s, t)
    norm = math.sqrt(product(x, y, z, x, y, z))
    if norm > 0.0:
        return best, s, t, x / norm, y / norm, z / norm
    x, y, z = _across(first.ux, first.uy, first.uz, second.ux, second.uy, second.uz)
    if product(x, y, z, x, y, z) == 0.0:
        ux, uy, uz = (first.ux, first.uy, first.uz) if first.length > 0.0 else (second.ux, second.uy, second.uz)
        x, y, z = _across(ux, uy, uz, 1.0, 0.0, 0.0) if abs(ux) < 0.7 else _across(ux, uy, uz, 0.0, 1.0, 0.0)
    norm = math.sqrt(product(x, y, z, x, y, z))
    return (best, s, t, x / norm, y / norm, z / norm) if norm > 0.0 else (best, s, t, 0.0, 0.0, 1.0)


@jit_inline
def _across(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@jit_inline
def _between(first: RoundCone, second: RoundCone, s: float, t: float) -> tuple[float, float, float]:
    x, y = s * first.length, t * second.length
    return (
        fused(x, first.ux, fused(-y, second.ux, first.x - second.x)),
        fused(x, first.uy, fused(-y, second.uy, first.y - second.y)),
        fused(x, first.uz, fused(-y, second.uz, first.z - second.z)),
    )


@jit_inline
def _distance(first: RoundCone, second: RoundCone, s: float, t: float) -> float:
    x, y, z = _between(first, second, s, t)
    return (
        math.sqrt(product(x, y, z, x, y, z))
        - fused(-s, first.drop, first.radius)
        - fused(-t, second.drop, second.radius)
    )


@jit_inline
def _parameter(cone: RoundCone, other: RoundCone, at: float) -> float:
    """Compute the parameter of a cone nearest to the sphere of the other one at its parameter `at`."""
    x, y, z = _between(other, cone, at, 0.0)
    return round_cone_parameter(x, y, z, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)


@jit_inline
def _interior(first: RoundCone, second: RoundCone) -> tuple[float, float]:
    """Compute the stationary parameters, clamped to [0, 1]; (0, 0) where there are none."""
    mx, my, mz = _across(first.ux, first.uy, first.uz, second.ux, second.uy, second.uz)
    square = product(mx, my, mz, mx, my, mz)
    if square < 1e-28 or first.inverse_length == 0.0 or second.inverse_length == 0.0:
        return 0.0, 0.0
    cosine = product(first.ux, first.uy, first.uz, second.ux, second.uy, second.uz)
    one, two = -first.drop * first.inverse_length, second.drop * second.inverse_length
    in_plane = (one * one + two * two - 2.0 * cosine * one * two) / square
    if in_plane >= 1.0:
        return 0.0, 0.0
    wx, wy, wz = first.x - second.x, first.y - second.y, first.z - second.z
    reach = abs(product(wx, wy, wz, mx, my, mz)) / math.sqrt(square * (1.0 - in_plane))
    a = fused(reach, one, -product(wx, wy, wz, first.ux, first.uy, first.uz))
    b = fused(reach, two, -product(wx, wy, wz, second.ux, second.uy, second.uz))
    s = (a - cosine * b) / square * first.inverse_length
    t = (cosine * a - b) / square * second.inverse_length
    return min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
