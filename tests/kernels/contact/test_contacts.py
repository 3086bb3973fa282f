"""Contacts against all pairs, their rows against finite differences, rows to leave out; and pairs of hands' parts."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import LEFT, RIGHT, ROOT, assert_grouped, in_contact, moved, pair_of, posed, row_matrix, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, brute_pairs, bumpy_ball, cloud, pose_of, random_hand, set_pose, sphere_tree, tick_state

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.self_pairs import cross_pairs, self_pairs
from hhsim.kernels.contact.detection import CONTACT_ROWS, COUNT_GATHERS, FULL, ListDistances, evaluate, find_contacts
from hhsim.kernels.contact.hand_pairs import hands_distance, measure_pairs, next_bodies, part_distance, write_row
from hhsim.kernels.contact.linearise import LIMIT_ROWS, build_rows, drop_redundant_contacts, limit_start
from hhsim.kernels.contact.lists import PHALANX_CAPACITY
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, motion_bounds
from hhsim.kernels.hand.pose import copy_configuration, move, update_kinematics
from hhsim.metrics.metrics import distance_of_hands
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace
from hhsim.solver.world_engine import WorldEngine
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.contacts import meetings, parts_that_may_meet
from hhsim.verify.kinematics import OwnHand, pose

SEEDS = st.integers(0, 2**32 - 1)
ROUNDING = 1e-12
"""Pairs nearer to the margin than this [m] may fall on either side."""
STEP = 1e-6
"""Of the central differences [m, rad]: rounding of 1e-16 m / 1e-6, curvature of 1e-12 · 1e3 1/m."""
ACCURACY = 2e-7
OFFSET = 5e-7


def at_pose(hand: HandModel, at: HandConfiguration) -> Any:
    """The state of a tick before its pairs are found."""
    state = tick_state(ROOT**2)
    set_pose(hand, state.pose, at)
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
    assert evaluate(arrays, state.pose, nodes, ListDistances(margin, margin, skin), state.candidates, state.work) == 0
    assert find_contacts(nodes, arrays, state.pose, state.candidates, margin, state.contacts) == 0


@given(SEEDS, st.sampled_from([1e-4, 1e-3, 5e-3]), st.sampled_from([0.0, 3e-3, 0.02]))
@settings(max_examples=40)
def test_the_contacts_are_exactly_the_pairs_within_the_margin(seed: int, margin: float, skin: float) -> None:
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    tree = cloud(random, int(random.integers(1, 400)))
    state = at_pose(hand, random_hand(random, hand, 0.05))
    detect(state, hand, tree, margin, skin)
    assert_grouped(state.contacts)
    distance = assert_exactly_the_near_pairs(state, hand, tree, margin)
    least = np.append(distance[:PALM].min(axis=1), distance[PALM:].min())
    near = least <= margin
    np.testing.assert_allclose(state.candidates.nearest[near], least[near], atol=ROUNDING)
    assert (state.candidates.nearest[~near] > margin - ROUNDING).all()
    # Records say where the surfaces are nearest.
    contacts, at = state.contacts, pose_of(state)
    for (body, leaf), i in list(found_pairs(state, tree).items())[:40]:
        normal, point = contacts.normal[:, i], contacts.point[:, i]
        assert contacts.body[i] == min(body, PALM)
        assert contacts.distance[i] == pytest.approx(distance[body, leaf], abs=1e-12)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
        on_object = tree.leaf_center[leaf] + tree.leaf_radius[leaf] * normal
        np.testing.assert_allclose(point - contacts.distance[i] * normal, on_object, atol=1e-12)
        # On the hand's surface; deep inside, the point is where the sphere of the hand that is nearest would leave.
        surface = brute_pairs(hand, point[None], np.zeros(1), at)[body, 0]
        assert surface == pytest.approx(0.0, abs=1e-9) or contacts.distance[i] < -0.5 * tree.leaf_radius[leaf]
        # From the object to the hand: a hand that goes that way gets away at full rate.
        away = HandConfiguration(at.position + 1e-7 * normal, *at[1:])
        gone = brute_pairs(hand, tree.leaf_center[leaf : leaf + 1], tree.leaf_radius[leaf : leaf + 1], away)[body, 0]
        assert gone - distance[body, leaf] == pytest.approx(1e-7, rel=1e-3)


@given(SEEDS, st.sampled_from([0.0, 1e-3, 4e-3]))
@settings(max_examples=8)
def test_no_pair_is_ever_missed_while_the_hand_wanders(seed: int, skin: float) -> None:
    random = np.random.default_rng(seed)
    margin = 1e-3
    tree = cloud(random, 300)
    state, arrays = at_pose(RIGHT, random_hand(random, RIGHT, 0.05)), RIGHT.arrays()
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


def test_more_pairs_than_there_is_room_for_are_reported() -> None:
    at, arrays = still(np.zeros(3)), RIGHT.arrays()
    state, joints, size = at_pose(RIGHT, at), RIGHT.joints(*at.at(0)), RIGHT.radius
    # Spheres of 1 mm, half a millimetre off fingertips.
    places = [joints[f, 3] - [0.0, 0.0, size[f, 3] + 1.5e-3] for f in (1, 3)]
    # Those that touch are listed with any reach.
    touching = np.tile(places[0] + [0.0, 0.0, 5e-4], (PHALANX_CAPACITY + 1, 1))
    near = sphere_tree(touching, np.full(PHALANX_CAPACITY + 1, 1e-3))
    assert (
        evaluate(arrays, state.pose, near.arrays(), ListDistances(1e-3, 1e-3, 3e-3), state.candidates, state.work)
        == FULL
    )
    # Two bodies with room for their own pairs, but not together among the contacts.
    half = CONTACT_ROWS // 2 + 1
    two = sphere_tree(np.repeat(places, half, axis=0), np.full(2 * half, 1e-3))
    state.candidates.gathered_slack[:] = -np.inf
    assert evaluate(arrays, state.pose, two.arrays(), ListDistances(1e-3, 1e-3, 0.0), state.candidates, state.work) == 0
    assert find_contacts(two.arrays(), arrays, state.pose, state.candidates, 1e-3, state.contacts) == FULL


def rates(hand: HandModel, tree: SphereTree, at: HandConfiguration, step: FloatArray, turn: FloatArray) -> FloatArray:
    """How fast all distances change along a step and a turn of the abduction, as `brute_pairs`."""
    ahead, behind = (
        brute_pairs(hand, tree.leaf_center, tree.leaf_radius, moved(at, width * step, width * turn))
        for width in (STEP, -STEP)
    )
    return (ahead - behind) / (2.0 * STEP)


@given(SEEDS, st.floats(-0.3, 0.3))
@settings(max_examples=25)
def test_rows_are_the_gradients_of_the_true_distances_and_hold_offset_distance_and_abduction(
    seed: int, angle: float
) -> None:
    hand, tree, at, state = scene(seed)
    distance = brute_pairs(hand, tree.leaf_center, tree.leaf_radius, at)
    rate = [rates(hand, tree, at, np.zeros(DOF), turn) for turn in np.eye(5)]
    state.problem.abduction_step[:] = angle * np.linspace(-1.0, 1.0, 5)
    build_rows(hand.arrays(), state.pose, state.contacts, OFFSET, False, state.problem.abduction_step, state.problem)
    matrix = row_matrix(state)
    difference = np.array([rates(hand, tree, at, direction, np.zeros(5)) for direction in np.eye(DOF)])
    for i in range(state.contacts.start[-1]):
        body, leaf = pair_of(state, tree, i)
        # So deep a difference could cross the axis of a body, where the distance has a crease.
        if distance[body, leaf] <= -0.9 * tree.leaf_radius[leaf]:
            continue
        np.testing.assert_allclose(matrix[i], difference[:, body, leaf], atol=ACCURACY)
        follows = 0.0 if body >= PALM else rate[body // 3][body, leaf] * state.problem.abduction_step[body // 3]
        assert state.problem.rhs[i] == pytest.approx(OFFSET - distance[body, leaf] - follows, abs=ACCURACY)


@given(SEEDS, st.sampled_from([0.0, 0.4]))
@settings(max_examples=40)
def test_limit_rows_say_what_the_limits_say(seed: int, beyond: float) -> None:
    random = np.random.default_rng(seed)
    flexion = random.uniform(RIGHT.flexion_min - beyond, RIGHT.flexion_max + beyond)
    state = at_pose(RIGHT, still(np.zeros(3), flexion=flexion))
    # A joint beyond its limits may go no farther.
    low, high = np.minimum(flexion, RIGHT.flexion_min), np.maximum(flexion, RIGHT.flexion_max)
    state.contacts.start[:] = 0
    state.problem.common[:] = np.nan
    state.problem.block[:] = np.nan
    build_rows(RIGHT.arrays(), state.pose, state.contacts, OFFSET, False, state.problem.abduction_step, state.problem)
    assert limit_start(state.contacts, 5) == LIMIT_ROWS
    step = random.normal(0.0, 1.0, (5, 3))
    reached = flexion + step
    for f in range(5):
        rows = slice(limit_start(state.contacts, f), limit_start(state.contacts, f + 1))
        assert (state.problem.common[:, rows] == 0.0).all()
        block, rhs = state.problem.block[:, rows], state.problem.rhs[rows]
        assert (rhs <= 0.0).all(), "standing still is allowed"
        holds = block.T @ (step[f] * ROOT[6 + 3 * f : 9 + 3 * f]) >= rhs
        assert holds.all() == bool(((reached[f] >= low[f]) & (reached[f] <= high[f])).all())


def on_a_patch(seed: int, leaves: int) -> tuple[SphereTree, HandConfiguration]:
    """A hand that lies on a ball of overlapping spheres, less than half a millimetre off it."""
    random = np.random.default_rng(seed)
    tree = bumpy_ball(leaves)
    flexion = random.uniform(0.0, 0.6, (5, 3))
    gap, along = random.uniform(0.0, 5e-4), random.uniform(-0.08, 0.0)
    low, high = 0.0, 0.2
    for _ in range(40):
        height = 0.5 * (low + high)
        at = still([0.0, along, height], flexion=flexion)
        if brute_pairs(RIGHT, tree.leaf_center, tree.leaf_radius, at).min() > gap:
            high = height
        else:
            low = height
    return tree, still([0.0, along, high], flexion=flexion)


def rows_of(state: Any) -> tuple[FloatArray, FloatArray, list[int]]:
    build_rows(RIGHT.arrays(), state.pose, state.contacts, OFFSET, False, state.problem.abduction_step, state.problem)
    count = int(state.contacts.start[-1])
    return row_matrix(state), np.array(state.problem.rhs[:count]), [int(key) for key in state.contacts.key[:count]]


@settings(max_examples=12, deadline=None)
@given(SEEDS, st.sampled_from([300, 1000, 3000]), st.sampled_from([1e-3, 2e-4]))
def test_every_dropped_row_follows_from_the_kept_ones(seed: int, leaves: int, reach: float) -> None:
    tree, at = on_a_patch(seed, leaves)
    state = in_contact(RIGHT, tree.arrays(), at, reach)
    matrix, rhs, keys = rows_of(state)
    drop_redundant_contacts(RIGHT.arrays(), reach, state.contacts, np.zeros(CONTACT_ROWS))
    _, _, kept = rows_of(state)
    keeps = np.isin(keys, kept)
    assert set(kept) <= set(keys)
    bodies = {min(key // len(tree.radius), PALM) for key in keys}
    if not bodies:
        return
    random = np.random.default_rng(seed)
    for _ in range(200):
        # In which no point of these bodies moves farther than the reach, and one about so far.
        step, motion = random.normal(size=21) / ROOT * 10.0 ** random.uniform(-1.0, 1.0, 21), np.zeros(16)
        motion_bounds(RIGHT.arrays(), state.pose, step, np.zeros(5), 0.0, motion)
        step *= reach / motion[sorted(bodies)].max()
        change = matrix @ step
        # To the edge of what the kept rows allow, where a dropped one would show first.
        towards = change[keeps] < 0.0
        share = np.min(rhs[keeps][towards] / change[keeps][towards], initial=1.0)
        if share >= 0.0 and (share * change >= rhs)[keeps & (change > 0.0)].all():
            assert (share * change - rhs)[~keeps].min(initial=0.0) >= -1e-15


HANDS = RIGHT, LEFT


@pytest.fixture(scope="module")
def pairs() -> Any:
    """Pairs of all parts of two hands in the air."""
    air = sphere_tree(np.full((1, 3), 50.0), np.array([0.01])).arrays()
    spaces = [TickWorkspace(hand, air, SolverOptions(self_contact=True)) for hand in HANDS]
    return WorldEngine(*spaces).hand_pairs


def place(pairs: Any, seed: int) -> list[HandConfiguration]:
    """Place both hands at random, near each other."""
    random = np.random.default_rng(seed)
    found = [random_hand(random, hand, 0.1) for hand in HANDS]
    found[1] = found[1]._replace(position=found[0].position + random.normal(0.0, 0.08, 3))
    for hand, state, at in zip(HANDS, pairs.states, found):
        set_pose(hand, state.pose, at)
    return found


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
    found = hands_distance(cross_pairs(), pairs.first_hand, one, pairs.second_hand, other)
    assert found == pytest.approx(float(distance_of_hands(HANDS, placed)[0]), abs=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_bounds_are_no_more_than_distances_however_hands_have_moved(pairs: Any, seed: int) -> None:
    place(pairs, seed)
    random, rows = np.random.default_rng(seed), pairs.rows[0]
    for size in 10.0 ** random.uniform(-5.0, -1.0, 20):
        for arrays, state in zip((pairs.first_hand, pairs.second_hand), pairs.states):
            move(state.pose, size * random.normal(0.0, 1.0, DOF) * ([0.1] * 3 + [1.0] * 18), np.zeros(5), 1.0)
            update_kinematics(arrays, state.pose)
        measure_pairs(pairs, 1e-4)
        arrays, poses = (pairs.first_hand, pairs.second_hand), [state.pose for state in pairs.states[:2]]
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
    pair, rows, arrays = int(share * len(pairs.part)), pairs.rows[0], (pairs.first_hand, pairs.second_hand)
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
