"""Tree queries against all leaves one by one, on random trees whose nodes enclose what is below them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.round_cone_distance import RoundCone, cone_slope, sphere_round_cone_distance
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_round_cone, nearest_leaf_round_cone

ROUNDING = 1e-12
"""Distances closer than this to the margin [m] may fall on either side of it."""


def random_tree(random: np.random.Generator, leaves: int, branching: int) -> TreeArrays:
    """Group the leaves along a random direction, level by level, until one node is left."""
    centers = [random.uniform(-1.0, 1.0, (leaves, 3))]
    centers[0] = centers[0][np.argsort(centers[0] @ random.normal(size=3))]
    radii = [random.uniform(0.0, 0.2, leaves)]
    groups: list[list[int]] = []
    while len(radii[0]) > 1:
        count = len(radii[0])
        starts = list(range(0, count, branching))
        ends = [*starts[1:], count]
        groups.insert(0, [end - start for start, end in zip(starts, ends)])
        center = np.array([centers[0][i:j].mean(axis=0) for i, j in zip(starts, ends)])
        reach = [
            (np.linalg.norm(centers[0][i:j] - c, axis=1) + radii[0][i:j]).max() for i, j, c in zip(starts, ends, center)
        ]
        centers.insert(0, center)
        radii.insert(0, np.array(reach) * (1.0 + 1e-12))
    child_count = np.array([n for level in groups for n in level] + [0] * leaves, dtype=np.int64)
    first_child = 1 + np.cumsum(child_count) - child_count
    first_child[child_count == 0] = -1
    center = np.concatenate(centers)
    x, y, z = (np.ascontiguousarray(center[:, i]) for i in range(3))
    return TreeArrays(x, y, z, np.concatenate(radii), first_child, child_count, len(center) - leaves)


class Cone:
    """A round cone and what the kernels want to know of it."""

    def __init__(self, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float) -> None:
        self.a, self.b, self.radius_a, self.radius_b = a, b, radius_a, radius_b
        self.length = float(np.linalg.norm(b - a))
        tangent, inverse = cone_slope(self.length, radius_a, radius_b)
        direction = (b - a) * inverse
        self.record = RoundCone._make(
            map(float, (*a, *direction, self.length, tangent, inverse, radius_a, radius_a - radius_b))
        )

    def distances(self, tree: TreeArrays) -> FloatArray:
        """Signed distance [m] to every leaf, in the order of the leaves."""
        ends = self.a, self.b, self.radius_a, self.radius_b
        return np.array(
            [
                sphere_round_cone_distance(np.array([tree.x[i], tree.y[i], tree.z[i]]), tree.radius[i], *ends)[0]
                for i in range(tree.leaf_start, len(tree.radius))
            ]
        )


def random_cone(random: np.random.Generator) -> Cone:
    a = random.uniform(-1.5, 1.5, 3)
    b = a.copy() if random.random() < 0.3 else a + random.uniform(-0.6, 0.6, 3)
    radius_a = random.uniform(0.0, 0.3)
    return Cone(a, b, radius_a, radius_a if random.random() < 0.2 else radius_a * random.uniform(0.0, 1.0))


def gather(tree: TreeArrays, cone: Cone, margin: float, room: int) -> tuple[int, float, int, IntArray]:
    index = np.full(room + 8, -7, dtype=np.int64)
    stack = np.empty(STACK_SIZE, dtype=np.int64)
    count, clearance, tests = gather_round_cone(tree, cone.record, margin, stack, index[:room])
    assert (index[room:] == -7).all()
    return int(count), float(clearance), int(tests), index[:room]


def nearest(tree: TreeArrays, cone: Cone, limit: float) -> tuple[float, int]:
    distance, leaf = nearest_leaf_round_cone(tree, cone.record, limit, np.empty(STACK_SIZE, dtype=np.int64))
    return float(distance), int(leaf)


trees = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 90), st.sampled_from([*range(2, 10), 80]))
margins = st.one_of(st.sampled_from([0.0, 1e3, -10.0]), st.floats(-0.3, 1.0))


@given(trees, margins)
@settings(max_examples=200)
def test_gather_finds_exactly_the_leaves_within_the_margin(shape: tuple[int, int, int], margin: float) -> None:
    seed, leaves, branching = shape
    random = np.random.default_rng(seed)
    tree, cone = random_tree(random, leaves, branching), random_cone(random)
    distance = cone.distances(tree)
    count, clearance, tests, index = gather(tree, cone, margin, leaves)
    found = index[:count] - tree.leaf_start
    assert len(set(found.tolist())) == count
    surely = set(np.flatnonzero(distance <= margin - ROUNDING).tolist())
    perhaps = set(np.flatnonzero(distance <= margin + ROUNDING).tolist())
    assert surely <= set(found.tolist()) <= perhaps
    assert clearance > margin
    left_out = np.setdiff1d(np.arange(leaves), found)
    if len(left_out):
        assert clearance <= distance[left_out].min() + ROUNDING
    else:
        assert clearance == math.inf
    assert 1 <= tests <= len(tree.radius)


@given(trees, st.one_of(st.just(math.inf), st.floats(-0.3, 1.0)))
@settings(max_examples=200)
def test_nearest_leaf_is_the_nearest_of_all(shape: tuple[int, int, int], limit: float) -> None:
    seed, leaves, branching = shape
    random = np.random.default_rng(seed)
    tree, cone = random_tree(random, leaves, branching), random_cone(random)
    distance = cone.distances(tree)
    best, leaf = nearest(tree, cone, limit)
    if distance.min() < limit - ROUNDING:
        assert best == pytest.approx(distance.min(), abs=ROUNDING)
        assert distance[leaf - tree.leaf_start] == pytest.approx(distance.min(), abs=ROUNDING)
    elif distance.min() > limit + ROUNDING:
        assert (best, leaf) == (limit, -1)


def test_gather_and_nearest_agree() -> None:
    random = np.random.default_rng(5)
    tree, cone = random_tree(random, 64, 4), random_cone(random)
    best, leaf = nearest(tree, cone, math.inf)
    count, _, _, index = gather(tree, cone, best + ROUNDING, 64)
    assert leaf in index[:count]
    assert gather(tree, cone, best - ROUNDING, 64)[0] == 0


@pytest.mark.parametrize("short", [1, 5])
def test_too_little_room_is_reported(short: int) -> None:
    random = np.random.default_rng(11)
    tree, cone = random_tree(random, 40, 8), random_cone(random)
    assert gather(tree, cone, 1e3, 40)[0] == 40
    count, clearance, _, _ = gather(tree, cone, 1e3, 40 - short)
    assert count == -1
    assert clearance == 0.0


def test_no_room_is_enough_for_nothing() -> None:
    random = np.random.default_rng(12)
    tree = random_tree(random, 40, 8)
    cone = Cone(np.array([9.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0]), 0.1, 0.1)
    count, clearance, tests, _ = gather(tree, cone, 0.0, 0)
    assert (count, tests) == (0, 1)
    assert 0.0 < clearance <= cone.distances(tree).min() + ROUNDING


def test_huge_margin_leaves_nothing_out() -> None:
    random = np.random.default_rng(13)
    tree, cone = random_tree(random, 50, 3), random_cone(random)
    count, clearance, tests, index = gather(tree, cone, 1e6, 50)
    assert (count, clearance, tests) == (50, math.inf, len(tree.radius))
    np.testing.assert_array_equal(np.sort(index), np.arange(tree.leaf_start, len(tree.radius)))


def test_margin_zero_takes_a_leaf_that_just_touches() -> None:
    one = np.array([0.0])
    tree = TreeArrays(
        one, one.copy(), one.copy(), np.array([0.5]), np.array([-1], dtype=np.int64), np.array([0], dtype=np.int64), 0
    )
    center = np.array([0.75, 0.0, 0.0])
    touching, apart = Cone(center, center, 0.25, 0.25), Cone(center, center, 0.125, 0.125)
    assert gather(tree, touching, 0.0, 1)[:2] == (1, math.inf)
    assert gather(tree, apart, 0.0, 1)[:2] == (0, 0.125)
    assert nearest(tree, touching, 1.0) == (0.0, 0)
    assert nearest(tree, apart, 0.125) == (0.125, -1)


def test_a_sphere_is_a_cone_without_length() -> None:
    random = np.random.default_rng(17)
    tree = random_tree(random, 60, 8)
    center, radius = np.array([0.2, -0.1, 0.3]), 0.15
    expected = (
        np.linalg.norm(np.stack([tree.x, tree.y, tree.z], axis=1) - center, axis=1)[tree.leaf_start :]
        - tree.radius[tree.leaf_start :]
        - radius
    )
    for tip in (radius, 0.5 * radius, 0.0):
        best, leaf = nearest(tree, Cone(center, center.copy(), radius, tip), math.inf)
        assert best == pytest.approx(expected.min(), abs=ROUNDING)
        assert leaf - tree.leaf_start == int(expected.argmin())
