"""Hands beside a box of known figures, which the tests of the field's figures share."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import FieldHands

HALF = 0.05
"""Half an edge of the box, whose middle is the origin [m]."""
RADIUS = 0.01
"""Radius of the sphere at the index fingertip [m]."""


def box(half: float = HALF) -> Mesh:
    """A closed cube."""
    made = trimesh.creation.box(extents=[2.0 * half] * 3)
    return Mesh(made.vertices, made.faces)


def joints_at(height: ArrayLike, frames: int) -> FloatArray:
    """Joints over the top of the box at these heights [m], shape (T, 21) or less, 1 mm apart."""
    joints = np.zeros((frames, 21, 3))
    joints[..., 0] = 0.001 * np.arange(21)
    joints[..., 2] = HALF + np.broadcast_to(height, (frames, 21))
    return joints


def hands_at(height: ArrayLike, frames: int = 1, **others: Any) -> FieldHands:
    """A hand of joints alone, 30 frames a second."""
    return FieldHands(np.arange(frames) / 30.0, joints_at(height, frames), box(), **others)


def sphere_hand(height: float) -> FieldHands:
    """A hand of one sphere, at the index fingertip, whose centre is at a height over the top of the box [m]."""
    joints = np.zeros((1, 21, 3)) + [0.0, 0.0, HALF + 0.2]
    joints[0, 5:9] = [0.0, 0.0, HALF + height]
    radius = np.full((5, 4), 1e-4)
    radius[1] = RADIUS
    shape = HandShape(radius, np.zeros((0, 3)), np.zeros(0))
    placed = PlacedHand(joints[:, 1:].reshape(1, 5, 4, 3).copy(), np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
    return FieldHands(np.zeros(1), joints, box(), shape=shape, placed=placed)


def open_box(low: ArrayLike, high: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Vertices and faces of a box without its top, from its lowest to its highest corner [m]."""
    made = trimesh.creation.box(bounds=np.array([low, high], dtype=np.float64))
    kept = ~(made.triangles[:, :, 2] == np.asarray(high)[2]).all(axis=1)
    return np.array(made.vertices), np.array(made.faces[kept])


def skin_hand(low: ArrayLike, high: ArrayLike, inward: bool = False, **others: Any) -> FieldHands:
    """A hand of one frame whose skin is `open_box`."""
    vertices, faces = open_box(low, high)
    faces = faces[:, ::-1] if inward else faces
    return hands_at(0.2, skin=vertices[None], faces=faces, **others)
