"""Points spread over a triangle mesh so that each face has some."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.topology import face_areas


def face_samples(
    vertices: FloatArray, faces: IntArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Points on faces, about `count` by area, and at least one on each face that has an area.

    Args:
        vertices: Shape (V, 3).
        faces: Shape (F, 3).
        count: How many, beside the one on each.

    Returns:
        Points, shape (n, 3); the face of each, shape (n,), in order; and the area that each stands for, shape (n,).
    """
    area = face_areas(vertices, faces)
    each = np.where(area > 0.0, 1 + np.floor(count * area / max(area.sum(), np.finfo(np.float64).tiny)), 0)
    face = np.repeat(np.arange(len(faces)), each.astype(np.int64))
    u, v = rng.random((2, len(face)))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    a, b, c = vertices[faces[face]].transpose(1, 0, 2)
    point = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return np.ascontiguousarray(point), face, (area / np.maximum(each, 1))[face]
