"""Detection against all pairs one by one, at rest and while the hand wanders."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import assert_grouped
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, brute_pairs, cloud, pose_of, random_hand, set_pose, sphere_tree, tick_state

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import CONTACT_ROWS, COUNT_GATHERS, FULL, Reach, evaluate, find_contacts
from hhsim.kernels.contact.lists import PHALANX_CAPACITY
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, motion_bounds
from hhsim.kernels.hand.pose import move, update_kinematics
from hhsim.motion.analytic_motion import still
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
JOINTS = RIGHT.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.zeros((5, 3)), np.zeros(5))
ROUNDING = 1e-12
"""Pairs nearer to the margin than this [m] may fall on either side."""


def new_state() -> Any:
    return tick_state(np.ones(DOF))


def at_origin() -> Any:
    state = new_state()
    set_pose(RIGHT, state.pose, still(np.zeros(3)))
    return state


def found_pairs(state: Any, tree: SphereTree) -> dict[tuple[int, int], int]:
    total = len(tree.radius)
    count = state.contacts.start[-1]
    keys = state.contacts.key[:count]
    pairs = {(int(key // total), int(key % total) - tree.leaf_start): i for i, key in enumerate(keys)}
    assert len(pairs) == count
    return pairs


def assert_exactly_the_near_pairs(state: Any, hand: HandModel, tree: SphereTree, margin: float) -> FloatArray:
    distance = brute_pairs(hand, tree.leaf_center, tree.leaf_radius, pose_of(state))
    found = set(found_pairs(state, tree))
    assert set(zip(*(i.tolist() for i in np.nonzero(distance <= margin - ROUNDING)))) <= found
    assert found <= set(zip(*(i.tolist() for i in np.nonzero(distance <= margin + ROUNDING))))
    return distance


def detect(state: Any, hand: HandModel, tree: SphereTree, margin: float, skin: float) -> None:
    arrays, nodes = hand.arrays(), tree.arrays()
    assert evaluate(arrays, state.pose, nodes, Reach(margin, margin, skin), state.candidates, state.work) == 0
    assert find_contacts(nodes, arrays, state.pose, state.candidates, margin, state.contacts) == 0


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-4, 1e-3, 5e-3]), st.sampled_from([0.0, 3e-3, 0.02]))
@settings(max_examples=40)
def test_the_contacts_are_exactly_the_pairs_within_the_margin(seed: int, margin: float, skin: float) -> None:
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    tree = cloud(random, int(random.integers(1, 400)))
    state = new_state()
    set_pose(hand, state.pose, random_hand(random, hand, 0.05))
    detect(state, hand, tree, margin, skin)
    assert_grouped(state.contacts)
    distance = assert_exactly_the_near_pairs(state, hand, tree, margin)
    least = np.append(distance[:PALM].min(axis=1), distance[PALM:].min())
    near = least <= margin
    np.testing.assert_allclose(state.candidates.nearest[near], least[near], atol=ROUNDING)
    assert (state.candidates.nearest[~near] > margin - ROUNDING).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-3, 4e-3]))
@settings(max_examples=8)
def test_no_pair_is_ever_missed_while_the_hand_wanders(seed: int, skin: float) -> None:
    random = np.random.default_rng(seed)
    margin = 1e-3
    tree = cloud(random, 300)
    state = new_state()
    arrays = RIGHT.arrays()
    set_pose(RIGHT, state.pose, random_hand(random, RIGHT, 0.05))
    motion = np.empty(BODY_COUNT)
    steps = 60
    for _ in range(steps):
        detect(state, RIGHT, tree, margin, skin)
        assert_exactly_the_near_pairs(state, RIGHT, tree, margin)
        step, turn = random.normal(size=DOF), random.normal(size=5)
        step[:3] *= 1e-3
        step[3:] *= 10.0 ** random.uniform(-4, -2)
        turn *= 10.0 ** random.uniform(-4, -2)
        motion_bounds(arrays, state.pose, step, turn, 0.0, motion)
        # As the tick does: no body moves further than the pairs at hand vouch for.
        fraction = min(1.0, float(np.min(np.maximum(state.candidates.slack, margin) / motion)))
        move(state.pose, step, turn, fraction)
        update_kinematics(arrays, state.pose)
    if skin > 0.0:
        assert state.work[COUNT_GATHERS] < 0.9 * steps * BODY_COUNT, "the lists never last"


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=5)
def test_records_say_where_the_surfaces_are_nearest(seed: int) -> None:
    random = np.random.default_rng(seed)
    tree = cloud(random, 300)
    state = new_state()
    set_pose(RIGHT, state.pose, random_hand(random, RIGHT, 0.05))
    detect(state, RIGHT, tree, 5e-3, 0.0)
    contacts, at = state.contacts, pose_of(state)
    distance = brute_pairs(RIGHT, tree.leaf_center, tree.leaf_radius, at)
    for (body, leaf), i in found_pairs(state, tree).items():
        normal, point = contacts.normal[:, i], contacts.point[:, i]
        assert contacts.body[i] == min(body, PALM)
        assert contacts.distance[i] == pytest.approx(distance[body, leaf], abs=1e-12)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
        on_object = tree.leaf_center[leaf] + tree.leaf_radius[leaf] * normal
        np.testing.assert_allclose(point - contacts.distance[i] * normal, on_object, atol=1e-12)
        # On the hand's surface; deep inside, the point is where the sphere of the hand that is nearest would leave.
        surface = brute_pairs(RIGHT, point[None], np.zeros(1), at)[body, 0]
        assert surface == pytest.approx(0.0, abs=1e-9) or contacts.distance[i] < -0.5 * tree.leaf_radius[leaf]
        # From the object to the hand: a hand that goes that way gets away at full rate.
        away = HandConfiguration(at.position + 1e-7 * normal, *at[1:])
        gone = brute_pairs(RIGHT, tree.leaf_center[leaf : leaf + 1], tree.leaf_radius[leaf : leaf + 1], away)[body, 0]
        assert gone - distance[body, leaf] == pytest.approx(1e-7, rel=1e-3)


def crowd_under_the_index_tip(count: int, depth: float) -> tuple[FloatArray, FloatArray]:
    tip = JOINTS[1, 3]
    center = tip + np.array([0.0, 0.0, -(RIGHT.radius[1, 3] + 1e-3 + depth)])
    return np.repeat(center[None], count, axis=0), np.full(count, 1e-3)


def test_more_pairs_than_there_is_room_for_are_reported() -> None:
    state = at_origin()
    arrays = RIGHT.arrays()
    near = sphere_tree(*crowd_under_the_index_tip(PHALANX_CAPACITY + 1, 0.0))
    assert evaluate(arrays, state.pose, near.arrays(), Reach(1e-3, 1e-3, 3e-3), state.candidates, state.work) == FULL
    # Two bodies with room for their own pairs, but not together among the contacts.
    half = CONTACT_ROWS // 2 + 1
    below = np.array([0.0, 0.0, 1e-3 + 5e-4])
    places = [JOINTS[f, 3] - below - [0.0, 0.0, RIGHT.radius[f, 3]] for f in (1, 3)]
    two = sphere_tree(np.repeat(places, half, axis=0), np.full(2 * half, 1e-3))
    state.candidates.gathered_slack[:] = -np.inf
    assert evaluate(arrays, state.pose, two.arrays(), Reach(1e-3, 1e-3, 0.0), state.candidates, state.work) == 0
    assert find_contacts(two.arrays(), arrays, state.pose, state.candidates, 1e-3, state.contacts) == FULL
