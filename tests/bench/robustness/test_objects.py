"""Crossings of discs and rings are what they are said to be."""

import numpy as np

from hhsim.bench.robustness.objects import crossings, threaded


def test_crossings_are_counted_through_the_disc_and_not_around_it() -> None:
    def way(*points: tuple[float, float, float]) -> int:
        return crossings(np.array(points)[:, None], 0.05)

    assert way((0.0, 0.0, 0.1), (0.0, 0.0, -0.1)) == 1
    assert way((0.0, 0.0, 0.1), (0.0, 0.0, -0.1), (0.01, 0.0, 0.1)) == 2
    assert way((0.0, 0.0, 0.1), (0.1, 0.0, 0.1), (0.1, 0.0, -0.1), (0.0, 0.0, -0.1)) == 0
    # Where it crosses counts, not where it was before: at x = 0.04, and at x = 0.06.
    assert way((0.0, 0.0, 0.1), (0.08, 0.0, -0.1)) == 1
    assert way((0.0, 0.0, 0.1), (0.12, 0.0, -0.1)) == 0
    assert way((0.0, 0.0, 0.1), (0.01, 0.0, 0.05), (0.02, 0.0, 0.001)) == 0


def test_a_finger_is_in_a_ring_or_it_is_not() -> None:
    line = np.array([[0.0, -0.05, 0.0], [0.0, -0.01, 0.0], [0.0, 0.01, 0.0], [0.0, 0.05, 0.0]])
    center, axis = np.zeros(3), np.array([0.0, 1.0, 0.0])
    shifts = [(0.0, 0.0, 0.0), (0.009, 0.0, 0.0), (0.011, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, -0.2, 0.0)]
    joints = np.array([line + shift for shift in shifts])
    np.testing.assert_array_equal(threaded(joints, center, axis, 0.01), [True, True, False, False, False])
    # In and out again is not in.
    bent = np.array([[[0.0, -0.05, 0.0], [0.0, 0.01, 0.0], [0.001, 0.02, 0.0], [0.002, -0.05, 0.0]]])
    assert not threaded(bent, center, axis, 0.01)[0]
