"""Changes of a hand against scipy's rotations and filters, and accelerations in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.hand.configuration import HandConfiguration
from hhsim.repair.written_hand import NUMBERS, change_between, changed_hand, mean_acceleration


def hands(seed: int, frames: int = 5) -> HandConfiguration:
    random = np.random.default_rng(seed)
    turns = Rotation.random(frames, rng=random).as_quat(scalar_first=True)
    return HandConfiguration(
        random.normal(size=(frames, 3)), turns, random.normal(size=(frames, 5, 3)), random.normal(size=(frames, 5))
    )


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_a_change_leads_from_the_first_to_the_second_hand(seed: int) -> None:
    first, second = hands(seed), hands(seed + 1)
    change = change_between(first, second)
    turns = [Rotation.from_quat(h.orientation, scalar_first=True) for h in (first, second)]
    np.testing.assert_allclose(change[:, 3:6], (turns[1] * turns[0].inv()).as_rotvec(), atol=1e-9)
    led = changed_hand(first, change)
    for name in ("position", "flexion", "abduction"):
        np.testing.assert_allclose(getattr(led, name), getattr(second, name), atol=1e-12)
    reached = Rotation.from_quat(led.orientation, scalar_first=True)
    assert (reached * turns[1].inv()).magnitude().max() < 1e-9


def test_no_change_keeps_every_bit() -> None:
    hand = hands(3)
    assert not change_between(hand, hand.copy()).any()
    for before, after in zip(hand, changed_hand(hand, np.zeros((5, NUMBERS)))):
        np.testing.assert_array_equal(before, after)


def test_the_acceleration_of_a_fall_is_twice_its_square_term() -> None:
    t = np.arange(9.0)
    points = np.zeros((9, 2, 3))
    points[:, :, 2] = 0.5 * 3.0 * t[:, None] ** 2
    assert mean_acceleration(points) == pytest.approx(3.0)
    assert mean_acceleration(points[:2]) == 0.0
