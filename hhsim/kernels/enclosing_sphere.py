"""Smallest sphere that encloses a set of spheres.

The problem is LP-type with at most four spheres in its basis (Fischer and Gärtner, 2003). The sphere that sticks out
farthest joins the basis, and the basis of those at most five is found by trying every subset, so that the radius grows
with each step. The returned radius is measured against every sphere.
"""

import math

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating

_TOLERANCE = 1e-12
_STEPS = 100


@jit_allocating
def _tangent_sphere(center: Array, radius: Array, chosen: Indices, sphere_out: Array) -> bool:
    """Compute the smallest sphere (x, y, z, r) that the chosen ones touch from inside, centred in their affine hull.

    With p the offset from the first centre and s = R − r₁, each other sphere gives u·p = (|u|² − δ²)/2 − s δ with
    δ = r₁ − r; so p = a + s b, and |p| = s leaves a quadratic. False if the centres span no simplex or no such sphere
    exists.
    """
    first = chosen[0]
    r1 = radius[first]
    n = chosen.shape[0] - 1
    u = np.zeros((3, 3))
    matrix = np.zeros((3, 5))
    delta = np.zeros(3)
    for i in range(n):
        for k in range(3):
            u[i, k] = center[chosen[i + 1], k] - center[first, k]
        delta[i] = r1 - radius[chosen[i + 1]]
    scale = 0.0
    for i in range(n):
        for j in range(n):
            matrix[i, j] = u[i, 0] * u[j, 0] + u[i, 1] * u[j, 1] + u[i, 2] * u[j, 2]
        matrix[i, 3] = 0.5 * (matrix[i, i] - delta[i] * delta[i])
        matrix[i, 4] = -delta[i]
        scale = max(scale, matrix[i, i])
    for i in range(n):
        pivot = i
        for j in range(i + 1, n):
            if abs(matrix[j, i]) > abs(matrix[pivot, i]):
                pivot = j
        if abs(matrix[pivot, i]) <= 1e-14 * scale:
            return False
        for k in range(5):
            matrix[i, k], matrix[pivot, k] = matrix[pivot, k], matrix[i, k]
        for j in range(n):
            if j != i:
                factor = matrix[j, i] / matrix[i, i]
                for k in range(5):
                    matrix[j, k] -= factor * matrix[i, k]
    aa = ab = bb = 0.0
    a, b = np.zeros(3), np.zeros(3)
    for k in range(3):
        for i in range(n):
            a[k] += matrix[i, 3] / matrix[i, i] * u[i, k]
            b[k] += matrix[i, 4] / matrix[i, i] * u[i, k]
        aa += a[k] * a[k]
        ab += a[k] * b[k]
        bb += b[k] * b[k]
    # |a + s b|² = s²; both roots may be true spheres, the smaller R is wanted.
    least = 0.0
    for i in range(n):
        least = max(least, -delta[i])
    quadratic = bb - 1.0
    s = -1.0
    if abs(quadratic) < 1e-14:
        if ab != 0.0:
            s = -aa / (2.0 * ab)
    else:
        discriminant = ab * ab - quadratic * aa
        if discriminant < 0.0:
            return False
        root = math.sqrt(discriminant)
        s1, s2 = (-ab - root) / quadratic, (-ab + root) / quadratic
        s = min(s1, s2)
        if s < least * (1.0 - _TOLERANCE):
            s = max(s1, s2)
    if not s >= least * (1.0 - _TOLERANCE):
        return False
    for k in range(3):
        sphere_out[k] = center[first, k] + a[k] + s * b[k]
    sphere_out[3] = s + r1
    return True


@jit
def _reach(center: Array, radius: Array, i: int, sphere: Array) -> float:
    dx, dy, dz = center[i, 0] - sphere[0], center[i, 1] - sphere[1], center[i, 2] - sphere[2]
    return float(math.sqrt(dx * dx + dy * dy + dz * dz) + radius[i])


@jit_allocating
def enclosing_sphere(center: Array, radius: Array, members: Indices, sphere_out: Array) -> None:
    """Compute the smallest sphere (x, y, z, r) [m] around `members`, at least one; 1e-12 larger, for the rounding."""
    basis = np.empty(5, np.int64)
    chosen = np.empty(4, np.int64)
    trial, best = np.empty(4), np.empty(4)
    best_basis = np.empty(4, np.int64)

    largest = members[0]
    for i in members:
        if radius[i] > radius[largest]:
            largest = i
    basis[0] = largest
    size = 1
    for k in range(3):
        sphere_out[k] = center[largest, k]
    sphere_out[3] = radius[largest]

    for _ in range(_STEPS):
        farthest, reach = -1, sphere_out[3] * (1.0 + _TOLERANCE)
        for i in members:
            r = _reach(center, radius, i, sphere_out)
            if r > reach:
                farthest, reach = i, r
        if farthest < 0:
            break
        basis[size] = farthest
        best[3] = np.inf
        best_size = 0
        # The new sphere is in every basis of the larger set; bit i of `subset` says whether old member i is too.
        for subset in range(1 << size):
            count = 1
            chosen[0] = farthest
            for i in range(size):
                if subset >> i & 1:
                    if count < 4:
                        chosen[count] = basis[i]
                    count += 1
            if count > 4 or not _tangent_sphere(center, radius, chosen[:count], trial) or trial[3] >= best[3]:
                continue
            encloses = True
            for i in range(size + 1):
                encloses = encloses and not _reach(center, radius, basis[i], trial) > trial[3] * (1.0 + 1e-10)
            if encloses:
                best[:] = trial
                best_basis[:count] = chosen[:count]
                best_size = count
        if best_size == 0 or best[3] <= sphere_out[3]:
            break
        sphere_out[:] = best
        size = best_size
        basis[:size] = best_basis[:size]

    needed = 0.0
    for i in members:
        needed = max(needed, _reach(center, radius, i, sphere_out))
    sphere_out[3] = needed * (1.0 + _TOLERANCE)
