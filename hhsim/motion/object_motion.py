"""Object that moves as recorded: its pose at every sample or tick, and the frame that moves with it.

In that frame, which is the world's at the first pose, the object stands still. There a hand is solved and measured as
beside a fixed object; forces and poses are transformed to the world after that.
"""

from typing import NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_matrix


class ObjectMotion(NamedTuple):
    """Frame of the object over time: origin [m], (T, 3), and orientation to the world, unit (w, x, y, z), (T, 4)."""

    position: FloatArray
    orientation: FloatArray

    def at(self, index: int | slice | IntArray) -> Self:
        """Return the poses of an index or a slice."""
        return type(self)(self.position[index], self.orientation[index])

    def since(self, position: FloatArray, orientation: FloatArray) -> "RigidMotion":
        """Compute the motion from a pose, shapes (3,) and (4,), to each of the object's."""
        turn = quaternion_product(self.orientation, conjugate(orientation))
        return RigidMotion(turn, self.position - _turned(turn, np.broadcast_to(position, self.position.shape)))


class RigidMotion(NamedTuple):
    """Transformation at each tick from the frame that moves with the object to the world: x ↦ turn · x + shift.

    Unit quaternions (w, x, y, z), shape (T, 4), and translations [m], shape (T, 3).
    """

    turn: FloatArray
    shift: FloatArray

    def at(self, index: slice | IntArray) -> Self:
        """Return the motion of some ticks."""
        return type(self)(self.turn[index], self.shift[index])

    def points(self, seen: FloatArray) -> FloatArray:
        """Transform points [m], shape (T, ..., 3), from the object's frame to the world."""
        return _turned(self.turn, seen) + _beside(self.shift, seen)

    def vectors(self, seen: FloatArray) -> FloatArray:
        """Transform vectors, shape (T, ..., 3), from the object's frame to the world."""
        return _turned(self.turn, seen)

    def orientations(self, seen: FloatArray) -> FloatArray:
        """Transform quaternions, shape (T, 4), from the object's frame to the world."""
        return quaternion_product(self.turn, seen)

    def seen_points(self, world: FloatArray) -> FloatArray:
        """Transform points [m], shape (T, ..., 3), from the world to the object's frame."""
        return _turned(conjugate(self.turn), world - _beside(self.shift, world))

    def seen_vectors(self, world: FloatArray) -> FloatArray:
        """Transform vectors, shape (T, ..., 3), from the world to the object's frame."""
        return _turned(conjugate(self.turn), world)

    def seen_hand(self, world: PlacedHand) -> PlacedHand:
        """Transform placed hands from the world to the object's frame."""
        return PlacedHand(
            self.seen_points(world.joints), self.seen_points(world.position), self.seen_orientations(world.orientation)
        )

    def seen_orientations(self, world: FloatArray) -> FloatArray:
        """Transform quaternions, shape (T, 4), from the world to the object's frame."""
        return quaternion_product(conjugate(self.turn), world)


def _beside(rows: FloatArray, values: FloatArray) -> FloatArray:
    """Insert the axes of `values` into rows of shape (T, 3)."""
    return rows.reshape(len(rows), *[1] * (values.ndim - 2), 3)


def _turned(turn: FloatArray, values: FloatArray) -> FloatArray:
    x, y, z = np.moveaxis(np.asarray(values, np.float64), -1, 0)
    matrix = rotation_matrix(turn).reshape(len(turn), *[1] * (x.ndim - 1), 3, 3)
    # Sums written out: the same bytes however many ticks there are at a time.
    return np.stack([matrix[..., i, 0] * x + matrix[..., i, 1] * y + matrix[..., i, 2] * z for i in range(3)], axis=-1)
