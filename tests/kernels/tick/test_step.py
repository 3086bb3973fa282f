"""What a step loads: contacts that are found again in the next records, and how their distances curve."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import moved, pair_of, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, brute_pairs

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.linearise import LIMIT_ROWS
from hhsim.kernels.hand.kinematics import DOF, PALM_BODY
from hhsim.kernels.tick.curvature import curvature_product
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, ACTIVE_CONTACTS, STEP, guess_rows, store_active
from hhsim.trees.sphere_tree import SphereTree


def loaded_step(random: np.random.Generator, contacts: Any) -> Any:
    """A step that loads some contacts and some joint limits."""
    rows = int(contacts.start[-1]) + LIMIT_ROWS
    step = np.zeros(1, STEP).view(np.recarray)[0]
    step.count = min(int(random.integers(0, 40)), rows)
    step.row[: step.count] = random.choice(rows, size=step.count, replace=False)
    step.multiplier[: step.count] = random.exponential(size=step.count)
    return step


def owner(contacts: Any, row: int) -> int:
    """Group of a row: 0 for the palm, 1 + finger for the others."""
    total = int(contacts.start[-1])
    if row >= total:
        return 1 + (row - total) // (LIMIT_ROWS // 5)
    body = int(contacts.body[row])
    return 0 if body == PALM_BODY else 1 + body // 3


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_loaded_rows_are_kept_and_found_again(seed: int) -> None:
    random = np.random.default_rng(seed)
    _, _, _, state = scene(seed)
    contacts, total = state.contacts, int(state.contacts.start[-1])
    step = loaded_step(random, contacts)
    active = np.zeros(1, ACTIVE_CONTACTS).view(np.recarray)[0]
    store_active(contacts, step, active)
    assert active.count == step.count
    for i, row in enumerate(step.row[: step.count]):
        assert active.multiplier[i] == step.multiplier[i]
        if row < total:
            assert active.key[i] == contacts.key[row]
            assert active.body[i] == contacts.body[row]
            np.testing.assert_array_equal(active.point[:, i], contacts.point[:, row])
            np.testing.assert_array_equal(active.normal[:, i], contacts.normal[:, row])
        else:
            assert active.body[i] == -1
            assert active.key[i] == -1 - (row - total)
    found: list[int] = []
    for group in range(6):
        guess = np.full(ACTIVE_CAPACITY, -7, dtype=np.int64)
        filled = guess_rows(contacts, active, group, guess, 0)
        wanted = [int(row) for row in step.row[: step.count] if owner(contacts, int(row)) == group]
        assert sorted(guess[:filled].tolist()) == sorted(wanted)
        found += guess[:filled].tolist()
    assert sorted(found) == sorted(step.row[: step.count].tolist())


def test_contacts_that_are_gone_are_not_guessed_and_the_room_is_kept_to() -> None:
    _, _, _, state = scene(11)
    contacts = state.contacts
    random = np.random.default_rng(0)
    step = loaded_step(random, contacts)
    active = np.zeros(1, ACTIVE_CONTACTS).view(np.recarray)[0]
    store_active(contacts, step, active)
    active.key[: active.count] = np.where(active.key[: active.count] >= 0, 10**15, active.key[: active.count])
    guess = np.full(3, -7, dtype=np.int64)
    for group in range(6):
        filled = guess_rows(contacts, active, group, guess, 0)
        assert filled <= 3
        assert (guess[:filled] >= contacts.start[-1]).all()


WIDTH = 2e-5
"""Of the differences [m, rad]: rounding of 1e-16 m / STEP² = 3e-7 1/m; bodies curve by at most 200 1/m."""
NEAR_AN_END = 5e-3
"""Where the nearest point is this near [-] to an end of a phalanx, a difference straddles two formulas."""


def smooth_records(hand: HandModel, tree: SphereTree, state: Any) -> list[int]:
    """Contacts whose distance is twice differentiable about the pose, not too deep in small spheres."""
    found = []
    for i in range(state.contacts.start[-1]):
        body, leaf = pair_of(state, tree, i)
        if state.contacts.distance[i] < -0.3 * tree.leaf_radius[leaf]:
            continue
        if body < PALM:
            f, k = divmod(body, 3)
            joint, length = state.pose.joints[f, k], hand.length[f, k]
            sine = (hand.radius[f, k] - hand.radius[f, k + 1]) / length
            along = (tree.leaf_center[leaf] - joint) @ state.pose.direction[f, k]
            across = np.sqrt(max(float(np.sum((tree.leaf_center[leaf] - joint) ** 2)) - along**2, 0.0))
            share = (along - across * sine / np.sqrt(1.0 - sine**2)) / length
            assert state.contacts.slides[i] == (0.0 < share < 1.0) or min(abs(share), abs(share - 1.0)) < 1e-9
            if min(abs(share), abs(share - 1.0)) < NEAR_AN_END:
                continue
        found.append(i)
    return found


def product(state: Any, rows: list[int], force: FloatArray, step: FloatArray) -> FloatArray:
    out = np.full(DOF, np.nan)
    index = np.array(rows, dtype=np.int64)
    curvature_product(state.pose, state.contacts, index, force, len(rows), step, out)
    return out


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_products_are_second_differences(seed: int) -> None:
    hand, tree, at, state = scene(seed)
    random = np.random.default_rng(seed)
    step = random.normal(size=DOF)
    step[:3] *= 0.05
    records = smooth_records(hand, tree, state)
    pairs = tuple(np.array([pair_of(state, tree, i) for i in records]).reshape(-1, 2).T)

    def distance(offset: FloatArray) -> FloatArray:
        found: FloatArray = brute_pairs(hand, tree.leaf_center, tree.leaf_radius, moved(at, offset))[pairs]
        return found

    bent = np.empty((len(records), DOF))
    for j, direction in enumerate(WIDTH * np.eye(DOF)):
        corners = [distance(a * direction + b * WIDTH * step) * a * b for a in (1, -1) for b in (1, -1)]
        bent[:, j] = np.sum(corners, axis=0) / (4.0 * WIDTH**2)
    for row, record in enumerate(records):
        found = product(state, [record], np.ones(1), step)
        np.testing.assert_allclose(found, bent[row], atol=1e-3 * np.abs(bent[row]).max() + 1e-4)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_the_product_is_linear_and_symmetric(seed: int) -> None:
    _, _, _, state = scene(seed)
    random = np.random.default_rng(seed)
    count = int(state.contacts.start[-1])
    rows = list(range(count))
    force = random.exponential(1.0, max(count, 1))
    a, b = random.normal(size=(2, DOF))
    of_a, of_b = product(state, rows, force, a), product(state, rows, force, b)
    np.testing.assert_allclose(product(state, rows, force, 2.0 * a - b), 2.0 * of_a - of_b, rtol=1e-9, atol=1e-7)
    assert a @ of_b == pytest.approx(b @ of_a, rel=1e-9, abs=1e-7)
    parts = sum((product(state, [i], force[i : i + 1], a) for i in rows), np.zeros(DOF))
    np.testing.assert_allclose(of_a, parts, rtol=1e-9, atol=1e-7)


def test_limits_do_not_bend() -> None:
    _, _, _, state = scene(3)
    behind = int(state.contacts.start[-1])
    assert not product(state, [behind, behind + 29], np.ones(2), np.ones(DOF)).any()
