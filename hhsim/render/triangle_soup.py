"""Surfaces for pictures: round cones, meshes and arrows, as triangles with normals and colours.

A hand is sixteen rigid pieces, fifteen phalanges and a palm, with their poses tick by tick. A phalanx's own frame has
its origin at the joint, x along its flexion axis, y to the fingertip and z out of its back; the palm's is the palm
frame.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.fingers import BODIES, FINGERS, PHALANX_NAMES
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, quaternion_product, rotation_matrix
from hhsim.mesh.mesh import Mesh

if TYPE_CHECKING:
    from hhsim.hand.model import HandModel

SKIN = np.array([0.91, 0.70, 0.58])
SPHERE = np.array([0.42, 0.62, 0.78])
STONE = np.array([0.80, 0.80, 0.78])
PIECES = tuple(f"{finger}/{phalanx}" for finger in FINGERS for phalanx in PHALANX_NAMES) + ("palm",)
"""Names of the pieces, in the order of the kernels' bodies."""

RINGS, SIDES = 8, 24
"""Rings to each end of a phalanx's mesh, and corners of a ring."""
FINE = (28, 48)
"""The same for a picture that is looked at closely."""
NAIL = np.array([0.97, 0.83, 0.77])


@dataclass(frozen=True)
class Surface:
    """Triangles with a normal and a colour a vertex; [m], shapes (n, 3), (n, 3), (n, 3), (m, 3)."""

    points: FloatArray
    normals: FloatArray
    colors: FloatArray
    faces: IntArray


def joined(parts: Sequence[Surface]) -> Surface:
    """Join surfaces to one."""
    offsets = np.cumsum([0] + [len(part.points) for part in parts])
    return Surface(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colors for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets)]),
    )


def painted(surface: Surface, color: FloatArray) -> Surface:
    """Return the surface in one colour."""
    return replace(surface, colors=np.tile(color, (len(surface.points), 1)))


def moved(surface: Surface, rotation: FloatArray, translation: FloatArray) -> Surface:
    """Return the surface turned by `rotation`, shape (3, 3), and moved by `translation` [m], shape (3,)."""
    points, normals = surface.points @ rotation.T + translation, surface.normals @ rotation.T
    return replace(surface, points=points, normals=normals)


def arrow_surface(start: FloatArray, vector: FloatArray, radius: float, color: FloatArray) -> Surface:
    """Return an arrow from `start` along `vector` [m], its shaft of `radius` [m]; a short one is all head."""
    length = float(np.linalg.norm(vector))
    tip = start + vector
    neck = start + vector * max(0.0, 1.0 - 7.0 * radius / length)
    wide = min(2.5 * radius, 0.4 * length)
    head = round_cone_surface(neck, tip, wide, 0.1 * wide, color, rings=14, sides=32)
    return joined([round_cone_surface(start, neck, radius, radius, color, rings=14, sides=32), head])


def round_cone_surface(
    a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, color: FloatArray, rings: int = 28, sides: int = 48
) -> Surface:
    """Return the surface of the hull of two spheres [m]; one sphere where a and b coincide."""
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    tangent = float(np.arcsin(min((radius_a - radius_b) / length, 1.0))) if length > 0.0 else 0.0
    rear, front = np.linspace(-0.5 * np.pi, tangent, rings), np.linspace(tangent, 0.5 * np.pi, rings)
    latitude = np.concatenate([rear, front])
    radius = np.repeat([radius_a, radius_b], rings)
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radial = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
    normals = np.sin(latitude)[:, None, None] * axis + np.cos(latitude)[:, None, None] * radial
    points = np.repeat([a, b], rings, axis=0)[:, None] + radius[:, None, None] * normals
    ring, side = np.meshgrid(np.arange(2 * rings - 1), np.arange(sides), indexing="ij")
    p, q = (ring * sides + side).ravel(), (ring * sides + (side + 1) % sides).ravel()
    faces = np.concatenate([np.stack([p, q, q + sides], axis=1), np.stack([p, q + sides, p + sides], axis=1)])
    normals = normals.reshape(-1, 3)
    return Surface(points.reshape(-1, 3), normals, np.tile(color, (len(normals), 1)), faces.astype(np.int64))


def mesh_surface(mesh: Mesh, color: FloatArray, crease: float = 55.0) -> Surface:
    """Return a mesh smooth across edges of less than `crease` [degrees] and sharp at the others."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    unit = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-300)
    corners = mesh.faces.ravel()
    # Every corner beside every corner of the same vertex, those of a vertex one after another.
    order = np.argsort(corners, kind="stable")
    _, first, count = np.unique(corners[order], return_index=True, return_counts=True)
    start, size = np.repeat(first, count), np.repeat(count, count)
    corner, other = np.repeat(order, size), order[np.repeat(start, size) + count_up(size)]
    smooth = np.einsum("ni,ni->n", unit[corner // 3], unit[other // 3]) > np.cos(np.radians(crease))
    normals = np.empty((len(corners), 3))
    for axis in range(3):
        normals[:, axis] = np.bincount(corner[smooth], area[other[smooth] // 3, axis], minlength=len(corners))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return Surface(mesh.vertices[corners], normals, np.tile(color, (len(corners), 1)), faces)


def count_up(lengths: IntArray) -> IntArray:
    """Return 0, 1, … up to each length, one after another."""
    ends = np.cumsum(lengths)
    return np.asarray(np.arange(lengths.sum()) - np.repeat(ends - lengths, lengths))


FAR, NEAR = 1.2, 0.5
"""An object that goes beyond FAR times the hands' size from them is cut NEAR times that size from them."""


