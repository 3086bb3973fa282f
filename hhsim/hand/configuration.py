"""Configurations of a hand along time: plain unchecked arrays without stamps, as solvers take and records hold them."""

from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_vector

SHAPES = {"position": (3,), "orientation": (4,), "flexion": (5, 3), "abduction": (5,)}
"""Shapes of a single configuration."""


class HandConfiguration(NamedTuple):
    """Configurations of a hand, one per tick or sample, world frame; a single one has no T."""

    position: FloatArray  # palm origin [m], shape (T, 3)
    orientation: FloatArray  # palm to world, (w, x, y, z), shape (T, 4)
    flexion: FloatArray  # thumb to little finger, proximal to distal [rad], shape (T, 5, 3)
    abduction: FloatArray  # thumb to little finger [rad], shape (T, 5)

    def __repr__(self) -> str:
        if np.ndim(self.position) != 1:
            return f"HandConfiguration({np.shape(self.position)[0]:,} poses)"
        values = (np.array2string(np.ravel(value), precision=4, max_line_width=120) for value in self)
        return f"HandConfiguration({', '.join(f'{name}={value}' for name, value in zip(self._fields, values))})"

    @classmethod
    def of(cls, posed: Any) -> "HandConfiguration":
        """Return the configurations of a record that has these four arrays and more, without a copy."""
        return cls(posed.position, posed.orientation, posed.flexion, posed.abduction)

    @property
    def ticks(self) -> int:
        """Number of ticks T."""
        return len(self.position)

    def part(self, first: int, last: int | None = None) -> "HandConfiguration":
        """Return ticks `first` to `last` - 1, as views; negative ones count from the end."""
        return self.at(slice(first, last))

    def at(self, ticks: int | slice | IntArray) -> "HandConfiguration":
        """Return a single tick or a slice, as views, or the ticks of these numbers, as copies."""
        return HandConfiguration(*(values[ticks] for values in self))

    def copy(self) -> "HandConfiguration":
        """Return a copy."""
        return HandConfiguration(*(np.array(values, dtype=np.float64, order="C") for values in self))

    def hold(self, ticks: int) -> "HandConfiguration":
        """Return this motion with its last configuration held for some more ticks."""
        return sequence(self, HandConfiguration(*(np.repeat(values[-1:], ticks, axis=0) for values in self)))

    def line(self, goal: "HandConfiguration", ticks: int) -> "HandConfiguration":
        """Return this motion, then a motion at constant speed to the first configuration of `goal`, reached last."""
        share = np.arange(1, ticks + 1) / ticks
        parts = [
            a[-1] + share.reshape(-1, *[1] * (a.ndim - 1)) * (b[0] - a[-1]) for a, b in zip(self, goal, strict=True)
        ]
        vector = rotation_vector(quaternion_product(goal.orientation[0], conjugate(self.orientation[-1])))
        parts[1] = quaternion_product(quaternion(share[:, None] * vector), self.orientation[-1])
        return sequence(self, HandConfiguration(*parts))


def sequence(*motions: HandConfiguration) -> HandConfiguration:
    """Concatenate motions."""
    return HandConfiguration(*(np.concatenate(parts) for parts in zip(*motions, strict=True)))
