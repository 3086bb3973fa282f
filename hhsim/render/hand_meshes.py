"""A hand as sixteen rigid pieces, fifteen phalanges and a palm, and their poses tick by tick.

A phalanx's own frame has its origin at the joint, x along its flexion axis, y to the fingertip and z out of its back;
the palm's is the palm frame.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix, quaternion_product, rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT
from hhsim.render.triangle_soup import SKIN, Surface, mesh_surface, round_cone_surface, with_nail

PHALANGES = ("proximal", "middle", "distal")
"""Names of the phalanges of a finger; the thumb's metacarpal counts as its first."""

PIECES = tuple(f"{finger}/{phalanx}" for finger in FINGERS for phalanx in PHALANGES) + ("palm",)
"""Names of the pieces, in the order of the kernels' bodies."""

RINGS, SIDES = 8, 24
"""Rings to each end of a phalanx's mesh, and corners of a ring."""


class PiecePoses(NamedTuple):
    """Poses of the sixteen pieces: translation (T, 16, 3) [m], quaternion (T, 16, 4) w x y z; piece to world."""

    translation: FloatArray
    quaternion: FloatArray


def piece_surfaces(hand: HandModel) -> tuple[Surface, ...]:
    """Return the surface of each piece in its own frame."""
    surfaces = []
    for finger in range(len(FINGERS)):
        for k in range(PHALANX_COUNT):
            tip = np.array([0.0, hand.length[finger, k], 0.0])
            radius_a, radius_b = hand.radius[finger, k : k + 2]
            surface = round_cone_surface(np.zeros(3), tip, radius_a, radius_b, SKIN, rings=RINGS, sides=SIDES)
            if k == PHALANX_COUNT - 1:
                ends = np.array([np.zeros(3), np.zeros(3), np.zeros(3), tip])
                surface = with_nail(surface, ends, np.array([0.0, 0.0, 1.0]))
            surfaces.append(surface)
    return (*surfaces, mesh_surface(hand.palm_mesh, SKIN))


def piece_poses(
    hand: HandModel, position: ArrayLike, orientation: ArrayLike, flexion: ArrayLike, abduction: ArrayLike
) -> PiecePoses:
    """Compute the poses of the pieces.

    Args:
        position: Palm origin [m], world, shape (T, 3).
        orientation: Palm to world, unit (w, x, y, z), shape (T, 4).
        flexion: [rad], shape (T, 5, 3).
        abduction: [rad], shape (T, 5).
    """
    origin, palm = np.asarray(position, np.float64).T, np.asarray(orientation, np.float64).T
    # Ticks last: all that is done here is done along them, and a viewer takes a piece's poses from one stretch.
    bend = np.cumsum(np.transpose(np.asarray(flexion, np.float64), (1, 2, 0)), axis=1)
    sign = hand.abduction_sign
    half_spread, half_bend = 0.5 * sign * np.asarray(abduction, np.float64).T, -0.5 * bend
    frames = np.stack([np.cross(hand.distal, hand.dorsal), hand.distal, hand.dorsal], axis=-1)
    fingers_base = quaternion_product(palm.T, quaternion_from_matrix(frames)[:, None])
    # A turn about the finger's back, then one about the axis that it flexes about.
    (w, x, y, z), cos, sin = np.moveaxis(fingers_base, -1, 0), np.cos(half_spread), np.sin(half_spread)
    w, x, y, z = w * cos - z * sin, x * cos + y * sin, y * cos - x * sin, z * cos + w * sin
    w, x, y, z = (part[:, None] for part in (w, x, y, z))
    cos, sin = np.cos(half_bend), np.sin(half_bend)
    w, x, y, z = w * cos - x * sin, x * cos + w * sin, y * cos + z * sin, z * cos - y * sin
    ticks = origin.shape[1]
    quaternion = np.empty((PALM_BODY + 1, ticks, 4))
    fingers = quaternion[:PALM_BODY].reshape(len(FINGERS), PHALANX_COUNT, ticks, 4)
    for i, part in enumerate((w, x, y, z)):
        fingers[..., i] = part
    quaternion[PALM_BODY] = palm.T

    translation = np.empty((PALM_BODY + 1, ticks, 3))
    joint = translation[:PALM_BODY].reshape(len(FINGERS), PHALANX_COUNT, ticks, 3)
    direction = (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x))
    for i, rows in enumerate(np.ascontiguousarray(np.moveaxis(rotation_matrix(palm.T), 0, -1))):
        joint[:, 0, :, i] = origin[i] + hand.base @ rows
        for k in range(1, PHALANX_COUNT):
            joint[:, k, :, i] = joint[:, k - 1, :, i] + hand.length[:, k - 1, None] * direction[i][:, k - 1]
    translation[PALM_BODY] = origin.T
    return PiecePoses(translation.transpose(1, 0, 2), quaternion.transpose(1, 0, 2))
