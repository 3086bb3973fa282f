"""What is dropped follows from what is kept: held against random steps, within the bound that the proof asks for."""

from typing import Any

import numpy as np
from contact_scenes import RIGHT, ROOT, in_contact, row_matrix
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import PALM, brute_pairs, bumpy_ball

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.contact.detection import CONTACT_ROWS
from hhsim.kernels.contact.linearise import build_rows, drop_redundant_contacts
from hhsim.kernels.hand.kinematics import motion_bounds
from hhsim.motion.analytic_motion import still
from hhsim.trees.sphere_tree import SphereTree

REACH = 1e-3
OFFSET = 5e-7


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


def rows(state: Any) -> tuple[FloatArray, FloatArray, list[int]]:
    build_rows(RIGHT.arrays(), state.pose, state.contacts, OFFSET, False, state.problem)
    count = int(state.contacts.start[-1])
    return row_matrix(state), np.array(state.problem.rhs[:count]), [int(key) for key in state.contacts.key[:count]]


def bounded_step(random: np.random.Generator, pose: Any, bodies: set[int], reach: float) -> FloatArray:
    """A random step in which no point of these bodies moves farther than `reach`, and one about so far."""
    step = random.normal(size=21) / ROOT * 10.0 ** random.uniform(-1.0, 1.0, 21)
    motion = np.zeros(16)
    motion_bounds(RIGHT.arrays(), pose, step, np.zeros(5), 0.0, motion)
    return np.asarray(step * reach / motion[sorted(bodies)].max())


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([300, 1000, 3000]), st.sampled_from([REACH, 0.2 * REACH]))
def test_every_dropped_row_follows_from_the_kept_ones(seed: int, leaves: int, reach: float) -> None:
    tree, at = on_a_patch(seed, leaves)
    state = in_contact(RIGHT, tree.arrays(), at, reach)
    matrix, rhs, keys = rows(state)
    drop_redundant_contacts(RIGHT.arrays(), reach, state.contacts, np.zeros(CONTACT_ROWS))
    _, _, kept = rows(state)
    keeps = np.isin(keys, kept)
    assert set(kept) <= set(keys)
    bodies = {key // len(tree.radius) for key in keys}
    bodies = {min(body, PALM) for body in bodies}
    if not bodies:
        return
    random = np.random.default_rng(seed)
    for _ in range(200):
        step = bounded_step(random, state.pose, bodies, reach)
        change = matrix @ step
        # To the edge of what the kept rows allow, where a dropped one would show first.
        towards = change[keeps] < 0.0
        share = np.min(rhs[keeps][towards] / change[keeps][towards], initial=1.0)
        if share >= 0.0 and (share * change >= rhs)[keeps & (change > 0.0)].all():
            assert (share * change - rhs)[~keeps].min(initial=0.0) >= -1e-15
