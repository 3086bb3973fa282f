"""Pairs of a hand's own parts that may meet, and how deep a hand is in itself."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.self_pairs import SELF_CONTACT, SelfPairs, self_clearances
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.kernels.jit import as_argument


def self_pairs(hand: HandModel, fingers: Sequence[str] = FINGERS) -> SelfPairs:
    """Return the pairs of the parts of some fingers and the palm, without those that are joined.

    Joined are the phalanges of one finger, and parts that overlap in the straight hand, whose angles are zero, or as
    near to it as the limits of flexion allow: a proximal phalanx and the palm.
    """
    straight = np.clip(np.zeros((1, 5, 3)), hand.flexion_min, hand.flexion_max)
    spread, found = np.zeros((1, 5)), []
    for i in range(PALM_BODY):
        for j in range(PHALANGES * (i // PHALANGES + 1), PALM_BODY + 1):
            used = all(body == PALM_BODY or FINGERS[body // PHALANGES] in fingers for body in (i, j))
            pair = SelfPairs(np.array([i]), np.array([j]))
            if used and self_clearance(hand, pair, straight, spread)[0] > 0.0:
                found.append((i, j))
    first, second = np.array(found, np.int64).reshape(-1, 2).T
    return SelfPairs(np.ascontiguousarray(first), np.ascontiguousarray(second))


def self_clearance(hand: HandModel, pairs: SelfPairs, flexion: FloatArray, abduction: FloatArray) -> FloatArray:
    """Compute the least signed distance of a hand's own parts [m], shape (T,), or a lower bound that is not negative.

    Angles [rad] of shapes (T, 5, 3) and (T, 5); not finite gives NaN.
    """
    poses, contacts = np.zeros(1, HAND_POSE), np.zeros(1, SELF_CONTACT)
    poses["orientation"][:, 0] = 1.0
    contacts["bound"] = contacts["floor"] = -np.inf
    clearance = np.empty(len(flexion))
    angles = as_argument(flexion), as_argument(abduction)
    self_clearances(hand.arrays(), pairs, *angles, poses.view(np.recarray), contacts.view(np.recarray), clearance)
    return clearance
