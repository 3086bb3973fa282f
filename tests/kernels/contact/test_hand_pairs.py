"""Pairs of hands' parts against the referee's bisections, an independent kernel, and finite differences."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import LEFT, RIGHT
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, random_hand, set_pose, sphere_tree

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import cross_pairs, self_pairs
from hhsim.kernels.contact.hand_pairs import hands_distance, measure_pairs, next_bodies, part_distance, write_row
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.hand.pose import HAND_POSE, copy_configuration, move, update_kinematics
from hhsim.metrics.metrics import distance_of_hands
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace
from hhsim.solver.world_engine import WorldEngine
from hhsim.verify.contacts import meetings, parts_that_may_meet
from hhsim.verify.kinematics import OwnHand, pose

HANDS = RIGHT, LEFT
STEP = 1e-6
"""Of a finite difference [m, rad]."""


@pytest.fixture(scope="module")
def pairs() -> Any:
    """Pairs of all parts of two hands in the air."""
    air = sphere_tree(np.full((1, 3), 50.0), np.array([0.01])).arrays()
    spaces = [TickWorkspace(hand, air, SolverOptions(self_contact=True)) for hand in HANDS]
    return WorldEngine(spaces[0], None, spaces[1]).hand_pairs


def place(pairs: Any, seed: int) -> list[HandConfiguration]:
    """Place both hands at random, near each other."""
    random = np.random.default_rng(seed)
    found = [random_hand(random, hand, 0.1) for hand in HANDS]
    found[1] = found[1]._replace(position=found[0].position + random.normal(0.0, 0.08, 3))
    for hand, state, at in zip(HANDS, pairs.states, found):
        set_pose(hand, state.pose, at)
    return found


def posed(hand: HandModel, at: HandConfiguration) -> Any:
    here = np.zeros(1, HAND_POSE).view(np.recarray)[0]
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
def test_distances_of_own_parts_are_those_of_the_referee(seed: int) -> None:
    hand = RIGHT if seed % 2 else LEFT
    at, own = random_hand(np.random.default_rng(seed), hand, 0.3), self_pairs(hand).part
    here, expected, arrays = posed(hand, at), judged(hand, at), hand.arrays()
    found = [part_distance(arrays, here, arrays, here, i, j) for i, j in own]
    # Which pairs may meet the referee has found for itself.
    assert np.isfinite(expected).sum() == len(found)
    np.testing.assert_allclose(found, expected[own[:, 0], own[:, 1]], atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_least_distance_of_two_hands_is_that_of_all_pairs(pairs: Any, seed: int) -> None:
    placed = [forward_kinematics(hand, *at) for hand, at in zip(HANDS, place(pairs, seed))]
    one, other = (state.pose for state in pairs.states[:2])
    found = hands_distance(cross_pairs(), pairs.one, one, pairs.other, other)
    assert found == pytest.approx(float(distance_of_hands(HANDS, placed)[0]), abs=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_bounds_are_no_more_than_distances_however_hands_have_moved(pairs: Any, seed: int) -> None:
    place(pairs, seed)
    random, rows = np.random.default_rng(seed), pairs.rows[0]
    for size in 10.0 ** random.uniform(-5.0, -1.0, 20):
        for arrays, state in zip((pairs.one, pairs.other), pairs.states):
            move(state.pose, size * random.normal(0.0, 1.0, DOF) * ([0.1] * 3 + [1.0] * 18), np.zeros(5), 1.0)
            update_kinematics(arrays, state.pose)
        measure_pairs(pairs, 1e-4)
        arrays, poses = (pairs.one, pairs.other), [state.pose for state in pairs.states[:2]]
        least = [np.inf, np.inf]
        for (h, k), (i, j) in zip(pairs.hand, pairs.part):
            distance = part_distance(arrays[h], poses[h], arrays[k], poses[k], i, j)
            least[int(h != k)] = min(least[int(h != k)], distance)
        for bound, distance in zip(rows["least"], least):
            assert bound <= distance + 1e-12
            assert bound >= 1e-4 or bound == pytest.approx(distance, abs=1e-12)


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 1.0, exclude_max=True), which=st.integers(0, 9))
@settings(max_examples=40, deadline=None)
def test_a_row_is_the_rate_of_the_distance(pairs: Any, seed: int, share: float, which: int) -> None:
    place(pairs, seed)
    pair, rows, arrays = int(share * len(pairs.part)), pairs.rows[0], (pairs.one, pairs.other)
    (h, k), (part, other_part) = pairs.hand[pair], pairs.part[pair]
    given_parts = arrays[h], pairs.states[h].pose, arrays[k], pairs.states[k].pose, part, other_part
    body = other = -1
    for _ in range(which + 1):
        found = next_bodies(*given_parts, np.inf, body, other)
        body, other = found[:2] if found[0] >= 0 else (body, other)
    write_row(pairs, pair, body, other, 0)
    gradient, spread = np.array(rows["gradient"][0]), np.array(rows["spread"][0])
    if rows["distance"][0] < -4e-3:
        return
    for hand in range(2):
        at = pairs.states[hand].pose
        start = at.copy()
        for j in range(DOF + 5):
            step, turn = np.zeros(DOF), np.zeros(5)
            (step if j < DOF else turn)[j % DOF] = 1.0
            ahead = []
            for way in (STEP, -STEP):
                copy_configuration(start, at)
                move(at, step, turn, way)
                update_kinematics(arrays[hand], at)
                write_row(pairs, pair, body, other, 1)
                ahead.append(float(rows["distance"][1]))
            rate = gradient[hand, j] if j < DOF else spread[hand, j - DOF]
            # Where two phalanges are parallel, or one axis passes through the other, the rate jumps.
            assert (ahead[0] - ahead[1]) / (2 * STEP) == pytest.approx(rate, abs=2e-5)
        copy_configuration(start, at)
        update_kinematics(arrays[hand], at)
