"""The contacts that a step loads are remembered by what they are, and found again in the next records."""

from typing import Any

import numpy as np
from contact_scenes import scene
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.kernels.contact.linearise import LIMIT_ROWS
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, ACTIVE_CONTACTS, STEP, guess_rows, store_active


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
