"""Haptic hands tick by tick, written down by formula: what scenes that are no recording are moved by."""

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.hand import HandModel
from hhsim.hand_motion import HandMotion

Array = NDArray[np.float64]

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


class HapticMotion(HandMotion):
    """A hand motion that can be written down step by step."""

    __slots__ = ()

    def part(self, first: int, last: int | None = None) -> Self:
        """Ticks first to last - 1, as copies; negative ones count from the end."""
        return type(self)(*(values[first:last].copy() for values in self))

    def hold(self, ticks: int) -> "HapticMotion":
        """This motion, and its last configuration for some ticks more."""
        return sequence(self, HapticMotion(*(np.repeat(values[-1:], ticks, axis=0) for values in self)))

    def line(self, goal: "HapticMotion", ticks: int) -> "HapticMotion":
        """This motion, and from its last configuration at constant speed to the first one of `goal`, reached last."""
        share = np.arange(1, ticks + 1) / ticks
        parts = [
            a[-1] + share.reshape(-1, *[1] * (a.ndim - 1)) * (b[0] - a[-1]) for a, b in zip(self, goal, strict=True)
        ]
        vector = rotation_vector(quaternion_product(goal.orientation[0], conjugate(self.orientation[-1])))
        parts[1] = quaternion_product(quaternion(share[:, None] * vector), self.orientation[-1])
        return sequence(self, HapticMotion(*parts))


def still(
    position: ArrayLike,
    orientation: ArrayLike = UPRIGHT,
    flexion: ArrayLike = 0.0,
    abduction: ArrayLike = 0.0,
    ticks: int = 1,
) -> HapticMotion:
    """One configuration for some ticks; a single number is the angle of every joint. Units as in `HapticMotion`."""
    shapes = ((3,), (4,), (5, 3), (5,))
    values = (
        np.broadcast_to(np.asarray(value, np.float64), shape)
        for value, shape in zip((position, orientation, flexion, abduction), shapes, strict=True)
    )
    return HapticMotion(*(np.repeat(value[None], ticks, axis=0) for value in values))


def sequence(*motions: HandMotion) -> HapticMotion:
    """One motion after the other."""
    return HapticMotion(*(np.concatenate(parts) for parts in zip(*motions, strict=True)))


def random_targets(
    hand: HandModel,
    ticks: int,
    random: np.random.Generator,
    *,
    hold: int = 60,
    spread: float = 0.06,
    turn: float = 0.8,
    start: Sequence[float] = (0.0, 0.0, 0.25),
) -> HapticMotion:
    """A new random hand every `hold` ticks, at a jump: the stress that the coupled program was first measured by.

    Args:
        hand: Its limits bound flexion and abduction.
        ticks: T.
        random: Source of everything random.
        hold: Ticks that a target stands.
        spread: Standard deviation of the position about the origin [m].
        turn: Of the rotation vector [rad].
        start: Position of the first target [m].
    """
    count = -(-ticks // hold)
    position = random.normal(0.0, spread, (count, 3))
    position[0] = start
    orientation = quaternion(random.normal(0.0, turn, (count, 3)))
    flexion = random.uniform(hand.flexion_min, hand.flexion_max, (count, 5, 3))
    abduction = random.uniform(hand.abduction_min, hand.abduction_max, (count, 5))
    parts = (position, orientation, flexion, abduction)
    return HapticMotion(*(np.repeat(part, hold, axis=0)[:ticks] for part in parts))


def quaternion(vector: ArrayLike) -> Array:
    """Unit quaternions (w, x, y, z), shape (..., 4), of rotation vectors [rad], shape (..., 3)."""
    turns = np.asarray(vector, np.float64)
    half = 0.5 * np.linalg.norm(turns, axis=-1, keepdims=True)
    # np.sinc(x) is sin(πx)/(πx), and whole at zero.
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * turns], axis=-1)


def rotation_vector(quaternions: ArrayLike) -> Array:
    """Rotation vectors [rad], shape (..., 3), the short way round, of unit quaternions (w, x, y, z), shape (..., 4)."""
    q = np.asarray(quaternions, np.float64)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    small = sine < 1e-12
    scale = np.where(small, 2.0, 2.0 * np.arctan2(sine, q[..., :1]) / np.where(small, 1.0, sine))
    vector: Array = scale * q[..., 1:]
    return vector


def quaternion_product(first: ArrayLike, second: ArrayLike) -> Array:
    """The rotation `second` and then `first`, shapes (..., 4)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(first, np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(second, np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(quaternions: ArrayLike) -> Array:
    """The inverse of unit quaternions, shape (..., 4)."""
    turned: Array = np.asarray(quaternions, np.float64) * [1.0, -1.0, -1.0, -1.0]
    return turned


def rotation_matrix(unit: ArrayLike) -> Array:
    """Matrix, shape (3, 3), of one unit quaternion (w, x, y, z)."""
    w, x, y, z = np.asarray(unit, np.float64)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
