"""An object that moves as recorded: its pose at every sample or tick, and the world as the object sees it.

In the frame that moves with the object, and is the world's at the first pose, the object stands still. There a hand is
solved and measured as beside an object that is fixed; forces and poses are brought back to the world after that.
"""

from typing import Any, NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_matrix


class ObjectMotion(NamedTuple):
    """The object's own frame over time.

    Attributes:
        position: Of its origin [m], shape (T, 3), world.
        orientation: Object to world, unit (w, x, y, z), shape (T, 4).
    """

    position: FloatArray
    orientation: FloatArray

    @property
    def stands_still(self) -> bool:
        """Whether every pose is the first one."""
        return all(bool((values == values[:1]).all()) for values in self)

    def at(self, index: int | slice | IntArray) -> Self:
        """Some of its poses."""
        return type(self)(self.position[index], self.orientation[index])

    def since(self, position: FloatArray, orientation: FloatArray) -> "RigidMotion":
        """What moves the object from a pose, shapes (3,) and (4,), to each of its own."""
        turn = quaternion_product(self.orientation, conjugate(orientation))
        return RigidMotion(turn, self.position - _turned(turn, np.broadcast_to(position, self.position.shape)))


class RigidMotion(NamedTuple):
    """At each tick x ↦ turn · x + shift: from the frame that moves with the object to the world, and back.

    Attributes:
        turn: Unit quaternions (w, x, y, z), shape (T, 4).
        shift: [m], shape (T, 3).
    """

    turn: FloatArray
    shift: FloatArray

    def points(self, seen: FloatArray) -> FloatArray:
        """World points [m], shape (T, ..., 3), of those that the object sees."""
        return _turned(self.turn, seen) + _beside(self.shift, seen)

    def vectors(self, seen: FloatArray) -> FloatArray:
        """World vectors, shape (T, ..., 3), of those that the object sees."""
        return _turned(self.turn, seen)

    def orientations(self, seen: FloatArray) -> FloatArray:
        """World quaternions, shape (T, 4), of those that the object sees."""
        return quaternion_product(self.turn, seen)

    def seen_points(self, world: FloatArray) -> FloatArray:
        """World points [m], shape (T, ..., 3), as the object sees them."""
        return _turned(conjugate(self.turn), world - _beside(self.shift, world))

    def seen_vectors(self, world: FloatArray) -> FloatArray:
        """World vectors, shape (T, ..., 3), as the object sees them."""
        return _turned(conjugate(self.turn), world)

    def seen_orientations(self, world: FloatArray) -> FloatArray:
        """World quaternions, shape (T, 4), as the object sees them."""
        return quaternion_product(conjugate(self.turn), world)


def object_fields(given: dict[str, Any]) -> dict[str, Any]:
    """Fields of a trajectory for the object_position and object_orientation of a file, which may have a row a sample.

    Where one has, that is a motion; the other stands still beside it if it is constant or not there.
    """
    if not any(np.ndim(values) == 2 for values in given.values()):
        return given
    count = max(len(values) for values in given.values() if np.ndim(values) == 2)
    whole = {"object_position": np.zeros(3), "object_orientation": np.array([1.0, 0.0, 0.0, 0.0]), **given}
    rows = (np.tile(values, (count, 1)) if np.ndim(values) == 1 else values for values in whole.values())
    return {"object_motion": ObjectMotion(*rows)}


def _beside(rows: FloatArray, values: FloatArray) -> FloatArray:
    """One row a tick, shape (T, 3), with the axes that `values` has between."""
    return rows.reshape(len(rows), *[1] * (values.ndim - 2), 3)


def _turned(turn: FloatArray, values: FloatArray) -> FloatArray:
    x, y, z = np.moveaxis(np.asarray(values, np.float64), -1, 0)
    matrix = rotation_matrix(turn).reshape(len(turn), *[1] * (x.ndim - 1), 3, 3)
    # Sums written out: the same bytes however many ticks there are at a time.
    return np.stack([matrix[..., i, 0] * x + matrix[..., i, 1] * y + matrix[..., i, 2] * z for i in range(3)], axis=-1)
