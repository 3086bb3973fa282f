"""The median tree holds every point once, in blocks of the asked size, around balanced nodes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.kernels.kd_tree import build_median_tree, subtrees


@settings(max_examples=60)
@given(st.integers(1, 300), st.sampled_from([2, 4, 32]), st.integers(0, 2**31), st.integers(1, 5))
def test_nodes_partition_the_points(count: int, leaf_size: int, seed: int, values: int) -> None:
    # Few distinct coordinates: ties are the hard case of a selection.
    points = np.random.default_rng(seed).integers(0, values, size=(count, 3)).astype(float)
    tree = build_median_tree(points, leaf_size)
    assert sorted(tree.order) == list(range(count))
    assert (tree.start[0], tree.end[0]) == (0, count)
    seen = 0
    for node, right in enumerate(tree.right):
        if right < 0:
            assert 1 <= tree.end[node] - tree.start[node] <= leaf_size
            assert tree.start[node] == seen
            seen = int(tree.end[node])
            continue
        left = node + 1
        assert (tree.start[left], tree.end[right]) == (tree.start[node], tree.end[node])
        assert tree.end[left] == tree.start[right]
        one, other = (
            points[tree.order[tree.start[left] : tree.end[left]]],
            points[tree.order[tree.start[right] : tree.end[right]]],
        )
        assert abs(len(one) - len(other)) <= 1
        assert any(one[:, k].max() <= other[:, k].min() for k in range(3))
    assert seen == count


@pytest.mark.parametrize(("count", "depth"), [(1, 3), (9, 0), (200, 3), (1000, 20)])
def test_subtrees_hold_every_point_once(count: int, depth: int) -> None:
    tree = build_median_tree(np.random.default_rng(1).random((count, 3)), 4)
    nodes = subtrees(tree.right, depth)
    held = [place for node in nodes for place in range(tree.start[node], tree.end[node])]
    assert held == list(range(count))
    assert len(nodes) <= 2**depth
