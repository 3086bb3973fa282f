"""Intersection volume (IV) of hand and object, exact: of closed solids, by manifold3d.

The hand at a frame is its skin, closed at the wrist, or the union of its round cones and spheres.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.palm_mesh import RoundCones
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import boundary_loops, manifold_of
from hhsim.metrics.field.hands import FieldHands
from hhsim.metrics.mesh_penetration import sampled

if TYPE_CHECKING:
    from manifold3d import Manifold

KEPT = 16
"""Meshes whose solids a process keeps."""
SEGMENTS = 32
"""Edges around the polyhedron of a sphere: inscribed, it encloses 2.3 % less, and nothing outside."""


def closed_skin(skin: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Close each open border of a skin with a fan around its mean, as at the wrist of a MANO hand.

    Vertices [m], (T, V, 3), get one more a border, and triangles, (F, 3), are wound outward if those of the skin are.
    """
    loops, first = boundary_loops(faces), skin.shape[1]
    fans = [np.stack([np.full(len(loop), first + k), np.roll(loop, -1), loop], axis=1) for k, loop in enumerate(loops)]
    middles = [skin[:, loop].mean(axis=1, keepdims=True) for loop in loops]
    return np.concatenate([skin, *middles], axis=1), np.concatenate([faces, *fans])


def hand_solids(hands: FieldHands) -> Callable[[int], "list[Manifold] | None"] | None:
    """Return a function of the frame that makes solids whose union is the hand there; None without skin and cones.

    The solids are None where the skin is no closed surface. Of cones they are those that may touch the object.
    """
    if hands.skin is not None and hands.faces is not None:
        vertices, faces = closed_skin(hands.skin, hands.faces)
        first = int(np.argmax(hands.known))
        if hands.known.any() and Mesh(vertices[first], faces).volume < 0.0:
            faces = faces[:, ::-1]
        return lambda frame: None if (solid := manifold_of(vertices[frame], faces)) is None else [solid]
    return None if hands.shape is None else lambda frame: _polyhedra(_cones_near(hands, frame))


def _cones_near(hands: FieldHands, frame: int) -> RoundCones:
    """Return the round cones and palm spheres of a frame that may touch the object."""
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
    near = ends - 0.5 * np.linalg.norm(b - a, axis=1) < np.maximum(radius_a, radius_b)
    return RoundCones(a[near], b[near], radius_a[near], radius_b[near])


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


@lru_cache(maxsize=KEPT)
def _object_solid(mesh: Mesh) -> "Manifold | None":
    return manifold_of(mesh.vertices, mesh.faces)


@lru_cache(maxsize=2)
def volumes(hands: FieldHands, most: int = 0) -> FloatArray:
    """Compute the intersection volume of each frame [m³], shape (T,).

    Of `most` frames, spread evenly, and of the deepest one; 0 for all. NaN in the others, in missing ones, without skin
    and cones, and where a surface is not closed.
    """
    found, bodies, solids_of = np.full(len(hands.time), np.nan), hands.bodies, hand_solids(hands)
    targets = [solid for solid in map(_object_solid, bodies.meshes) if solid is not None]
    if solids_of is None or len(targets) < len(bodies.meshes):
        return found
    from manifold3d import Manifold, OpType

    frames = np.flatnonzero(hands.known)
    if 0 < most < frames.size:
        frames = sampled(frames, most, [frames[int(np.argmin(hands.distance[frames]))]])
    for frame in frames.tolist():
        # Cones that are outside share no volume; the vertices of a skin tell less.
        solids = [] if hands.skin is None and hands.distance[frame] >= 0.0 else solids_of(frame)
        if solids is None:
            continue
        there = [
            target.transform(np.column_stack([rotation_matrix(motion.turn[frame]), motion.shift[frame]]))
            for target, motion in zip(targets, bodies.motions)
        ]
        # Pieces are smaller than the hand, and their union is faster.
        pieces = [solid ^ target for target in there or targets for solid in solids]
        found[frame] = Manifold.batch_boolean(pieces, OpType.Add).volume()
    return found
