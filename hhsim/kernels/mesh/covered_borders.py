"""Borders of triangles that lie in the plane of others: where that plane goes on beyond a border, it is none.

A loose triangle in a floor, or a floor of triangles that do not share their corners, has borders and corners by its
list of faces and none in space. Rows of theirs would allow half of the way to them only, and hold back what slides
over the floor.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.mesh.feature_distance import ON, above
from hhsim.kernels.mesh.features import BRANCHING, FaceSpheres, gather_faces
from hhsim.kernels.round_cone_distance import RoundCone, sphere_cone
from hhsim.kernels.sphere_tree import STACK_SIZE

Flags = NDArray[np.bool_]

BEYOND = 10.0 * ON
"""How far beyond a border its plane must go on [m]: more than faces reach beyond their own sides."""
DIRECTIONS = 16
"""In which the plane is looked for around a corner."""


@jit
def _in_plane(face: Array, f: int, normal: Array, flat: float, x: float, y: float, z: float) -> bool:
    # Whether face f lies in the plane through a point with this normal: `flat` is the sine that two may differ by.
    n = face[f]
    cx = n[1] * normal[2] - n[2] * normal[1]
    cy = n[2] * normal[0] - n[0] * normal[2]
    cz = n[0] * normal[1] - n[1] * normal[0]
    parallel = cx * cx + cy * cy + cz * cz <= flat * flat
    return bool(parallel and abs(n[0] * x + n[1] * y + n[2] * z - n[3]) <= ON)


@jit
def _stretch_over(face: Array, f: int, line: Array, x: float, y: float, z: float) -> tuple[float, float]:
    # The part of a line from (x, y, z) along line[3:6] that is over face f; (infinity, minus infinity) where none is.
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
    # Whether stretches together are all of 0 to length.
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
    spheres: FaceSpheres, face: Array, line: Array, inward: Array, own: Indices, flat: float, covered_out: Flags
) -> None:
    """Which borders have other faces in their plane beyond all of their length.

    Args:
        spheres: Around the faces.
        face: As in `MeshFeatures`, shape (F, 16).
        line: The borders, as edges in `MeshFeatures`, shape (B, 7).
        inward: Unit vector into the one face of each, across it, shape (B, 3).
        own: That face, shape (B,).
        flat: Sine of an angle between planes that is none.
        covered_out: Shape (B,).
    """
    found = np.empty(face.shape[0] + BRANCHING, np.int64)
    low, high = np.empty(found.shape[0]), np.empty(found.shape[0])
    stack, near = np.empty(STACK_SIZE, np.int64), np.empty(BRANCHING)
    for e in range(line.shape[0]):
        x, y, z = line[e, 0], line[e, 1], line[e, 2]
        cone = RoundCone(x, y, z, line[e, 3], line[e, 4], line[e, 5], line[e, 6], 0.0, 1.0 / line[e, 6], 0.0, 0.0)
        faces, _, _ = gather_faces(spheres, cone, BEYOND, BEYOND, stack, near, found)
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
    spheres: FaceSpheres, face: Array, corner: Array, own: Indices, flat: float, covered_out: Flags
) -> None:
    """Which corners have faces in their plane all around.

    Args:
        spheres, face, flat: As in `covered_edges`.
        corner: [m], shape (C, 3).
        own: A face at each, shape (C,).
        covered_out: Shape (C,).
    """
    found = np.empty(face.shape[0] + BRANCHING, np.int64)
    stack, near = np.empty(STACK_SIZE, np.int64), np.empty(BRANCHING)
    for c in range(corner.shape[0]):
        x, y, z = corner[c, 0], corner[c, 1], corner[c, 2]
        faces, _, _ = gather_faces(spheres, sphere_cone(x, y, z, 0.0), BEYOND, BEYOND, stack, near, found)
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
            angle = 2.0 * np.pi * d / DIRECTIONS
            p, q = BEYOND * np.cos(angle), BEYOND * np.sin(angle)
            over = False
            for i in range(count):
                px, py, pz = x + p * u[0] + q * v[0], y + p * u[1] + q * v[1], z + p * u[2] + q * v[2]
                over = over or above(face, found[i], px, py, pz)
            covered = covered and over
        covered_out[c] = covered
