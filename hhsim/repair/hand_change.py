"""Change from one hand to another at each frame as a vector, and accelerations."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.hand.hand_change import apply_changes, turns_between
from hhsim.kernels.jit import as_argument

NUMBERS = 26
"""Numbers of a change: palm shift [m], palm rotation vector [rad], 15 flexions and 5 abductions [rad]."""


def finite_frames(hands: HandConfiguration) -> BoolArray:
    """Return True for hands of finite numbers, shape (T,)."""
    finite = [np.isfinite(values).all(axis=tuple(range(1, values.ndim))) for values in hands]
    return np.asarray(np.logical_and.reduce(finite))


def change_between(first: HandConfiguration, second: HandConfiguration) -> FloatArray:
    """Return the changes from the first to the second hands, shape (T, 26), the palm's rotation from the left.

    That of equal hands is exactly zero.
    """
    turn = np.empty((len(first.orientation), 3))
    turns_between(as_argument(first.orientation), as_argument(second.orientation), turn)
    flexion = (second.flexion - first.flexion).reshape(len(turn), 15)
    return np.concatenate([second.position - first.position, turn, flexion, second.abduction - first.abduction], axis=1)


def changed_hand(hand: HandConfiguration, change: FloatArray) -> HandConfiguration:
    """Return hands after these changes, shape (T, 26); a change of exactly zero returns the same numbers."""
    orientation, flexion = as_argument(hand.orientation), as_argument(hand.flexion.reshape(-1, 15))
    turned, bent, spread = np.empty(orientation.shape), np.empty(flexion.shape), np.empty(hand.abduction.shape)
    apply_changes(orientation, flexion, as_argument(hand.abduction), as_argument(change), turned, bent, spread)
    return HandConfiguration(hand.position + change[:, :3], turned, bent.reshape(-1, 5, 3), spread)


def mean_acceleration(points: FloatArray) -> float:
    """Return the mean length of the second differences of points along the frames [m], shape (T, P, 3); 0 below 3."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.norm(np.diff(points, n=2, axis=0), axis=-1).mean())
