"""Tree queries against all leaves one by one, on random trees whose nodes enclose what is below them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import Cones
from sphere_scenes import sphere_tree

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.round_cone_distance import Spheres, round_cone_distances
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_round_cone, nearest_leaf_round_cone

ROUNDING = 1e-12
"""Distances closer than this to the margin [m] may fall on either side of it."""


def random_tree(random: np.random.Generator, leaves: int, branching: int) -> TreeArrays:
    return sphere_tree(random.uniform(-1.0, 1.0, (leaves, 3)), random.uniform(0.0, 0.2, leaves), branching).arrays()


def random_cone(random: np.random.Generator) -> Cones:
    a = random.uniform(-1.5, 1.5, 3)
    b = a.copy() if random.random() < 0.3 else a + random.uniform(-0.6, 0.6, 3)
    radius = random.uniform(0.0, 0.3)
    return Cones(a[None], b[None], np.array([radius]), radius * random.choice([1.0, random.random()], 1))


def ball(center: FloatArray, radius: float) -> Cones:
    return Cones(center[None], center[None], np.array([radius]), np.array([radius]))


def distances(tree: TreeArrays, cone: Cones) -> FloatArray:
    """Signed distance [m] to every leaf."""
    leaves = Spheres(*(values[tree.leaf_start :] for values in (tree.x, tree.y, tree.z, tree.radius)))
    distance, parameter = np.empty((2, len(leaves.x)))
    round_cone_distances(leaves, len(distance), cone.kernel(0), distance, parameter)
    return distance


def gather(tree: TreeArrays, cone: Cones, margin: float, room: int) -> tuple[int, float, int, IntArray]:
    index, stack = np.full(room + 8, -7, dtype=np.int64), np.empty(STACK_SIZE, dtype=np.int64)
    count, clearance, tests = gather_round_cone(tree, cone.kernel(0), margin, stack, index[:room])
    assert (index[room:] == -7).all()
    return int(count), float(clearance), int(tests), index[:room]


def nearest(tree: TreeArrays, cone: Cones, limit: float) -> tuple[float, int]:
    distance, leaf = nearest_leaf_round_cone(tree, cone.kernel(0), limit, np.empty(STACK_SIZE, dtype=np.int64))
    return float(distance), int(leaf)


trees = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 90), st.sampled_from([*range(2, 10), 80]))
margins = st.one_of(st.sampled_from([0.0, 1e3, -10.0]), st.floats(-0.3, 1.0))


@given(trees, margins)
@settings(max_examples=200)
def test_gather_finds_exactly_the_leaves_within_the_margin(shape: tuple[int, int, int], margin: float) -> None:
    seed, leaves, branching = shape
    random = np.random.default_rng(seed)
    tree, cone = random_tree(random, leaves, branching), random_cone(random)
    distance = distances(tree, cone)
    count, clearance, tests, index = gather(tree, cone, margin, leaves)
    found = index[:count] - tree.leaf_start
    assert len(set(found.tolist())) == count
    surely = set(np.flatnonzero(distance <= margin - ROUNDING).tolist())
    perhaps = set(np.flatnonzero(distance <= margin + ROUNDING).tolist())
    assert surely <= set(found.tolist()) <= perhaps
    assert clearance > margin
    left_out = np.setdiff1d(np.arange(leaves), found)
    assert clearance <= distance[left_out].min() + ROUNDING if len(left_out) else clearance == math.inf
    assert 1 <= tests <= len(tree.radius)
    assert margin < 1e3 or tests == len(tree.radius)


@given(trees, st.one_of(st.just(math.inf), st.floats(-0.3, 1.0)))
@settings(max_examples=200)
def test_nearest_leaf_is_the_nearest_of_all(shape: tuple[int, int, int], limit: float) -> None:
    seed, leaves, branching = shape
    random = np.random.default_rng(seed)
    tree, cone = random_tree(random, leaves, branching), random_cone(random)
    distance = distances(tree, cone)
    best, leaf = nearest(tree, cone, limit)
    if distance.min() < limit - ROUNDING:
        assert best == pytest.approx(distance.min(), abs=ROUNDING)
        assert distance[leaf - tree.leaf_start] == pytest.approx(distance.min(), abs=ROUNDING)
    elif distance.min() > limit + ROUNDING:
        assert (best, leaf) == (limit, -1)


@pytest.mark.parametrize("short", [1, 5])
def test_too_little_room_is_reported(short: int) -> None:
    random = np.random.default_rng(11)
    tree, cone = random_tree(random, 40, 8), random_cone(random)
    assert gather(tree, cone, 1e3, 40)[0] == 40
    assert gather(tree, cone, 1e3, 40 - short)[:2] == (-1, 0.0)


def test_margin_zero_takes_a_leaf_that_just_touches() -> None:
    one, none = np.array([0.0]), np.array([0], dtype=np.int64)
    tree = TreeArrays(one, one.copy(), one.copy(), np.array([0.5]), none - 1, none, 0)
    touching, apart = (ball(np.array([0.75, 0.0, 0.0]), radius) for radius in (0.25, 0.125))
    assert gather(tree, touching, 0.0, 1)[:2] == (1, math.inf)
    assert gather(tree, apart, 0.0, 1)[:2] == (0, 0.125)
    assert nearest(tree, touching, 1.0) == (0.0, 0)
    assert nearest(tree, apart, 0.125) == (0.125, -1)
