"""Closed solid of a hand at one frame: its skin, closed at the wrist, or the union of its round cones and spheres."""

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.palm_mesh import RoundCones
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import FieldHands

if TYPE_CHECKING:
    from manifold3d import Manifold

SEGMENTS = 32
"""Edges around the polyhedron of a sphere: inscribed, it encloses 2.3 % less, and nothing outside."""


def closed_skin(skin: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Close each open border of a skin with a fan around its mean, as at the wrist of a MANO hand.

    Vertices [m], (T, V, 3), get one more a border, and triangles, (F, 3), are wound outward if those of the skin are.
    """
    edges = {(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1))}
    following = {b: a for a, b in edges if (b, a) not in edges}
    corners, middles = [*faces.tolist()], [skin]
    while following:
        border = [next(iter(following))]
        while (after := following.pop(border[-1], None)) is not None:
            border.append(after)
        middle = skin.shape[1] + len(middles) - 1
        corners += [(middle, a, b) for a, b in pairwise(border)]
        middles.append(skin[:, border[:-1]].mean(axis=1, keepdims=True))
    return np.concatenate(middles, axis=1), np.array(corners, dtype=np.int64)


def hand_solids(hands: FieldHands, margin: float = 0.0) -> Callable[[int], "list[Manifold] | None"] | None:
    """Return a function of the frame that makes solids whose union is the hand there; None without skin and cones.

    The solids are None where the skin is no closed surface. Of cones they are those that may be within a margin [m] of
    the object.
    """
    if hands.skin is not None and hands.faces is not None:
        vertices, faces = closed_skin(hands.skin, hands.faces)
        first = int(np.argmax(hands.known))
        if hands.known.any() and Mesh(vertices[first], faces).volume < 0.0:
            faces = faces[:, ::-1]
        return lambda frame: None if (solid := manifold_of(vertices[frame], faces)) is None else [solid]
    return None if hands.shape is None else lambda frame: _polyhedra(cones_near(hands, frame, margin))


def cones_near(hands: FieldHands, frame: int, margin: float) -> RoundCones:
    """Return the round cones and palm spheres of a frame that may be within a margin [m] of the object."""
    assert hands.shape is not None and hands.placed is not None
    shape, placed = hands.shape, hands.placed
    palm = placed.position[frame] + shape.palm_center @ rotation_matrix(placed.orientation[frame]).T
    chains = placed.joints[frame]
    a = np.concatenate([chains[:, :3].reshape(-1, 3), palm])
    b = np.concatenate([chains[:, 1:].reshape(-1, 3), palm])
    radius_a = np.concatenate([shape.phalanx_radius[:, :3].ravel(), shape.palm_radius])
    radius_b = np.concatenate([shape.phalanx_radius[:, 1:].ravel(), shape.palm_radius])
    ends = hands.bodies.at(frame).distance(np.stack([a, b])[None])[0].min(axis=0)
    # No point of an axis is farther from its nearer end than half its length.
    near = ends - 0.5 * np.linalg.norm(b - a, axis=1) < np.maximum(radius_a, radius_b) + margin
    return RoundCones(a[near], b[near], radius_a[near], radius_b[near])


def cones_contain(cones: RoundCones, points: FloatArray) -> BoolArray:
    """Return which points, shape (n, 3), are inside one of the round cones: unions of balls along their axes."""
    inside = np.zeros(len(points), bool)
    if not len(cones.a):
        return inside
    ends, radii = np.concatenate([cones.a, cones.b]), np.concatenate([cones.radius_a, cones.radius_b])[:, None]
    near = ((points > (ends - radii).min(axis=0)) & (points < (ends + radii).max(axis=0))).all(axis=1)
    points = points[near]
    axis = cones.b - cones.a
    length = np.linalg.norm(axis, axis=1)
    unit = axis / np.maximum(length, 1e-12)[:, None]
    offset = points[:, None] - cones.a
    along = (offset * unit).sum(axis=2)
    across = np.sqrt(np.maximum((offset * offset).sum(axis=2) - along**2, 0.0))
    slope = np.clip((cones.radius_a - cones.radius_b) / np.maximum(length, 1e-12), -1.0 + 1e-9, 1.0 - 1e-9)
    # Centre of the ball that reaches farthest past the point, along the axis.
    best = np.clip(along - slope / np.sqrt(1.0 - slope**2) * across, 0.0, length)
    between = np.hypot(along - best, across) < cones.radius_a - slope * best
    # Where one end's ball holds the other's, nothing lies between them.
    start, end = np.linalg.norm(offset, axis=2), np.linalg.norm(points[:, None] - cones.b, axis=2)
    inside[near] = (between | (start < cones.radius_a) | (end < cones.radius_b)).any(axis=1)
    return inside


def manifold_of(vertices: FloatArray, faces: IntArray) -> "Manifold | None":
    """Return a closed surface as a solid of manifold3d, None if it has open or branching edges."""
    from manifold3d import Error, Manifold, Mesh64

    solid = Manifold(Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces).astype(np.uint64)))
    return solid if solid.status() == Error.NoError else None


def _polyhedra(cones: RoundCones) -> "list[Manifold]":
    from manifold3d import Manifold

    ball = unit_ball()
    return [
        Manifold.hull_points(np.concatenate([a + radius_a * ball, b + radius_b * ball]))
        for a, b, radius_a, radius_b in zip(*cones)
    ]


@lru_cache(maxsize=1)
def unit_ball() -> FloatArray:
    """Vertices of the polyhedron of the unit sphere, shape (n, 3)."""
    from manifold3d import Manifold

    return np.asarray(Manifold.sphere(1.0, SEGMENTS).to_mesh64().vert_properties, dtype=np.float64)[:, :3]
