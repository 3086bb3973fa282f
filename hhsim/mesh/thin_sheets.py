"""Sheets of few triangles as a union of slabs: each triangle with all that is near it."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.bvh import face_normals

ROUND = 8
"""Directions around a rim; the sphere about a corner is the hull of three such rings and two poles."""


def slab_union(
    vertices: FloatArray, faces: IntArray, half: float, closed: IntArray, tolerance: float
) -> tuple[FloatArray, IntArray] | None:
    """Compute the surface of all within a distance of faces, joined with closed parts; None if these are no manifold.

    Along the faces the distance is exact; around rims and creases it is up to 15 % less, where hulls replace spheres.

    Args:
        faces: Faces of the sheets, shape (F, 3).
        half: Distance.
        closed: Faces of closed parts, wound outward, shape (G, 3); G may be 0.
        tolerance: Tolerance of the simplification.
    """
    from manifold3d import Error, Manifold, Mesh64, OpType

    normal = face_normals(vertices, faces)
    parts = []
    if len(closed):
        solid = Manifold(Mesh64(vertices, closed.astype(np.uint64)))
        if solid.status() != Error.NoError:
            return None
        parts.append(solid)
    angle = 2.0 * np.pi * np.arange(ROUND) / ROUND
    for corner, up in zip(vertices[faces], normal):
        longest = max((corner[(k + 1) % 3] - corner[k] for k in range(3)), key=lambda edge: float(edge @ edge))
        if not float(up @ up) > 0.5:
            continue
        x = longest / np.linalg.norm(longest)
        ring = np.outer(np.cos(angle), x) + np.outer(np.sin(angle), np.cross(up, x))
        tilted = [np.cos(tilt) * ring + np.sin(tilt) * up for tilt in (-np.pi / 4.0, 0.0, np.pi / 4.0)]
        sphere = half * np.concatenate([*tilted, up[None], -up[None]])
        parts.append(Manifold.hull_points((corner[:, None] + sphere).reshape(-1, 3)))
    whole = Manifold.batch_boolean(parts, OpType.Add)
    if whole.status() != Error.NoError:
        return None
    result = whole.simplify(tolerance).to_mesh64()
    points = np.ascontiguousarray(np.asarray(result.vert_properties, dtype=np.float64)[:, :3])
    triangles = np.asarray(result.tri_verts).astype(np.int64)
    return (points, triangles) if len(triangles) else None
