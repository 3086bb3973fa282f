"""Pieces that the shape generators build closed surfaces from: rings, bands, fans, an icosphere."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import in_fixed_order, merged_vertices

GRID = 9
"""Decimals [m] that a generated vertex is rounded to: a nanometre hides the last bits in which machines differ."""


def band(lower: IntArray, upper: IntArray) -> IntArray:
    """Triangles between two closed rings of as many vertices, shape (2n, 3).

    The outside is on the right of the way from `lower` to `upper` for one who walks along the rings: for rings that run
    counter-clockwise about z, `upper` being the higher one, it is away from the axis.
    """
    lower_next, upper_next = np.roll(lower, -1), np.roll(upper, -1)
    return np.concatenate(
        [np.stack([lower, lower_next, upper_next], axis=1), np.stack([lower, upper_next, upper], axis=1)]
    )


def fan(center: int, ring: IntArray) -> IntArray:
    """Triangles from one vertex to each edge of a closed ring, counter-clockwise as the ring is, shape (n, 3)."""
    return np.stack([np.full(len(ring), center), ring, np.roll(ring, -1)], axis=1)


def circle(count: int) -> FloatArray:
    """Unit circle, counter-clockwise from +x, shape (count, 2)."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def icosphere(subdivisions: int) -> tuple[FloatArray, IntArray]:
    """Unit sphere from an icosahedron whose triangles are split in four `subdivisions` times.

    Returns:
        Vertices on the sphere, shape (10·4ˢ + 2, 3), and outward faces, shape (20·4ˢ, 3).
    """
    golden = (1.0 + 5.0**0.5) / 2.0
    corners = [(-1.0, golden, 0.0), (1.0, golden, 0.0), (-1.0, -golden, 0.0), (1.0, -golden, 0.0)]
    vertices = np.array([np.roll(corner, shift) for shift in range(3) for corner in corners])
    spread = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = np.isclose(spread, 2.0)
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    triangles = np.array(faces)
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    for _ in range(subdivisions):
        vertices, triangles = _split_in_four(vertices, triangles)
    return vertices, triangles.astype(np.int64)


def _split_in_four(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middle = vertices[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (inverse.reshape(3, -1) + len(vertices)).astype(np.int64)
    a, b, c = faces.T
    split = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([vertices, middle]), np.concatenate([np.stack(corners, axis=1) for corners in split])


def finished_mesh(vertices: FloatArray, faces: Sequence[IntArray] | IntArray, name: str, source: str) -> Mesh:
    """Make a mesh with the centre of its bounding box at the origin and its bytes in one fixed order.

    Vertices are rounded to `GRID` decimals [m] and sorted by (z, y, x), unused ones dropped, each face starts at its
    lowest index, and faces are sorted: whoever makes the same surface gets the same bytes.
    """
    faces = np.concatenate(list(faces)) if not isinstance(faces, np.ndarray) else faces
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    # Adding zero turns -0.0 into 0.0.
    vertices = np.round(vertices, GRID) + 0.0
    return Mesh(*in_fixed_order(*merged_vertices(vertices, faces)), name=name, source=source)
