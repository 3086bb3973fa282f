"""Surfaces for pictures: round cones, meshes, the hand and arrows, as triangles with normals and colours."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import forward_kinematics
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.mesh.mesh import Mesh

SKIN = np.array([0.91, 0.70, 0.58])
NAIL = np.array([0.97, 0.83, 0.77])
SPHERE = np.array([0.42, 0.62, 0.78])


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


def hand_surface(
    hand: HandModel,
    position: ArrayLike,
    orientation: ArrayLike,
    flexion: ArrayLike,
    abduction: ArrayLike,
    hybrid: bool = False,
) -> Surface:
    """Return the hand's surface in the world frame; arguments as in `HandModel.joints`.

    `hybrid` shows the palm as its leaf spheres.
    """
    origin = np.array(position, dtype=np.float64)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(np.array(orientation, dtype=np.float64), rotation)
    joints, direction = np.empty((5, 4, 3)), np.empty((5, 3, 3))
    flexion_axis, abduction_axis = np.empty((5, 3)), np.empty((5, 3))
    angles = np.array(flexion, dtype=np.float64), np.array(abduction, dtype=np.float64)
    forward_kinematics(hand.arrays(), origin, rotation, *angles, joints, direction, flexion_axis, abduction_axis)
    parts = []
    if hybrid:
        for center, radius in zip(hand.palm_tree.leaf_center @ rotation.T + origin, hand.palm_tree.leaf_radius):
            parts.append(round_cone_surface(center, center, radius, radius, SPHERE, rings=14, sides=44))
    else:
        palm = mesh_surface(hand.palm_mesh, SKIN)
        parts.append(replace(palm, points=palm.points @ rotation.T + origin, normals=palm.normals @ rotation.T))
    for finger in range(len(FINGERS)):
        for k in range(3):
            radius_a, radius_b = hand.radius[finger, k : k + 2]
            parts.append(round_cone_surface(joints[finger, k], joints[finger, k + 1], radius_a, radius_b, SKIN))
        back = np.cross(direction[finger, 2], flexion_axis[finger])
        parts[-1] = with_nail(parts[-1], joints[finger], back)
    return joined(parts)


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


def with_nail(distal: Surface, joints: FloatArray, back: FloatArray) -> Surface:
    """Colour the nail on the back of a distal phalanx; joints [m], shape (4, 3), and unit normal of the back."""
    axis = joints[3] - joints[2]
    length = float(np.linalg.norm(axis))
    axis = axis / length
    side = np.cross(axis, back)
    offset = distal.points - joints[3]
    along = offset @ axis / (0.55 * length)
    across = offset @ side / (0.4 * length)
    nail = ((np.abs(along + 0.1) ** 3 + np.abs(across) ** 3) < 1.0) & (distal.normals @ back > 0.3)
    return Surface(distal.points, distal.normals, np.where(nail[:, None], NAIL, distal.colors), distal.faces)


FAR, NEAR = 1.2, 0.5
"""An object that goes beyond FAR times the hands' size from them is cut NEAR times that size from them."""


def near_hands(body: Surface, hands: FloatArray) -> Surface:
    """Return an object whole or, if it is much larger than the hands, its part near their points [m], shape (n, 3)."""
    low, high = hands.min(axis=0), hands.max(axis=0)
    size = float(np.linalg.norm(high - low))
    far = ((body.points < low - FAR * size) | (body.points > high + FAR * size)).any()
    part = clipped(body, low - NEAR * size, high + NEAR * size) if far else body
    # A hand that is far from it is shown with all of it.
    return part if len(part.faces) else body


def clipped(surface: Surface, low: ArrayLike, high: ArrayLike) -> Surface:
    """Return the part of a surface inside a box of corners `low` and `high` [m], with normals and colours."""
    for axis, (least, most) in enumerate(zip(np.asarray(low, np.float64), np.asarray(high, np.float64))):
        surface = _cut(surface, axis, 1.0, least)
        surface = _cut(surface, axis, -1.0, -most)
    return surface


def _cut(surface: Surface, axis: int, sign: float, least: float) -> Surface:
    """Return the part whose `sign` · coordinate is at least `least`."""
    height = sign * surface.points[:, axis] - least
    inside = height[surface.faces] >= 0.0
    count = inside.sum(axis=1)
    if (count == 3).all():
        return surface
    points = [surface.points, surface.normals, surface.colors]
    faces = [surface.faces[count == 3]]
    known = len(surface.points)
    for corners in (1, 2):
        # The corner that is alone on its side comes first; the order round the triangle stays.
        crossing = surface.faces[count == corners]
        alone = np.argmax(inside[count == corners] == (corners == 1), axis=1)
        a, b, c = (np.take_along_axis(crossing, (alone[:, None] + k) % 3, axis=1)[:, 0] for k in range(3))
        new = []
        for other in (b, c):
            share = (height[a] / (height[a] - height[other]))[:, None]
            for values, original in enumerate((surface.points, surface.normals, surface.colors)):
                points[values] = np.concatenate([points[values], original[a] + share * (original[other] - original[a])])
            new.append(known + np.arange(len(a)))
            known += len(a)
        p, q = new
        faces += (
            [np.stack([a, p, q], axis=1)]
            if corners == 1
            else [np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)]
        )
    points[1] = points[1] / np.maximum(np.linalg.norm(points[1], axis=1, keepdims=True), 1e-300)
    return replace(surface, points=points[0], normals=points[1], colors=points[2], faces=np.concatenate(faces))
