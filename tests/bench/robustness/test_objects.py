"""The objects of the hard cases, of spheres and of triangles, and their crossings are what they are said to be."""

import numpy as np
import pytest

from hhsim.bench.robustness.objects import ball, disc
from hhsim.bench.robustness.postures import crossings, threaded


@pytest.mark.soak
def test_a_ball_and_a_disc_have_no_holes() -> None:
    tree = ball(1200, 0.038)
    reach = np.linalg.norm(tree.leaf_center, axis=1) + tree.leaf_radius
    np.testing.assert_allclose(reach, 0.038, atol=1e-12)
    random = np.random.default_rng(1)
    direction = random.normal(size=(500, 3))
    # On the sphere through the centres every point is in one of the spheres.
    points = (0.038 - tree.leaf_radius[0]) * direction / np.linalg.norm(direction, axis=1)[:, None]
    gap = np.linalg.norm(points[:, None] - tree.leaf_center, axis=2).min(axis=1) - tree.leaf_radius[0]
    assert gap.max() < 0.0
    leaf = disc(0.045, 0.8e-3, 1e-3)
    assert (leaf.leaf_radius == 0.5e-3).all()
    turn, radius = random.uniform(0.0, 2.0 * np.pi, 500), 0.044 * np.sqrt(random.uniform(0.0, 1.0, 500))
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(500)], axis=1)
    gap = np.linalg.norm(points[:, None] - leaf.leaf_center, axis=2).min(axis=1) - 0.5e-3
    assert gap.max() < 0.0


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
