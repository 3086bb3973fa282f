"""Neighbourhood of triangles: self-contact, and borders and corners beyond which others continue their plane.

Loose triangles in a floor have borders in the list of faces and none in space: rows of them would hold back a slide.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.mesh.feature_distance import ON, above, triangle_distance
from hhsim.kernels.mesh.features import ALONG
from hhsim.kernels.round_cone import RoundCone, sphere_cone
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_pieces

Flags = NDArray[np.bool_]

BEYOND = 10.0 * ON
"""Distance that a plane must continue beyond a border [m]: more than faces reach beyond their own sides."""
DIRECTIONS = 16
"""Number of directions around a corner in which the plane is searched."""


@jit
def _in_plane(face: Array, f: int, normal: Array, flat: float, x: float, y: float, z: float) -> bool:
    """Return True if face f lies in the plane through a point with this normal, within the sine `flat`."""
    n = face[f]
    cx = n[1] * normal[2] - n[2] * normal[1]
    cy = n[2] * normal[0] - n[0] * normal[2]
    cz = n[0] * normal[1] - n[1] * normal[0]
    parallel = cx * cx + cy * cy + cz * cz <= flat * flat
    return bool(parallel and abs(n[0] * x + n[1] * y + n[2] * z - n[3]) <= ON)


@jit
def _stretch_over(face: Array, f: int, line: Array, x: float, y: float, z: float) -> tuple[float, float]:
    """Return the stretch of a line from (x, y, z) along line[3:6] over face f; (inf, -inf) if there is none."""
    low, high = 0.0, line[6]
    for k in range(3):
        i = 4 + 4 * k
        depth = face[f, i] * x + face[f, i + 1] * y + face[f, i + 2] * z - face[f, i + 3]
        rate = face[f, i] * line[3] + face[f, i + 1] * line[4] + face[f, i + 2] * line[5]
        if rate > 0.0:
            low = max(low, -depth / rate)
        elif rate < 0.0:
            high = min(high, -depth / rate)
        elif depth < 0.0:
            return np.inf, -np.inf
    return (low, high) if low <= high else (np.inf, -np.inf)


@jit
def _is_covered(low: Array, high: Array, count: int, length: float) -> bool:
    """Return True if the stretches together cover 0 to length."""
    done = 0.0
    while done < length:
        farthest = done
        for i in range(count):
            if low[i] <= done + ON:
                farthest = max(farthest, high[i])
        if farthest <= done:
            return False
        done = farthest
    return True


@jit_allocating
def covered_edges(
    tree: TreeArrays, face: Array, line: Array, inward: Array, own: Indices, flat: float, covered_out: Flags
) -> None:
    """Mark the borders, shape (B, 7), beyond which other faces continue the plane along all of their length.

    Faces and borders are as `face` and `edge` of `MeshFeatures`; `inward` are unit vectors into the one face `own` of
    each, across it, shape (B, 3); `flat` is the sine of an angle below which planes are the same.
    """
    found = np.empty(face.shape[0], np.int64)
    low, high = np.empty(found.shape[0]), np.empty(found.shape[0])
    stack = np.empty(STACK_SIZE, np.int64)
    for e in range(line.shape[0]):
        x, y, z = line[e, 0], line[e, 1], line[e, 2]
        cone = RoundCone(x, y, z, line[e, 3], line[e, 4], line[e, 5], line[e, 6], 0.0, 1.0 / line[e, 6], 0.0, 0.0)
        faces, _, _ = gather_pieces(tree, cone, BEYOND, BEYOND, stack, found)
        normal = face[own[e], :3]
        x, y, z = x - BEYOND * inward[e, 0], y - BEYOND * inward[e, 1], z - BEYOND * inward[e, 2]
        count = 0
        for i in range(faces):
            if found[i] != own[e] and _in_plane(face, found[i], normal, flat, x, y, z):
                low[count], high[count] = _stretch_over(face, found[i], line[e], x, y, z)
                count += 1
        covered_out[e] = _is_covered(low, high, count, line[e, 6])


@jit_allocating
def covered_corners(
    tree: TreeArrays, face: Array, corner: Array, own: Indices, flat: float, covered_out: Flags
) -> None:
    """Mark the corners [m], shape (C, 3), around which faces continue the plane of a face `own` at each."""
    found = np.empty(face.shape[0], np.int64)
    stack = np.empty(STACK_SIZE, np.int64)
    for c in range(corner.shape[0]):
        x, y, z = corner[c, 0], corner[c, 1], corner[c, 2]
        faces, _, _ = gather_pieces(tree, sphere_cone(x, y, z, 0.0), BEYOND, BEYOND, stack, found)
        f = own[c]
        normal, u = face[f, :3], face[f, 4:7]
        v = np.cross(normal, u)
        count = 0
        for i in range(faces):
            if _in_plane(face, found[i], normal, flat, x, y, z):
                found[count] = found[i]
                count += 1
        covered = True
        for d in range(DIRECTIONS):
            sine, cosine = sine_cosine(2.0 * np.pi * d / DIRECTIONS)
            p, q = BEYOND * cosine, BEYOND * sine
            over = False
            for i in range(count):
                px, py, pz = x + p * u[0] + q * v[0], y + p * u[1] + q * v[1], z + p * u[2] + q * v[2]
                over = over or above(face, found[i], px, py, pz)
            covered = covered and over
        covered_out[c] = covered


@jit
def _leads_into(face: Array, f: int, k: int, ux: float, uy: float, uz: float) -> bool:
    """Return True if a direction from corner k of face f leads along the face, between its two sides or on one."""
    n = face[f]
    along = abs(n[0] * ux + n[1] * uy + n[2] * uz) <= ALONG
    for side in (k, (k + 2) % 3):
        i = 4 + 4 * side
        along = along and n[i] * ux + n[i + 1] * uy + n[i + 2] * uz >= -ALONG
    return along


@jit_allocating
def touches_itself(tree: TreeArrays, corner: Array, face: Array, corners: Indices, line: Array, ends: Indices) -> bool:
    """Return True if any edge comes within `ON` of a triangle other than those that it is a side of.

    Closed triangles that cut through each other, or lie on each other, do so along an edge of at least one of them.
    Corners, faces and lines are as `corner`, `face` and `edge` of `MeshFeatures`; `corners`, shape (F, 3), are the
    vertices of each triangle, and `ends`, shape (E, 2), of each line; vertices at one place are one.
    """
    found = np.empty(face.shape[0], np.int64)
    stack = np.empty(STACK_SIZE, np.int64)
    for e in range(line.shape[0]):
        x, y, z, ux, uy, uz, length = line[e]
        cone = RoundCone(x, y, z, ux, uy, uz, length, 0.0, 1.0 / length, 0.0, 0.0)
        count, _, _ = gather_pieces(tree, cone, ON, ON, stack, found)
        for i in range(count):
            f = found[i]
            first, second = -1, -1
            for k in range(3):
                first = k if corners[f, k] == ends[e, 0] else first
                second = k if corners[f, k] == ends[e, 1] else second
            if first >= 0 and second >= 0:
                continue
            if first >= 0:
                meets = _leads_into(face, f, first, ux, uy, uz)
            elif second >= 0:
                meets = _leads_into(face, f, second, -ux, -uy, -uz)
            else:
                meets = triangle_distance(corner, face, f, cone)[0] <= ON
            if meets:
                return True
    return False
