"""Forward kinematics of the stored hands, by scipy's rotations.

A finger is straight along `distal` at zero angles. Abduction rotates it about `dorsal`, flexion about
`dorsal` × `distal`; each joint rotates all beyond it. The solver adds angles up in the finger's plane; here the
rotations are chained.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.result.body import HAND_ARRAYS
from hhsim.result.reader import Result

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


class OwnHand(NamedTuple):
    """Hand of a result, palm frame; fields as in the file, `sign` -1 for a left hand, whose abduction mirrors."""

    base: FloatArray
    distal: FloatArray
    dorsal: FloatArray
    length: FloatArray
    radius: FloatArray
    flexion_min: FloatArray
    flexion_max: FloatArray
    palm_center: FloatArray
    palm_radius: FloatArray
    sign: float


class Posed(NamedTuple):
    """Hands, world: joints (T, 5, 4, 3) [m], flexion axes (T, 5, 3), palm spheres (T, P, 3) and origin (T, 3) [m]."""

    joints: FloatArray
    axes: FloatArray
    palm: FloatArray
    position: FloatArray

    def at(self, ticks: slice | IntArray) -> "Posed":
        """Return the hands of some ticks."""
        return Posed._make(values[ticks] for values in self)


def own_hand(result: Result) -> OwnHand:
    """Read the hand of a result."""
    arrays = {**HAND_ARRAYS, "palm_center": "palm_center", "palm_radius": "palm_radius"}
    sign = -1.0 if result.scene["hand"]["side"] == "left" else 1.0
    return OwnHand._make([*(np.array(result.static[f"hand/{arrays[name]}"]) for name in OwnHand._fields[:-1]), sign])


def configurations(result: Result, whose: str) -> HandConfiguration:
    """Read the graphic or the haptic hand of every tick."""
    return HandConfiguration(*(np.array(result[f"{whose}/{name}"]) for name in HandConfiguration._fields))


def pose(hand: OwnHand, at: HandConfiguration) -> Posed:
    """Compute the posture of each hand; NaN for a configuration that is not finite or has no orientation."""
    from scipy.spatial.transform import Rotation

    ticks = len(at.position)
    nowhere = ~np.all([np.isfinite(values).all(axis=tuple(range(1, values.ndim))) for values in at], axis=0)
    at = HandConfiguration(*(np.where(nowhere.reshape(-1, *(1,) * (values.ndim - 1)), 0.0, values) for values in at))
    joints, axes = np.empty((ticks, 5, 4, 3)), np.empty((ticks, 5, 3))
    turned, unturned = rotations(at.orientation)
    nowhere |= unturned
    for f in range(5):
        axis = np.cross(hand.dorsal[f], hand.distal[f])
        here = turned * Rotation.from_rotvec(hand.sign * at.abduction[:, f, None] * hand.dorsal[f])
        axes[:, f] = here.apply(axis)
        joints[:, f, 0] = at.position + turned.apply(hand.base[f])
        for k in range(3):
            here = here * Rotation.from_rotvec(at.flexion[:, f, k, None] * axis)
            joints[:, f, k + 1] = joints[:, f, k] + hand.length[f, k] * here.apply(hand.distal[f])
    palm = np.einsum("tij,pj->tpi", turned.as_matrix(), hand.palm_center) + at.position[:, None]
    posed = Posed(joints, axes, palm, at.position.copy())
    for values in posed:
        values[nowhere] = np.nan
    return posed


def turn_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """Rotation vectors [rad], world, (T, 3), between orientations w x y z; NaN if one is invalid."""
    (there, neither), (here, nor) = rotations(second), rotations(first)
    turn = np.array((there * here.inv()).as_rotvec(), np.float64)
    turn[neither | nor] = np.nan
    return turn


def rotations(quaternion: FloatArray) -> "tuple[Rotation, BoolArray]":
    """Rotations of quaternions w x y z (T, 4), and a mask (T,) of the invalid ones, replaced by the identity."""
    from scipy.spatial.transform import Rotation

    # scipy rejects all of them for one without a finite, positive length.
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=1)
    none = ~((length > 0.0) & (length < np.inf))
    return Rotation.from_quat(np.where(none[:, None], [1.0, 0.0, 0.0, 0.0], quaternion)[:, [1, 2, 3, 0]]), none
