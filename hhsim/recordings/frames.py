"""Frames of recordings, and their conversion to hhsim's.

World z up; palm x to the little finger, y to the fingers, z out of the back (of a right hand; of a left hand x points
to the thumb, so that the frame stays right-handed). Palm axes are given in terms of the recording's, such as
("-y", "x", "z"): our x is its -y, our y is its x.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.quaternion import conjugate, quaternion_from_matrix, quaternion_product

OURS = ("x", "y", "z")
WORLD_UP = ("x", "y", "z", "-x", "-y", "-z")


def axes_matrix(axes: Sequence[str], where: str = "palm axes") -> FloatArray:
    """Return the rotation from our frame to the recording's, shape (3, 3): its columns are our axes in the recording's.

    `axes` are our x, y, z, each as one of x, y, z, -x, -y, -z of the recording; messages name them as `where` says.
    Raises InputError for three axes that are not perpendicular, or a left-handed frame.
    """
    if len(axes) != 3 or any(not isinstance(axis, str) or axis.strip("+-") not in OURS for axis in axes):
        raise InputError(f'{where} {list(axes)}: expected three of x, y, z, -x, -y, -z, such as ["-y", "x", "z"]')
    columns = [(-1.0 if axis.startswith("-") else 1.0) * np.eye(3)[OURS.index(axis.strip("+-"))] for axis in axes]
    matrix = np.stack(columns, axis=1)
    if not np.isclose(np.linalg.det(matrix), 1.0):
        raise InputError(f"{where} {list(axes)}: left-handed or not across each other; expected a right-handed frame")
    return matrix


def world_matrix(up: str) -> FloatArray:
    """Return the rotation to our world from one whose axis `up` points up, shape (3, 3); InputError for no axis."""
    turns = {"z": "x y z", "-z": "x -y -z", "y": "x -z y", "-y": "x z -y", "x": "-z y x", "-x": "z y -x"}
    if up not in turns:
        raise InputError(f"world_up = {up!r}: expected one of {', '.join(WORLD_UP)}")
    # Rows: our axes in terms of the recording's.
    return axes_matrix(turns[up].split()).T


def axis_flip(axis: str | None) -> FloatArray:
    """Return the factors of a point's coordinates that turn one axis round, shape (3,); 1 for an axis of None."""
    return np.where([axis == name for name in OURS], -1.0, 1.0)


def turned(orientation: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate vectors, shape (3,) or (T, …, 3), by each quaternion (w, x, y, z) of any length, shape (T, …, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return _rotated(orientation / np.linalg.norm(orientation, axis=1, keepdims=True), vectors)


def in_palm(vectors: FloatArray, orientation: FloatArray) -> FloatArray:
    """Express world vectors, shape (T, …, 3), in the palm frames of unit quaternions (w, x, y, z), shape (T, 4)."""
    return _rotated(conjugate(orientation), vectors)


def _rotated(unit: FloatArray, vectors: FloatArray) -> FloatArray:
    unit = unit.reshape(len(unit), *[1] * (vectors.ndim - 2), 4)
    cross = 2.0 * np.cross(unit[..., 1:], vectors)
    return np.asarray(vectors + unit[..., :1] * cross + np.cross(unit[..., 1:], cross))


def quaternions_of(matrix: FloatArray) -> FloatArray:
    """Convert rotation matrices, shape (T, 3, 3), to unit quaternions (w, x, y, z) without sign flips, shape (T, 4).

    NaN where a matrix is missing.
    """
    row = quaternion_from_matrix(matrix)
    whole = np.flatnonzero(np.isfinite(row).all(axis=1))
    if whole.size:
        # The first one's largest component is positive.
        row[whole[0]] *= np.sign(row[whole[0], np.argmax(np.abs(row[whole[0]]))])
    flips = np.where((row[whole][1:] * row[whole][:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    row[whole[1:]] *= np.cumprod(flips)[:, None]
    return np.asarray(row)


class FileFrame(NamedTuple):
    """Coordinates of a file: x_world = metre · turn · flip · x_file.

    `turn`, shape (3, 3), is a rotation, `metre` the unit [m]; `flip`, shape (3,), has -1 for the axis of a left-handed
    world that is turned round.
    """

    turn: FloatArray = np.eye(3)
    metre: float = 1.0
    flip: FloatArray = np.ones(3)

    @classmethod
    def of(cls, up: str | None, mirror: str | None, metre: float = 1.0) -> Self:
        """Return the coordinates with an axis that points up, None for ours, and one that is turned round."""
        return cls(world_matrix(up or "z"), metre, axis_flip(mirror))

    def to_world(self, points: FloatArray) -> FloatArray:
        """Convert points or vectors, shape (…, 3), from the file to our world [m]."""
        return np.asarray(self.metre * (points * self.flip) @ self.turn.T)

    def to_file(self, points: FloatArray) -> FloatArray:
        """Convert points or vectors, shape (…, 3), from our world [m] to the file."""
        return np.asarray(points @ self.turn * self.flip / self.metre)

    def poses(
        self, position: FloatArray, orientation: FloatArray, axes: Sequence[str] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Convert positions (T, 3) and orientations (T, 4) of a body from the file to our world.

        In a left-handed world an axis of the body's own is turned round, too; `axes` are ours in terms of these.
        """
        orientation = orientation * [1.0, *(np.prod(self.flip) * self.flip)]
        if axes is not None:
            orientation = quaternion_product(orientation, quaternion_from_matrix(axes_matrix(axes)))
        return self.to_world(position), quaternion_product(quaternion_from_matrix(self.turn), orientation)

    def rotation_to_file(self, rotation: FloatArray) -> FloatArray:
        """Convert rotations of vectors, shape (…, 3, 3), from our world to the file."""
        turn = self.turn * self.flip
        return np.asarray(turn.T @ rotation @ turn)
