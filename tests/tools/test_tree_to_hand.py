"""From tree to hand: replays judged against the true mesh by coal, and what the judgement is made of."""

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import brute_pairs

from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.analytic_motion import still
from tools.tree_to_hand import end_to_end, sphere_distances


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "level", "most"), sampled([("cube", 3, 1.2e-3), ("bunny", 4, 0.2e-3)], lambda place, case: place == 0)
)
def test_the_mesh_is_kept_out_of_and_the_hover_is_within_the_bound(name: str, level: int, most: float) -> None:
    row = end_to_end(load_object(name).mesh, level, "whole-hand", every=80)
    assert row.passed
    assert row.mesh_penetration <= 1e-6
    assert row.sphere_penetration <= 1e-6
    assert 0.0 < row.hover_hold <= row.hover <= row.bound
    assert row.contact_error_mean <= row.contact_error_max <= most
    assert row.touching >= row.ticks >= 5


def test_distances_to_spheres_are_those_of_brute_force() -> None:
    hand, rng = HandModel.default(), np.random.default_rng(4)
    center, radius = rng.normal(scale=0.1, size=(40, 3)), rng.uniform(0.005, 0.02, 40)
    motion = still(np.array([0.01, 0.02, 0.03]), flexion=rng.uniform(0.0, 1.0, (5, 3)))
    pairs = brute_pairs(hand, center, radius, motion)
    found = sphere_distances(center, radius, hand_shape(hand), forward_kinematics(hand, *motion))[0]
    np.testing.assert_allclose(found[:15], pairs[:15].min(axis=1), atol=1e-12)
    assert found[15] == pytest.approx(pairs[15:].min(), abs=1e-12)
