"""Pairs of a hand's own parts that may meet, and how deep a hand is in itself."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.self_pairs import SELF_CONTACT, SelfPairs, self_clearances
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.jit import as_argument


@lru_cache(maxsize=8)
def self_pairs(hand: HandModel, fingers: tuple[str, ...] = FINGERS) -> SelfPairs:
    """Return the pairs of the parts of some fingers and the palm, without those that are joined.

    Joined are the phalanges of one finger, and parts that overlap in the straight hand, whose angles are zero, or as
    near to it as the limits of flexion allow: a proximal phalanx and the palm.
    """
    straight = np.clip(np.zeros((1, 5, 3)), hand.flexion_min, hand.flexion_max)
    used = [body == PALM_BODY or FINGERS[body // PHALANGES] in fingers for body in range(PALM_BODY + 1)]
    both = ((i, j) for i in range(PALM_BODY) for j in range(PHALANGES * (i // PHALANGES + 1), PALM_BODY + 1))
    may = [SelfPairs(np.array([i]), np.array([j])) for i, j in both if used[i] and used[j]]
    apart = [pair for pair, clear in zip(may, _clearances(hand, may, straight, np.zeros((1, 5)))) if clear[0] > 0.0]
    first, second = (np.array([of[k] for of in apart], np.int64).ravel() for k in (0, 1))
    return SelfPairs(first, second)


def self_clearance(hand: HandModel, pairs: SelfPairs, flexion: FloatArray, abduction: FloatArray) -> FloatArray:
    """Compute the least signed distance of a hand's own parts [m], shape (T,), or a lower bound that is not negative.

    Angles [rad] of shapes (T, 5, 3) and (T, 5); not finite gives NaN.
    """
    return _clearances(hand, [pairs], flexion, abduction)[0]


def _clearances(
    hand: HandModel, several: Sequence[SelfPairs], flexion: FloatArray, abduction: FloatArray
) -> list[FloatArray]:
    poses, fresh = np.zeros(1, HAND_POSE), np.zeros(1, SELF_CONTACT)
    poses["orientation"][:, 0] = 1.0
    fresh["bound"] = fresh["floor"] = -np.inf
    arrays, contacts, found = hand.shared_arrays, fresh.copy(), [np.empty(len(flexion)) for _ in several]
    given = as_argument(flexion), as_argument(abduction), poses.view(np.recarray), contacts.view(np.recarray)
    measure: Any = self_clearances
    if several:
        measure = measure.entry(arrays, several[0], *given, found[0])
    for pairs, clear in zip(several, found):
        contacts[:] = fresh
        measure(arrays, pairs, *given, clear)
    return found
