"""Keys that move the palm (the paper uses "several keys on the keyboard" and names none).

A key moves the palm's target, and the palm glides there no faster than a hand moves.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_vector
from hhsim.live.pose.sources import checked_pose
from hhsim.live.shared_memory import SharedBlock

MOVES: dict[str, tuple[float, float, float]] = {
    "a": (-1.0, 0.0, 0.0),
    "d": (1.0, 0.0, 0.0),
    "s": (0.0, -1.0, 0.0),
    "w": (0.0, 1.0, 0.0),
    "f": (0.0, 0.0, -1.0),
    "r": (0.0, 0.0, 1.0),
}
"""Direction of each moving key in the world: x to the right, y away, z up."""
TURNS: dict[str, tuple[float, float, float]] = {
    "k": (-1.0, 0.0, 0.0),
    "i": (1.0, 0.0, 0.0),
    "u": (0.0, -1.0, 0.0),
    "o": (0.0, 1.0, 0.0),
    "l": (0.0, 0.0, -1.0),
    "j": (0.0, 0.0, 1.0),
}
"""Axis of each turning key in the palm frame: fingers down and up, roll, fingers to the right and left."""
HOME, FINER, COARSER = "h", "-", "+"
STOP = ("q", " ", "\x1b", "\x03", "\x04")
"""Keys that end the session: q, space, Escape, Ctrl-C and Ctrl-D."""

STEPS = (0.5e-3, 1e-3, 2e-3, 5e-3, 10e-3)
"""Steps of a key stroke [m]."""
DEGREES_PER_METRE = 500.0
SPEED = 0.25
"""Largest speed of the palm [m/s]."""
TURNING = 2.0
"""Largest angular velocity of the palm [rad/s]."""
REACH = 1.0
"""Largest distance from the beginning along each axis [m]."""

HELP = (
    ("a d", "left, right"),
    ("s w", "nearer, away"),
    ("f r", "down, up"),
    ("i k", "fingers up, down"),
    ("j l", "fingers left, right"),
    ("u o", "roll"),
    ("- +", "step"),
    ("h", "home"),
    ("q or space", "free the fingers and end"),
)
"""Keys and their meaning, for the command's help."""


class PalmKeys:
    """Pose of the palm, world, and its target; begins at `position` [m] and the unit quaternion `orientation`."""

    def __init__(self, position: ArrayLike, orientation: ArrayLike) -> None:
        self.position: FloatArray = np.array(position, np.float64)
        self.orientation: FloatArray = np.array(orientation, np.float64)
        self._home = (self.position.copy(), self.orientation.copy())
        self._target = (self.position.copy(), self.orientation.copy())
        self._step = 2

    @property
    def step(self) -> float:
        """Step of a key stroke [m]."""
        return STEPS[self._step]

    def press(self, keys: Iterable[str]) -> bool:
        """Apply key strokes in any case up to one that ends the session, and return whether there was one."""
        position, orientation = self._target
        for key in keys:
            key = "+" if key == "=" else key.lower()
            if key in STOP:
                return True
            if key in MOVES:
                moved = position + self.step * np.array(MOVES[key])
                position[:] = np.clip(moved, self._home[0] - REACH, self._home[0] + REACH)
            elif key in TURNS:
                turn = math.radians(DEGREES_PER_METRE * self.step) * np.array(TURNS[key])
                orientation[:] = quaternion_product(orientation, quaternion(turn))
            elif key == HOME:
                position[:], orientation[:] = self._home
            elif key in (FINER, COARSER):
                self._step = min(max(self._step + (1 if key == COARSER else -1), 0), len(STEPS) - 1)
        return False

    def advance(self, seconds: float) -> bool:
        """Glide towards the target for a time [s], and return whether the palm moved."""
        position, orientation = self._target
        shift = position - self.position
        turn = rotation_vector(quaternion_product(orientation, conjugate(self.orientation)))
        distance, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        if distance == 0.0 and angle < 1e-12:
            return False
        share = 1.0 if distance <= SPEED * seconds else SPEED * seconds / distance
        self.position[:] = position if share == 1.0 else self.position + share * shift
        if angle <= TURNING * seconds:
            self.orientation[:] = orientation
        else:
            self.orientation[:] = quaternion_product(quaternion(TURNING * seconds / angle * turn), self.orientation)
        return True


def write_keyboard_pose(status: SharedBlock, position: ArrayLike, orientation: ArrayLike) -> None:
    """Write the palm's pose, world, that `FixedPose` reads; there is one writer. InputError for an invalid pose."""
    place, turn = checked_pose(position, orientation)
    record = status.array[0]
    # Odd while the pose is written; a reader that meets an odd or a changed version tries again in the next tick.
    record["pose_version"] += 1
    record["pose_position"] = place
    record["pose_orientation"] = turn
    record["pose_version"] += 1
