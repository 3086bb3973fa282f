"""Joint angles of our hand from the directions of recorded finger bones.

A recording knows where joints are; our finger is a plane chain that abducts about its dorsal axis w and then flexes
about axes across u, the direction of the straight finger. The abduction is the plane that the three bones lie nearest
to: the least eigenvector of a 2 × 2 matrix, defined also for a fist, where the first bone alone says nothing of it. The
flexions are then angles in that plane. So the angles are those of our hand, whatever the recording's rig calls zero.
"""

from functools import lru_cache

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.model import BREADTH_PER_LENGTH, DEFAULT_HAND_LENGTH, PALM_CENTER, default_fingers
from hhsim.hand.quaternion import conjugate, quaternion_product
from hhsim.kernels.hand.tracked_hand import EXACT, LEAST, STRAIGHT
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import quaternions_of, turned


def finger_angles(bones: FloatArray, side: HandSide) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Flexion and abduction that bring our fingers nearest to recorded bones.

    Args:
        bones: Directions of the three bones of each finger from base to tip (thumb: metacarpal first), palm frame, any
            length, NaN where missing, shape (T, 5, 3, 3).
        side: Which hand; a left hand is the mirror.

    Returns:
        Flexion [rad], shape (T, 5, 3); abduction [rad], shape (T, 5); and how far each bone is from its fit [rad],
        shape (T, 5, 3). NaN where a bone of the finger is missing.
    """
    distal, dorsal, across = finger_axes(side)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    along, aside, above = (np.einsum("tfki,fi->tfk", unit, axes) for axes in (distal, across, dorsal))
    # The flexion axis is cos β · across - sin β · distal; β makes the bones' parts along it least.
    pp, pq, qq = (aside**2).sum(axis=2), (aside * along).sum(axis=2), (along**2).sum(axis=2)
    off_plane = np.maximum(0.5 * (pp + qq - np.hypot(pp - qq, 2.0 * pq)), 0.0)
    qq = qq + STRAIGHT * off_plane / (off_plane + EXACT) + LEAST
    abduction = 0.5 * np.arctan2(2.0 * pq, qq - pp)
    forward = np.cos(abduction)[..., None] * along + np.sin(abduction)[..., None] * aside
    total = np.arctan2(-above, forward)
    # A finger that curls past straight back has turned further, not less.
    total[..., 1:] = total[..., :1] + np.cumsum(_within_turn(np.diff(total, axis=2)), axis=2)
    flexion = np.diff(total, axis=2, prepend=0.0)
    off = np.arcsin(
        np.clip(np.abs(np.cos(abduction)[..., None] * aside - np.sin(abduction)[..., None] * along), 0.0, 1.0)
    )
    return flexion, abduction, off


@lru_cache
def finger_axes(side: HandSide) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where our straight fingers point, out of their backs, and across them to the thumb's side, shapes (5, 3)."""
    sizes = default_fingers(DEFAULT_HAND_LENGTH, BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH)
    mirror = np.array([-1.0 if side == "left" else 1.0, 1.0, 1.0])
    distal, dorsal = sizes["distal"] * mirror, sizes["dorsal"] * mirror
    distal = distal / np.linalg.norm(distal, axis=1, keepdims=True)
    dorsal = dorsal - np.einsum("fi,fi->f", dorsal, distal)[:, None] * distal
    dorsal /= np.linalg.norm(dorsal, axis=1, keepdims=True)
    return distal, dorsal, mirror[0] * np.cross(dorsal, distal)


def finger_joints(
    base: FloatArray, length: FloatArray, flexion: FloatArray, abduction: FloatArray, side: HandSide
) -> FloatArray:
    """Joints and tips of fingers of any size in a posture [m], palm frame, shape (T, 5, 4, 3).

    Args:
        base: First joint of each finger [m], palm frame, shape (5, 3).
        length: Of its bones [m], shape (5, 3).
        flexion: [rad], shape (T, 5, 3).
        abduction: [rad], shape (T, 5).
    """
    distal, dorsal, across = finger_axes(side)
    turn = abduction[..., None]
    forward = np.cos(turn) * distal + np.sin(turn) * across
    total = np.cumsum(flexion, axis=2)[..., None]
    bones = np.cos(total) * forward[:, :, None] - np.sin(total) * dorsal[:, None]
    joints = np.concatenate([np.zeros((*bones.shape[:2], 1, 3)), np.cumsum(length[..., None] * bones, axis=2)], axis=2)
    return np.asarray(base[:, None] + joints)