def near_hands(mesh: Mesh, hands: FloatArray) -> Mesh:
    """Return an object whole or, if it is much larger than the hands, its part near their points [m], shape (n, 3)."""
    low, high = hands.min(axis=0), hands.max(axis=0)
    size = float(np.linalg.norm(high - low))
    least, most = mesh.bounds
    if (least >= low - FAR * size).all() and (most <= high + FAR * size).all():
        return mesh
    part = clipped(mesh, low - NEAR * size, high + NEAR * size)
    # A hand that is far from it is shown with all of it.
    return mesh if part is None else part


def clipped(mesh: Mesh, low: FloatArray, high: FloatArray) -> Mesh | None:
    """Return the part of a mesh inside a box of corners `low` and `high` [m], open where it was cut; None if empty."""
    from trimesh import intersections

    cut: Any = intersections.slice_faces_plane
    vertices, faces = mesh.vertices, mesh.faces
    for normal in np.eye(3):
        vertices, faces, _ = cut(vertices, faces, normal, low)
        vertices, faces, _ = cut(vertices, faces, -normal, high)
    return replace(mesh, vertices=vertices, faces=faces) if len(faces) else None


class PiecePoses(NamedTuple):
    """Poses of the sixteen pieces: translation (T, 16, 3) [m], quaternion (T, 16, 4) w x y z; piece to world."""

    translation: FloatArray
    quaternion: FloatArray


def piece_surfaces(hand: "HandModel", rings: int = RINGS, sides: int = SIDES) -> tuple[Surface, ...]:
    """Return the surface of each piece in its own frame, of so many rings to each end of a phalanx."""
    surfaces = []
    for finger in range(len(FINGERS)):
        for k in range(len(PHALANX_NAMES)):
            length = hand.length[finger, k]
            radius_a, radius_b = hand.radius[finger, k : k + 2]
            tip = np.array([0.0, length, 0.0])
            surfaces.append(round_cone_surface(np.zeros(3), tip, radius_a, radius_b, SKIN, rings=rings, sides=sides))
        # The nail, on the back of the distal phalanx.
        distal = surfaces[-1]
        along = (distal.points[:, 1] - length) / (0.55 * length)
        across = distal.points[:, 0] / (0.4 * length)
        nail = (np.abs(along + 0.1) ** 3 + np.abs(across) ** 3 < 1.0) & (distal.normals[:, 2] > 0.3)
        surfaces[-1] = replace(distal, colors=np.where(nail[:, None], NAIL, distal.colors))
    return (*surfaces, mesh_surface(hand.palm_mesh, SKIN))


def hand_surface(hand: "HandModel", pose: Iterable[ArrayLike], pieces: Sequence[Surface] = ()) -> Surface:
    """Return the hand's surface in the world frame, of `pieces` as of `piece_surfaces`, or else of fine ones.

    `pose` has the fields of a `HandConfiguration`, the arguments of `HandModel.joints`.
    """
    position, orientation, flexion, abduction = (np.asarray(values, np.float64)[None] for values in pose)
    poses = piece_poses(hand, position, orientation, flexion, abduction)
    places, turns = poses.translation[0], rotation_matrix(poses.quaternion[0])
    shown = pieces or piece_surfaces(hand, *FINE)
    return joined([moved(piece, turn, place) for piece, turn, place in zip(shown, turns, places)])


def piece_poses(
    hand: "HandModel", position: ArrayLike, orientation: ArrayLike, flexion: ArrayLike, abduction: ArrayLike
) -> PiecePoses:
    """Compute the poses of the pieces.

    Palm origins [m], world, have shape (T, 3), palms' unit quaternions (w, x, y, z) to the world (T, 4); flexion [rad]
    has shape (T, 5, 3), abduction [rad] (T, 5).
    """
    origin, palm = np.asarray(position, np.float64), np.asarray(orientation, np.float64)
    frames = np.stack([np.cross(hand.distal, hand.dorsal), hand.distal, hand.dorsal], axis=-1)
    base = quaternion_product(palm[:, None], quaternion_from_matrix(frames))
    # A turn about the finger's back, then one about the axis that it flexes about.
    spread = quaternion(hand.abduction_sign * np.asarray(abduction)[..., None] * np.eye(3)[2])
    bend = quaternion(-np.cumsum(np.asarray(flexion), axis=2)[..., None] * np.eye(3)[0])
    turn = quaternion_product(quaternion_product(base, spread)[:, :, None], bend)
    joint = np.empty((len(origin), len(FINGERS), len(PHALANX_NAMES), 3))
    joint[:, :, 0] = origin[:, None] + np.einsum("tij,fj->tfi", rotation_matrix(palm), hand.base)
    along = hand.length[:, :-1, None] * rotation_matrix(turn[:, :, :-1])[..., 1]
    joint[:, :, 1:] = joint[:, :, :1] + np.cumsum(along, axis=2)
    return PiecePoses(
        np.concatenate([joint.reshape(-1, BODIES - 1, 3), origin[:, None]], axis=1),
        np.concatenate([turn.reshape(-1, BODIES - 1, 4), palm[:, None]], axis=1),
    )


def look_from(towards: ArrayLike) -> FloatArray:
    """Return a camera's rotation for a viewer in the direction `towards`, with the z axis upright in the picture."""
    to_viewer = np.array(towards, dtype=np.float64)
    to_viewer /= np.linalg.norm(to_viewer)
    right = np.cross((0.0, 0.0, 1.0), to_viewer)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(to_viewer, right), to_viewer])
