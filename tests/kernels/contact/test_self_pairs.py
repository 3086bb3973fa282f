"""Pairs of the hand's own parts against the referee's bisections, finite differences, and all pairs measured anew."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import LEFT, RIGHT, moved
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, random_hand, set_pose

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import self_clearance, self_pairs
from hhsim.kernels.contact.own_parts import NO_PARTS, measure_own
from hhsim.kernels.contact.self_pairs import (
    LASTS,
    SELF_CONTACT,
    STEEP,
    WHOLE_PALM,
    add_bends,
    choose_bends,
    measure_pairs,
    pair_distance,
    write_row,
)
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.verify.contacts import meetings, parts_that_may_meet
from hhsim.verify.kinematics import OwnHand, pose

MARGIN = 1e-3
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


def test_only_what_is_joined_in_the_straight_hand_is_left_out() -> None:
    pairs = PAIRS["right"]
    # 90 pairs of two fingers' phalanges, and with the palm those but the proximal ones.
    assert len(pairs.first) == 90 + 10
    assert set(pairs.first[pairs.second == PALM] % 3) == {1, 2}
    straight = self_clearance(RIGHT, pairs, np.zeros((1, 5, 3)), np.zeros((1, 5)))
    assert 0.0 < straight[0] < MARGIN
    used = self_pairs(RIGHT, ("thumb", "ring"))
    assert set(used.first) | set(used.second) == {0, 1, 2, 9, 10, 11, PALM}
    assert len(self_pairs(RIGHT, ("thumb",)).first) == 2 and len(self_pairs(RIGHT, ()).first) == 0


@given(st.integers(0, 2**32 - 1), st.lists(st.floats(-6.0, 0.0), min_size=4, max_size=30))
@settings(max_examples=60, deadline=None)
@pytest.mark.soak
def test_no_near_pair_is_missed_however_the_hand_moves(seed: int, exponents: list[float]) -> None:
    random = np.random.default_rng(seed)
    hand, pairs, own = RIGHT, PAIRS["right"], fresh()
    at = random_hand(random, hand, 0.1)
    for exponent in exponents:
        step, turn = 10.0**exponent * random.normal(size=21), 10.0**exponent * random.normal(size=5)
        at = moved(at, step, turn)
        here = posed(hand, at)
        measure_pairs(pairs, hand.arrays(), here, MARGIN, own)
        true = np.array([pair_distance(hand.arrays(), here, i, j) for i, j in zip(pairs.first, pairs.second)])
        assert own.least <= true.min() + 1e-12
        assert own.least == true.min() or own.least >= MARGIN
        looked_at, bound = own.least == own.floor, own.bound[: len(true)]
        if looked_at:
            assert (bound <= true + 1e-12).all() and bound.min() == own.least
            near = bound < MARGIN + LASTS
            np.testing.assert_array_equal(bound[near], true[near])


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


def test_a_hand_whose_parts_go_through_each_other_measures_none() -> None:
    own = fresh()
    own.least = np.inf
    measure_own(NO_PARTS, RIGHT.arrays(), record(HAND_POSE), MARGIN, own)
    assert own.least == np.inf and (own.bound == -np.inf).all()


def test_a_hand_that_is_not_finite_has_no_clearance_and_spoils_no_other() -> None:
    flexion, abduction = np.zeros((4, 5, 3)), np.zeros((4, 5))
    flexion[1, 2, 1] = np.nan
    found = self_clearance(RIGHT, PAIRS["right"], flexion, abduction)
    np.testing.assert_array_equal(np.isnan(found), [False, True, False, False])
    assert found[3] > 0.0


def second_difference(at: HandConfiguration, step: FloatArray, first: int, second: int, size: float) -> float:
    """Second derivative of a pair's distance along a step, by central differences."""
    moved_hands = (at._replace(flexion=at.flexion + size * k * step[6:].reshape(1, 5, 3)) for k in (-1, 0, 1))
    before, here, after = (pair_distance(RIGHT.arrays(), posed(RIGHT, one), first, second) for one in moved_hands)
    return float(before - 2.0 * here + after) / size**2


def test_second_derivatives_of_a_pair_are_those_of_its_distance() -> None:
    random, pairs, looked = np.random.default_rng(8), PAIRS["right"], 0
    arrays = RIGHT.arrays()
    for _ in range(200):
        at = random_hand(random, RIGHT, 0.01)
        here, own = posed(RIGHT, at), fresh()
        pair = int(random.integers(len(pairs.first)))
        first, second = int(pairs.first[pair]), int(pairs.second[pair])
        if second == PALM:
            continue
        own.pair[0], own.sphere[0], own.count = pair, WHOLE_PALM, 1
        write_row(arrays, here, first, second, WHOLE_PALM, 0, own)
        step, product = np.zeros(21), np.zeros(21)
        step[6:] = random.normal(size=15)
        choose_bends(pairs, True, arrays, here, own)
        row, force, root = np.array([3, 40, 41]), np.array([9.0, 2.0, 5.0]), np.full(21, 0.5)
        add_bends(pairs, here, own, 40, row, force, root, step, product)

        wide, narrow = (second_difference(at, step, first, second, size) for size in (2e-4, 1e-4))
        # Where the nearest point comes to an end of an axis the distance has no second derivative.
        if abs(wide - narrow) > 1e-3 * abs(narrow) + 1e-5:
            continue
        looked += 1
        assert step @ product == pytest.approx(2.0 * narrow, rel=0.01, abs=1e-3)
        assert not product[:6].any()
        assert own.steep == (abs(step @ product) > STEEP * (step[6:] / 0.5 @ step[6:] / 0.5))
    assert looked > 100
