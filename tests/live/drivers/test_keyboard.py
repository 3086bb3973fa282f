"""Keys that carry the palm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.live.drivers.poses import DEGREES_PER_METRE, MOVES, REACH, SPEED, STEPS, STOP, TURNING, TURNS, PalmKeys

HOME = np.array([0.1, -0.2, 0.3])
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def settled(keys: str) -> PalmKeys:
    palm = PalmKeys(HOME, UPRIGHT)
    assert not palm.press(keys)
    palm.advance(1e9)
    return palm


@pytest.mark.parametrize(("key", "axis"), MOVES.items())
def test_a_stroke_moves_the_palm_one_step_along_an_axis(key: str, axis: tuple[float, float, float]) -> None:
    palm = settled(key.upper())
    np.testing.assert_allclose(palm.position, HOME + STEPS[2] * np.array(axis), atol=1e-15)
    np.testing.assert_array_equal(palm.orientation, UPRIGHT)


@pytest.mark.parametrize(("key", "axis"), TURNS.items())
def test_a_stroke_turns_the_palm_about_its_own_axis(key: str, axis: tuple[float, float, float]) -> None:
    half = 0.5 * math.radians(DEGREES_PER_METRE * STEPS[2])
    palm = settled(key)
    expected = np.array([math.cos(half), *(math.sin(half) * np.array(axis))])
    np.testing.assert_allclose(palm.orientation, expected, atol=1e-12)
    # Behind a quarter turn about z, the palm's x is the world's y.
    turned = PalmKeys(HOME, [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    turned.press("i")
    turned.advance(1e9)
    product = math.sqrt(0.5) * np.array([math.cos(half), math.sin(half), math.sin(half), math.cos(half)])
    np.testing.assert_allclose(turned.orientation, product, atol=1e-12)


@pytest.mark.parametrize("key", STOP)
def test_a_stop_key_ends_and_what_follows_is_not_taken(key: str) -> None:
    palm = PalmKeys(HOME, UPRIGHT)
    assert palm.press(f"w{key}dd")
    palm.advance(1e9)
    np.testing.assert_allclose(palm.position, HOME + [0.0, STEPS[2], 0.0])


@given(st.text("adswfrkiuoljh+-xyz?", max_size=300), st.floats(1e-4, 0.1))
def test_the_palm_never_moves_faster_than_a_hand_nor_out_of_reach(keys: str, seconds: float) -> None:
    palm = PalmKeys(HOME, UPRIGHT)
    palm.press(keys)
    for _ in range(20):
        position, orientation = palm.position.copy(), palm.orientation.copy()
        palm.advance(seconds)
        assert np.linalg.norm(palm.position - position) <= SPEED * seconds * (1.0 + 1e-9)
        angle = 2.0 * math.acos(min(1.0, abs(float(palm.orientation @ orientation))))
        assert angle <= TURNING * seconds * (1.0 + 1e-6) + 1e-7
        assert abs(np.linalg.norm(palm.orientation) - 1.0) < 1e-9
        assert (np.abs(palm.position - HOME) <= REACH + 1e-12).all()
    palm.advance(1e9)
    assert not palm.advance(1.0)
