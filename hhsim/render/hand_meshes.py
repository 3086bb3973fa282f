"""A hand as sixteen rigid pieces, fifteen phalanges and a palm, and their poses tick by tick.

A phalanx's own frame has its origin at the joint, x along its flexion axis, y to the fingertip and z out of its back;
the palm's is the palm frame.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix, quaternion_product, rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT
from hhsim.render.triangle_soup import SKIN, Surface, joined, mesh_surface, moved, round_cone_surface

PHALANGES = ("proximal", "middle", "distal")
"""Names of the phalanges of a finger; the thumb's metacarpal counts as its first."""

PIECES = tuple(f"{finger}/{phalanx}" for finger in FINGERS for phalanx in PHALANGES) + ("palm",)
"""Names of the pieces, in the order of the kernels' bodies."""

RINGS, SIDES = 8, 24
"""Rings to each end of a phalanx's mesh, and corners of a ring."""
FINE = (28, 48)
"""The same for a picture that is looked at closely."""
NAIL = np.array([0.97, 0.83, 0.77])


class PiecePoses(NamedTuple):
    """Poses of the sixteen pieces: translation (T, 16, 3) [m], quaternion (T, 16, 4) w x y z; piece to world."""

    translation: FloatArray
    quaternion: FloatArray


def piece_surfaces(hand: HandModel, rings: int = RINGS, sides: int = SIDES) -> tuple[Surface, ...]:
    """Return the surface of each piece in its own frame, of so many rings to each end of a phalanx."""
    surfaces = []
    for finger in range(len(FINGERS)):
        for k in range(PHALANX_COUNT):
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


def hand_surface(hand: HandModel, pose: Iterable[ArrayLike], pieces: Sequence[Surface] = ()) -> Surface:
    """Return the hand's surface in the world frame, of `pieces` as of `piece_surfaces`, or else of fine ones.

    `pose` has the fields of a `HandConfiguration`, the arguments of `HandModel.joints`.
    """
    position, orientation, flexion, abduction = (np.asarray(values, np.float64)[None] for values in pose)
    poses = piece_poses(hand, position, orientation, flexion, abduction)
    places, turns = poses.translation[0], rotation_matrix(poses.quaternion[0])
    shown = pieces or piece_surfaces(hand, *FINE)
    return joined([moved(piece, turn, place) for piece, turn, place in zip(shown, turns, places)])


def piece_poses(
    hand: HandModel, position: ArrayLike, orientation: ArrayLike, flexion: ArrayLike, abduction: ArrayLike
) -> PiecePoses:
    """Compute the poses of the pieces.

    Palm origins [m], world, have shape (T, 3), palms' unit quaternions (w, x, y, z) to the world (T, 4); flexion [rad]
    has shape (T, 5, 3), abduction [rad] (T, 5).
    """
    origin, palm = np.asarray(position, np.float64), np.asarray(orientation, np.float64)
    frames = np.stack([np.cross(hand.distal, hand.dorsal), hand.distal, hand.dorsal], axis=-1)
    base = quaternion_product(palm[:, None], quaternion_from_matrix(frames))
    # A turn about the finger's back, then one about the axis that it flexes about.
    spread = _turn(2, hand.abduction_sign * np.asarray(abduction, np.float64))
    bend = _turn(0, -np.cumsum(np.asarray(flexion, np.float64), axis=2))
    turn = quaternion_product(quaternion_product(base, spread)[:, :, None], bend)
    joint = np.empty((len(origin), len(FINGERS), PHALANX_COUNT, 3))
    joint[:, :, 0] = origin[:, None] + np.einsum("tij,fj->tfi", rotation_matrix(palm), hand.base)
    along = hand.length[:, :-1, None] * rotation_matrix(turn[:, :, :-1])[..., 1]
    joint[:, :, 1:] = joint[:, :, :1] + np.cumsum(along, axis=2)
    return PiecePoses(
        np.concatenate([joint.reshape(-1, PALM_BODY, 3), origin[:, None]], axis=1),
        np.concatenate([turn.reshape(-1, PALM_BODY, 4), palm[:, None]], axis=1),
    )


def _turn(axis: int, angle: FloatArray) -> FloatArray:
    """Return the quaternions (w, x, y, z) of rotations about a coordinate axis by angles [rad], shape (..., 4)."""
    quaternion = np.zeros((*angle.shape, 4))
    quaternion[..., 0], quaternion[..., 1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return quaternion
