"""Pairs of hands' parts that may meet, and how deep a hand is in itself."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.hand_pairs import PartPairs, self_clearances
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.jit import as_argument


@lru_cache(maxsize=8)
def self_pairs(hand: HandModel, fingers: tuple[str, ...] = FINGERS) -> PartPairs:
    """Return the pairs of the parts of some fingers and the palm, without those that are joined.

    Joined are the phalanges of one finger, and parts that overlap in the straight hand, whose angles are zero, or as
    near to it as the limits of flexion allow: a proximal phalanx and the palm.
    """
    straight = np.clip(np.zeros((1, 5, 3)), hand.flexion_min, hand.flexion_max)
    used = [body == PALM_BODY or FINGERS[body // PHALANGES] in fingers for body in range(PALM_BODY + 1)]
    both = ((i, j) for i in range(PALM_BODY) for j in range(PHALANGES * (i // PHALANGES + 1), PALM_BODY + 1))
    may = [PartPairs(np.zeros((1, 2), np.int64), np.array([pair])) for pair in both if used[pair[0]] and used[pair[1]]]
    clear = _clearances(hand, may, straight, np.zeros((1, 5)))
    apart = [pair.part for pair, distance in zip(may, clear) if distance[0] > 0.0]
    part = np.concatenate([np.zeros((0, 2), np.int64), *apart])
    return PartPairs(np.zeros_like(part), part)


def cross_pairs() -> PartPairs:
    """Return the pairs of each part of one hand and each of another."""
    one, other = (part.ravel() for part in np.indices((BODY_COUNT, BODY_COUNT)))
    palm = (one == PALM_BODY) & (other != PALM_BODY)
    hand, part = np.stack([palm, ~palm], axis=1), np.stack([one, other], axis=1)
    part[palm] = part[palm, ::-1]
    return PartPairs(hand.astype(np.int64), part)


def self_clearance(hand: HandModel, pairs: PartPairs, flexion: FloatArray, abduction: FloatArray) -> FloatArray:
    """Compute the least signed distance of a hand's own parts [m], shape (T,), or a lower bound that is not negative.

    Angles [rad] of shapes (T, 5, 3) and (T, 5); not finite gives NaN.
    """
    return _clearances(hand, [pairs], flexion, abduction)[0]


def _clearances(
    hand: HandModel, several: Sequence[PartPairs], flexion: FloatArray, abduction: FloatArray
) -> list[FloatArray]:
    poses = np.zeros(1, HAND_POSE)
    poses["orientation"][:, 0] = 1.0
    arrays, found = hand.shared_arrays, [np.empty(len(flexion)) for _ in several]
    given = as_argument(flexion), as_argument(abduction), poses.view(np.recarray)
    measure: Any = self_clearances
    if several:
        measure = measure.entry(arrays, several[0], *given, found[0])
    for pairs, clear in zip(several, found):
        measure(arrays, pairs, *given, clear)
    return found
