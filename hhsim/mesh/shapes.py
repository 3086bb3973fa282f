"""Closed triangle meshes of boxes, cylinders, capsules, spheres and ellipsoids about the origin."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.reproducible import sine_and_cosine

Triangles = tuple[FloatArray, IntArray]
"""Vertices [m], shape (V, 3), and faces, shape (F, 3), wound outward."""
ROUND = 44
"""Corners of a circle: chords are 0.26 % of the radius inside, a ball's facets 0.51 %; a free body may have no more."""
ENCLOSING = float(1.0 / sine_and_cosine(np.pi / ROUND)[1] ** 2)
"""Factor [-] of the radius with which the triangles of a round shape enclose it."""
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
"""Corners of a cube of edge 1 about the origin, and its triangles."""


def box(edges: Sequence[float] | FloatArray) -> Triangles:
    """Return a box by its edges [m]."""
    return _CORNERS * np.asarray(edges, np.float64), _SIDES


def box_mesh(edges: Sequence[float], name: str = "") -> Mesh:
    """Return the mesh of a box about the origin by its edges [m]."""
    return Mesh(*box(edges), name=name, source="box")


def cylinder(radius: float, length: float) -> Triangles:
    """Return a cylinder along z by its radius and length [m]."""
    return _revolved([(radius, -0.5 * length), (radius, 0.5 * length)], -0.5 * length, 0.5 * length)


def capsule(radius: float, length: float) -> Triangles:
    """Return a capsule along z by its radius and the distance [m] of the centres of its ends; 0 is a sphere."""
    sine, cosine = sine_and_cosine(np.pi * np.arange(1, ROUND // 2) / (ROUND // 2))
    rings = np.stack([radius * sine, -radius * cosine], axis=1)
    half = ROUND // 4
    low, high = rings[:half] - [0.0, 0.5 * length], rings[half - 1 :] + [0.0, 0.5 * length]
    profile = rings if length == 0.0 else np.concatenate([low, high])
    return _revolved(profile, -radius - 0.5 * length, radius + 0.5 * length)


def ellipsoid(radii: Sequence[float] | FloatArray) -> Triangles:
    """Return an ellipsoid by its three radii [m]; a sphere has three equal ones."""
    vertices, faces = capsule(1.0, 0.0)
    return vertices * np.asarray(radii, np.float64), faces


def _revolved(profile: FloatArray | Sequence[tuple[float, float]], bottom: float, top: float) -> Triangles:
    """Return rings about z by their radii and heights [m], shape (R, 2), from the lowest on, between two poles."""
    rings = np.asarray(profile, np.float64)
    sine, cosine = sine_and_cosine(2.0 * np.pi * np.arange(ROUND) / ROUND)
    places = [rings[:, :1] * cosine, rings[:, :1] * sine, np.repeat(rings[:, 1:], ROUND, axis=1)]
    vertices = np.concatenate([[[0.0, 0.0, bottom]], np.stack(places, axis=2).reshape(-1, 3), [[0.0, 0.0, top]]])
    here, ahead = np.arange(ROUND), np.roll(np.arange(ROUND), -1)
    first, last = np.zeros(ROUND, np.int64), np.full(ROUND, len(vertices) - 1)
    highest = 1 + ROUND * (len(rings) - 1)
    faces = [np.stack([first, 1 + ahead, 1 + here], axis=1)]
    for ring in range(len(rings) - 1):
        low, high = 1 + ROUND * ring, 1 + ROUND * (ring + 1)
        faces.append(np.stack([low + here, low + ahead, high + ahead], axis=1))
        faces.append(np.stack([low + here, high + ahead, high + here], axis=1))
    faces.append(np.stack([last, highest + here, highest + ahead], axis=1))
    return vertices, np.concatenate(faces)
