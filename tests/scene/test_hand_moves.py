"""The ways of a hand in a script: smooth, and as far as they say."""

from dataclasses import replace

import numpy as np

from hhsim.hand.quaternion import rotation_matrix
from hhsim.scene.closure_search import level
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.script import ScriptPhase
from hhsim.scene.synthesis import carried, minimum_jerk, taken_along, to_and_fro

MIDDLE = np.array([0.1, -0.2, 0.3])


def test_minimum_jerk_is_the_polynomial_with_still_ends() -> None:
    tau = np.linspace(-0.2, 1.2, 141)
    inside = np.clip(tau, 0.0, 1.0)
    np.testing.assert_allclose(minimum_jerk(tau), 10 * inside**3 - 15 * inside**4 + 6 * inside**5, atol=1e-15)
    assert minimum_jerk(0.0) == 0.0 and minimum_jerk(1.0) == 1.0 and minimum_jerk(0.5) == 0.5
    h = 1e-4
    for end in (0.0, 1.0):
        assert abs(minimum_jerk(end + h) - minimum_jerk(end - h)) < 1e-11
        assert abs(minimum_jerk(end + h) - 2 * minimum_jerk(end) + minimum_jerk(end - h)) / h**2 < 0.01


def test_arcs_go_on_from_each_other_and_a_carry_without_turn_is_straight() -> None:
    arc = ScriptPhase("carry", 0.5, distance=0.2, turn=np.pi)
    script = replace(load_script("pinch"), phases=(ScriptPhase("approach", 0.2), arc, arc, replace(arc, turn=0.0)))
    time = np.arange(script.sample_count + 1) / script.rate
    moved = carried(script, time, np.array([1.0, 2.0, 3.0]))
    assert moved is not None
    place = moved.points(np.tile([1.0, 2.0, 3.0], (len(time), 1)))
    back = np.searchsorted(time, 1.2)
    # Two halves of a circle end where they began, and then it goes straight on.
    np.testing.assert_allclose(place[back], place[0], atol=1e-12)
    np.testing.assert_allclose(place[-1] - place[back], [0.2, 0.0, 0.0], atol=1e-12)


def test_a_shake_begins_and_ends_at_rest_and_goes_nearly_as_far_as_it_says() -> None:
    share = np.linspace(-0.1, 1.1, 100_001)
    swing = to_and_fro(share, 4.0)
    assert np.abs(swing[(share < 0.0) | (share > 1.0)]).max() < 1e-30
    assert 0.95 < np.abs(swing).max() <= 1.0
    assert np.count_nonzero(np.diff(np.sign(swing[(share > 0.01) & (share < 0.99)]))) == 7
    acceleration = np.diff(swing, n=2) / np.diff(share)[0] ** 2
    assert np.abs(np.diff(acceleration)).max() < 0.005 * np.abs(acceleration).max()


def test_lifts_go_up_shakes_across_and_turns_about_the_fingers_through_the_middle() -> None:
    script = load_script("pinch")
    phases = (ScriptPhase("lift", 0.5, distance=0.1), ScriptPhase("turn", 0.5, turn=0.8))
    script = replace(script, phases=(*phases, ScriptPhase("shake", 1.0, distance=0.02, cycles=2.0)))
    time = np.arange(2001) / 1000.0
    # The palm looks down, its fingers along y and a little up.
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.3), -np.sin(0.3)], [0.0, np.sin(0.3), np.cos(0.3)]])
    moved = taken_along(script, time, tilt, MIDDLE)
    assert moved is not None
    middle = moved.points(np.tile(MIDDLE, (len(time), 1))) - MIDDLE
    np.testing.assert_allclose(middle[500], [0.0, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(middle[500:1001], np.tile(middle[500], (501, 1)), atol=1e-12)
    assert np.abs(middle[1000:, 0]).max() > 0.017 and np.abs(middle[:, 1]).max() == 0.0
    np.testing.assert_allclose(middle[-1], [0.0, 0.0, 0.1], atol=1e-12)
    turn = rotation_matrix(moved.turn[-1])
    np.testing.assert_allclose(turn @ [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turn[0, 0], np.cos(0.8), atol=1e-12)
    assert taken_along(load_script("grasp"), time, tilt, MIDDLE) is None


def test_what_stands_upright_is_no_direction_on_a_table() -> None:
    np.testing.assert_allclose(level(np.array([3.0, 4.0, 5.0]), np.zeros(3)), [0.6, 0.8, 0.0])
    np.testing.assert_allclose(level(np.array([0.0, 0.1, 1.0]), np.array([0.0, 2.0, 0.0])), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(level(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])), [1.0, 0.0, 0.0])
