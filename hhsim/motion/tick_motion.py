"""A motion of the hand as plain arrays, tick by tick: what the solver takes, what a record holds, what can be cut up.

Unlike a `hhsim.motion.trajectory.Trajectory` it has no stamps and is not checked: it may hold what a broken device
sends.
"""

from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.motion.resample import tick_times
from hhsim.motion.trajectory import MAX_ANGLE, MAX_POSITION, Trajectory

Array = NDArray[np.float64]


class HandMotion(NamedTuple):
    """Hand configurations, tick by tick, world frame.

    Attributes:
        position: palm origin [m], shape (T, 3).
        orientation: palm to world, (w, x, y, z), shape (T, 4).
        flexion: [rad], shape (T, 5, 3).
        abduction: [rad], shape (T, 5).
    """

    position: Array
    orientation: Array
    flexion: Array
    abduction: Array

    @property
    def ticks(self) -> int:
        """Number of ticks T."""
        return len(self.position)

    def part(self, first: int, last: int) -> Self:
        """Ticks `first` to `last` - 1, as views."""
        return type(self)(*(values[first:last] for values in self))

    def chosen(self, index: NDArray[np.int64]) -> Self:
        """The ticks of these numbers, in this order, as copies."""
        return type(self)(*(values[index] for values in self))

    def copy(self) -> Self:
        """The same motion in arrays of its own."""
        return type(self)(*(np.array(values, dtype=np.float64, order="C") for values in self))

    def held(self) -> Self:
        """The motion as the solver sees it: a tick that is no reading of a hand repeats the last one that is.

        Ticks before the first reading take that one. Where there is no reading at all, nothing is changed.
        """
        sound = np.array([is_finite_configuration(*sample) for sample in zip(*self)], dtype=bool)
        if sound.all() or not sound.any():
            return self.copy()
        newest = np.maximum.accumulate(np.where(sound, np.arange(self.ticks), -1))
        return self.chosen(np.where(newest < 0, int(np.argmax(sound)), newest))

    def replayed(self) -> Self:
        """The motion as a replay of its trajectory gives it to the solver.

        Held, with unit quaternions of steady sign, and nothing beyond what a trajectory may hold.
        """
        held = self.held()
        position = np.clip(held.position, -MAX_POSITION, MAX_POSITION)
        flexion, abduction = (
            np.clip(held.flexion, -MAX_ANGLE, MAX_ANGLE),
            np.clip(held.abduction, -MAX_ANGLE, MAX_ANGLE),
        )
        ticks = type(self)(position, held.orientation, flexion, abduction).trajectory().resampled(1000.0, "hold")
        return type(self)(ticks.position, ticks.orientation, ticks.flexion, ticks.abduction)

    def trajectory(self, *, rate: float = 1000.0, name: str = "", source: str = "", licence: str = "") -> Trajectory:
        """A checked trajectory with one sample a tick, so that a replay at `rate` gets the same samples.

        Args:
            rate: ticks per second [Hz].
            name: a short name.
            source: who or what made the motion.
            licence: under which it may be used.

        Raises:
            TrajectoryError: the motion holds what no trajectory may; `held` mends NaN and zero quaternions.
        """
        time = tick_times((self.ticks - 1) / rate, rate)
        return Trajectory(time, *self, name=name, source=source, licence=licence)


def joined(motions: Iterable[HandMotion]) -> HandMotion:
    """One motion behind the other."""
    return HandMotion(*(np.concatenate(parts) for parts in zip(*motions)))
