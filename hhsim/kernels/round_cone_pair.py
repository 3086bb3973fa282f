"""Signed distance of two round cones, exact: the least over the interior and the four edges of the axis parameters.

With x and y the lengths along the unit axes u and v, the distance |w + x u - y v| + k_u x + k_v y less the radii is
convex. Inside, its unit normal n obeys n u = -k_u and n v = k_v, which leaves two, one a side of the plane of the axes.
On an edge one cone is a sphere. Each candidate is evaluated where it lies, so that none can be below the least.
"""

import math

from hhsim.kernels.arithmetic import fused, product
from hhsim.kernels.jit import jit_inline
from hhsim.kernels.round_cone_distance import RoundCone, round_cone_parameter


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
