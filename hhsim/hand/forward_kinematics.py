"""Joint positions of a hand in the world, tick by tick."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.hand_shape import HandShape, StoredHands
from hhsim.kernels.hand.kinematics import place_hands
from hhsim.kernels.jit import as_argument


class PlacedHand(NamedTuple):
    """A hand, world: joints (T, 5, 4, 3) [m], palm position (T, 3) [m], palm orientation (T, 4) w x y z."""

    joints: FloatArray
    position: FloatArray
    orientation: FloatArray

    def at(self, ticks: slice | IntArray | Sequence[int]) -> "PlacedHand":
        """Return the hand at some of the ticks."""
        return PlacedHand(*(np.ascontiguousarray(values[ticks]) for values in self))

    @property
    def points(self) -> FloatArray:
        """Twenty joint and tip centres and the palm's origin [m], shape (T, 21, 3)."""
        return np.concatenate([self.joints.reshape(-1, 20, 3), self.position[:, None]], axis=1)

    @property
    def ends(self) -> FloatArray:
        """Five tip centres and the palm's origin [m], shape (T, 6, 3)."""
        return np.concatenate([self.joints[:, :, 3], self.position[:, None]], axis=1)


def hand_shape(hand: HandModel) -> HandShape:
    """Return the sizes of a hand model in the kernels' form."""
    palm = hand.palm_tree
    return HandShape(as_argument(hand.radius), as_argument(palm.leaf_center), as_argument(palm.leaf_radius))


def stored_hands(shape: HandShape, placed: PlacedHand) -> StoredHands:
    """Return a placed hand of these sizes in the kernels' form."""
    sizes, joints = HandShape._make(map(as_argument, shape)), as_argument(placed.joints)
    return StoredHands(sizes, joints, as_argument(placed.position), rotation_matrix(placed.orientation))


def forward_kinematics(
    hand: HandModel, position: ArrayLike, orientation: ArrayLike, flexion: ArrayLike, abduction: ArrayLike
) -> PlacedHand:
    """Place a hand by its configuration at each tick, fields as of `hhsim.hand.configuration.HandConfiguration`."""
    origin, quaternion, bend, spread = (as_argument(values) for values in (position, orientation, flexion, abduction))
    joints = np.empty((len(origin), 5, 4, 3))
    place_hands(hand.shared_arrays, origin, as_argument(rotation_matrix(quaternion)), bend, spread, joints)
    return PlacedHand(joints, origin, quaternion)
