"""Distances by brute force, against a dense sampling of the axis and the trees'."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import brute_clearance, bumpy_ball, cloud

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.metrics.metrics import hand_clearance

HAND = HandModel.default()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_a_round_cone_is_the_union_of_the_spheres_on_its_axis(seed: int) -> None:
    random = np.random.default_rng(seed)
    a, b = random.normal(0.0, 0.02, (2, 3))
    length = float(np.linalg.norm(b - a))
    radius_a = random.uniform(0.005, 0.02)
    radius_b = radius_a - random.uniform(0.0, 0.95) * min(length, radius_a)
    points = random.normal(0.0, 0.04, (30, 3))
    s = np.linspace(0.0, 1.0, 20_001)
    axis, radius = a + s[:, None] * (b - a), radius_a + s * (radius_b - radius_a)
    sampled = np.array([(np.linalg.norm(axis - point, axis=1) - radius).min() for point in points])
    exact = round_cone_distance(points, a, b, radius_a, radius_b)
    outside = sampled > 0.0
    assert (exact[outside] <= sampled[outside] + 1e-15).all()
    np.testing.assert_allclose(exact[outside], sampled[outside], atol=2.0 * length / 20_000)
    assert (exact[~outside] <= 1e-15).all()


@pytest.mark.parametrize("seed", range(4))
def test_two_ways_to_the_same_clearance(seed: int) -> None:
    tree = cloud(np.random.default_rng(seed), 200) if seed % 2 else bumpy_ball(1200)
    palm = HAND.palm_tree
    for sample in zip(*RandomTargets(HAND, seed, StressOptions(hold=1, jumps=True)).take(12)):
        shown = HAND.joints(*sample)[None], sample[0][None], sample[1][None]
        sizes = HAND.radius, palm.leaf_center, palm.leaf_radius
        brute = brute_clearance(tree.leaf_center, tree.leaf_radius, *sizes, *shown).min()
        by_tree = hand_clearance(tree.arrays(), HandShape(*sizes), PlacedHand(*shown), 1.0)
        assert brute == pytest.approx(min(by_tree[0][0], by_tree[1].min()), abs=1e-15)
