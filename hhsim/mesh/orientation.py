"""Outer side of loose triangles: the one that sees more of the far away.

After Takayama, Jacobson, Kavan and Sorkine-Hornung, "A simple method for correcting facet orientations in polygon
meshes based on ray-casting" (2014): rays from both sides of each part; those that meet nothing count.
"""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.mesh.inside_field import count_hits
from hhsim.mesh.topology import alike_wound, face_areas, part_labels

RAYS = 60_000
"""Total number of rays, shared out by area."""
LEAST_RAYS = 12
"""Least number of rays from each part."""
CLEAR = 0.1
"""A part is turned where its back sees more by this share of its rays: a few reach a cavity through a hole."""

SEED = 20131


def turned_outward(vertices: FloatArray, faces: IntArray, start: float) -> tuple[IntArray, int]:
    """Wind neighbours alike, and each part so that its front sees more of the far away; also return the number turned.

    A part that sees hardly anything from either side keeps its winding: it may be a cavity or a solid within a solid,
        and only the author of the file knows.

    Args:
        vertices: Corners, shape (V, 3).
        faces: Indices, shape (F, 3), wound in any way.
        start: Distance of a ray's start from its triangle [unit of the vertices].
    """
    wound = alike_wound(faces, one_sided=True)
    assert wound is not None
    result = wound[0].copy()
    label = part_labels(result)
    parts = int(label.max()) + 1
    area = face_areas(vertices, result)
    a, b, c = vertices[result].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(2.0 * area, np.finfo(np.float64).tiny)[:, None]
    part_area = np.bincount(label, weights=area, minlength=parts)
    number = np.maximum(LEAST_RAYS, np.ceil(RAYS * part_area / max(part_area.sum(), np.finfo(np.float64).tiny)))
    rng = np.random.default_rng(SEED)
    face = _faces_by_area(area, label, number.astype(np.int64), rng)
    u, v = rng.random((2, len(face)))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    place = a[face] + u[:, None] * (b - a)[face] + v[:, None] * (c - a)[face]
    direction = rng.normal(size=(len(face), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    up = normal[face]
    # The same ray from both sides, mirrored.
    direction *= np.sign(np.einsum("ij,ij->i", direction, up))[:, None]
    reach = 4.0 * float(np.ptp(vertices, axis=0).max())
    bvh = build_mesh_bvh(vertices, faces, signed=False)
    score = np.zeros(parts)
    for side in (1.0, -1.0):
        along = side * reach * direction
        hits = np.empty(len(face), np.int64)
        count_hits(bvh, np.ascontiguousarray(place + side * start * up), np.ascontiguousarray(along), hits)
        score += side * np.bincount(label[face], weights=hits == 0, minlength=parts)
    inward = (score < -CLEAR * number)[label]
    result[inward] = result[inward][:, ::-1]
    return result, int(np.count_nonzero((result != faces).any(axis=1)))


def _faces_by_area(area: FloatArray, label: IntArray, number: IntArray, rng: np.random.Generator) -> IntArray:
    """Random faces, by area within each part, as many for each part as `number` says."""
    order = np.argsort(label, kind="stable")
    reached = np.cumsum(area[order])
    last = np.searchsorted(label[order], np.arange(len(number)), side="right") - 1
    end = reached[last]
    begin = np.concatenate([[0.0], end[:-1]])
    part = np.repeat(np.arange(len(number)), number)
    at = np.searchsorted(reached, begin[part] + rng.random(len(part)) * (end - begin)[part], side="right")
    return np.asarray(order[np.clip(at, 0, len(order) - 1)])
