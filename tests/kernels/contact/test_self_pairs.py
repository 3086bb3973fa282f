"""Pairs of the hand's own parts against the referee's bisections, finite differences, and all pairs measured anew."""

from typing import Any

import numpy as np
from contact_scenes import LEFT, RIGHT, moved
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, random_hand, set_pose

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_pairs
from hhsim.kernels.contact.self_pairs import SELF_CONTACT, WHOLE_PALM, pair_distance, write_row
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.verify.contacts import meetings, parts_that_may_meet
from hhsim.verify.kinematics import OwnHand, pose

STEP = 1e-6
"""Of the central differences [rad]."""
PAIRS = {hand.side: self_pairs(hand) for hand in (RIGHT, LEFT)}


def record(dtype: "np.dtype[Any]") -> Any:
    return np.zeros(1, dtype).view(np.recarray)[0]


def fresh() -> Any:
    own = record(SELF_CONTACT)
    own.bound[:] = own.floor = -np.inf
    return own


def posed(hand: HandModel, at: HandConfiguration) -> Any:
    here = record(HAND_POSE)
    set_pose(hand, here, at)
    return here


def judged(hand: HandModel, at: HandConfiguration) -> FloatArray:
    """The referee's least distance of each two bodies, shape (15, 16); infinite for those that never meet."""
    names = [name for name in OwnHand._fields if not name.startswith("palm") and name != "sign"]
    sizes = {name: getattr(hand, name) for name in names}
    palm = {"palm_center": hand.palm_tree.leaf_center, "palm_radius": hand.palm_tree.leaf_radius}
    own = OwnHand(**sizes, **palm, sign=hand.abduction_sign)
    found = meetings(own, pose(own, at), parts_that_may_meet(own, np.ones(5, bool)), 1.0)
    distance = np.full((PALM, PALM + 1), np.inf)
    np.minimum.at(distance, (found.body, found.leaf), found.distance)
    return distance


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=12, deadline=None)
def test_distances_are_those_of_the_referee(seed: int) -> None:
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    at, pairs = random_hand(random, hand, 0.3), PAIRS[hand.side]
    here, expected = posed(hand, at), judged(hand, at)
    found = [pair_distance(hand.arrays(), here, i, j) for i, j in zip(pairs.first, pairs.second)]
    # Which pairs may meet the referee has found for itself.
    assert np.isfinite(expected).sum() == len(found)
    np.testing.assert_allclose(found, expected[pairs.first, pairs.second], atol=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_rows_are_the_gradients_of_the_distances(seed: int) -> None:
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    pairs, own = PAIRS[hand.side], fresh()
    at = random_hand(random, hand, 0.1)
    i = int(random.integers(len(pairs.first)))
    first, second = int(pairs.first[i]), int(pairs.second[i])
    here = posed(hand, at)
    if second == PALM:
        whole = pair_distance(hand.arrays(), here, first, second)
        for sphere in range(len(hand.palm_tree.leaf_radius)):
            write_row(hand.arrays(), here, first, second, sphere, 0, own)
            if own.distance[0] == whole or abs(own.distance[0] - whole) < 1e-12:
                break
    else:
        write_row(hand.arrays(), here, first, second, WHOLE_PALM, 0, own)
    assert abs(own.distance[0] - pair_distance(hand.arrays(), here, first, second)) < 1e-12
    if own.distance[0] < -4e-3:
        return
    for direction, rate in zip(np.eye(26), [*own.gradient[0], *own.spread[0]]):
        ahead, behind = (
            pair_distance(hand.arrays(), posed(hand, moved(at, h * direction[:21], h * direction[21:])), first, second)
            for h in (STEP, -STEP)
        )
        # At a crease between two palm spheres or two ends of an axis the difference is of both sides.
        assert abs((ahead - behind) / (2.0 * STEP) - rate) < 2e-5 or second == PALM
