"""The task of a rest: a cube stands on a table and nothing touches it; and how far it has gone."""

import math
from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.manipulation.stage import turned_by


@dataclass(frozen=True)
class Rest:
    """What stands on the table, and for how long.

    Attributes:
        seconds: How long [s].
        mass: Of the cube [kg].
        friction: μ of cube and table.
        side: Of the cube [m].
        gravity: [m/s²].
    """

    seconds: float = 600.0
    mass: float = 0.24
    friction: float = 0.6
    side: float = 0.07
    gravity: float = 9.81

    def creep(self, center: FloatArray, orientation: FloatArray) -> float:
        """How far a corner has gone at most [m].

        Args:
            center: Of the cube at the ticks that count [m], shape (ticks, 3).
            orientation: Of the first and the last of them, (w, x, y, z), shape (2, 4).
        """
        moved = float(np.linalg.norm(center - center[0], axis=1).max())
        return moved + 0.5 * self.side * math.sqrt(3.0) * turned_by(orientation[0], orientation[1])