def _within_turn(angle: FloatArray) -> FloatArray:
    """The same angle in (-π/2, 3π/2]: a joint flexes by up to 200° or hyperextends by up to 90°."""
    return np.asarray((angle + 0.5 * np.pi) % (2.0 * np.pi) - 0.5 * np.pi)


def palm_rotation(fingers: FloatArray, back: FloatArray) -> FloatArray:
    """Our palm frame from two directions, as quaternions (w, x, y, z), shape (T, 4); NaN where one is missing.

    Args:
        fingers: Towards the fingers, any length, shape (T, 3).
        back: Out of the back of the hand, roughly across it, shape (T, 3).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        y = fingers / np.linalg.norm(fingers, axis=1, keepdims=True)
        z = back - np.einsum("ti,ti->t", back, y)[:, None] * y
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        frame = np.stack([np.cross(y, z), y, z], axis=2)
    # A direction whose square is lost points nowhere.
    frame[~np.isfinite(frame).all(axis=(1, 2))] = np.nan
    return quaternions_of(frame)


def palm_from_knuckles(knuckles: FloatArray, wrist: FloatArray, side: HandSide) -> FloatArray:
    """Our palm frame as it lies in our own wrist and knuckles, as quaternions (w, x, y, z), shape (T, 4).

    Args:
        knuckles: First joints of index to little finger, any unit, shape (T, 4, 3).
        wrist: Its middle, shape (T, 3).
    """
    return quaternion_product(_from_knuckles(knuckles, wrist, side), palm_in_knuckles(side))


@lru_cache
def palm_in_knuckles(side: HandSide) -> FloatArray:
    """Our palm frame as it lies in the frame of our wrist and knuckles, a quaternion (w, x, y, z), shape (1, 4)."""
    sizes = default_fingers(DEFAULT_HAND_LENGTH, BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH)
    distal, lateral = PALM_CENTER
    middle = np.array([lateral * BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH, -distal * DEFAULT_HAND_LENGTH, 0.0])
    mirror = np.array([-1.0 if side == "left" else 1.0, 1.0, 1.0])
    return conjugate(_from_knuckles((sizes["base"][1:] * mirror)[None], (middle * mirror)[None], side))


def _from_knuckles(knuckles: FloatArray, wrist: FloatArray, side: HandSide) -> FloatArray:
    """A frame with y from the wrist to the middle of the knuckles and z out of the back."""
    across = (knuckles[:, 3] - knuckles[:, 0]) * (-1.0 if side == "left" else 1.0)
    along = knuckles.mean(axis=1) - wrist
    return palm_rotation(along, np.cross(across, along))


def palm_origin(knuckles: FloatArray, orientation: FloatArray, side: HandSide) -> FloatArray:
    """Where our palm has its origin when the middle of our knuckles meets that of recorded ones [m], shape (T, 3).

    Args:
        knuckles: First joints of index to little finger [m], shape (T, 4, 3).
        orientation: Of our palm frame in the same frame, unit (w, x, y, z), shape (T, 4).
    """
    return np.asarray(knuckles.mean(axis=1) - turned(orientation, middle_of_knuckles(side)))


@lru_cache
def middle_of_knuckles(side: HandSide) -> FloatArray:
    """Of our hand, from its origin [m], shape (3,)."""
    sizes = default_fingers(DEFAULT_HAND_LENGTH, BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH)
    return np.asarray(sizes["base"][1:].mean(axis=0) * [-1.0 if side == "left" else 1.0, 1.0, 1.0])
