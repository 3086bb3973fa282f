"""Reductions of medial balls against brute force on small tables of costs."""

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.kernels.cover.medial_reduction import (
    assign_pieces,
    assign_to_siblings,
    burst,
    expand,
    fill,
    merge,
    piece_costs,
    polish,
    reduce_balls,
    select,
    total_badness,
)

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

BALLS, PIECES = 9, 14


def table(seed: int) -> tuple[Array, Array]:
    # Whole weights add up exactly in any order.
    rng = np.random.default_rng(seed)
    ball, piece = rng.random((BALLS, 3)), rng.random((PIECES, 3))
    return np.linalg.norm(ball[:, None] - piece[None], axis=2) - 0.1, rng.integers(1, 9, PIECES).astype(np.float64)


def largest(cost: Array, chosen: Indices) -> float:
    return float(cost[chosen].min(axis=0).max())


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_select_is_the_greedy_cover(seed: int, standoff: float) -> None:
    cost, weight = table(seed)
    chosen = np.empty(4, np.int64)
    count = select(cost, weight, standoff, 4, chosen)
    waiting = np.ones(PIECES, bool)
    expected: list[int] = []
    while waiting.any() and len(expected) < 4:
        gain = ((cost <= standoff) & waiting) @ weight
        expected.append(int(gain.argmax()))
        waiting &= cost[expected[-1]] > standoff
    if waiting.any():
        assert count == 5
    else:
        assert chosen[:count].tolist() == expected
        assert largest(cost, chosen[:count]) <= standoff


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_each_reduction_keeps_its_number_and_covers(seed: int, most: int) -> None:
    cost, weight = table(seed)
    best = min(largest(cost, np.array(some)) for some in combinations(range(BALLS), most))
    alone = min(largest(cost, np.array([ball])) for ball in range(BALLS))
    chosen, owner = np.empty(most, np.int64), np.empty(PIECES, np.int64)
    start = np.arange(BALLS)
    ways: list[tuple[Callable[..., int], tuple[Any, ...]]] = [
        (expand, (cost, weight, most, chosen)),
        (merge, (cost, start, most, chosen)),
        (burst, (cost, start, most, chosen)),
        (reduce_balls, (cost, weight, False, BALLS, most, chosen, owner)),
    ]
    reached = []
    for way, arguments in ways:
        count = way(*arguments)
        assert 1 <= count <= most
        assert set(chosen[:count].tolist()) <= set(range(BALLS))
        reached.append(largest(cost, chosen[:count]))
    assert min(reached) >= best
    assert reached[-1] <= min(alone, reached[0])
    assert reached[-1] == assign_pieces(cost, chosen[:count], owner)


def test_one_merge_and_one_burst_are_the_best_ones() -> None:
    for seed in range(20):
        cost, _ = table(seed)
        start = np.arange(4)
        owner = np.empty(PIECES, np.int64)
        assign_pieces(cost, start, owner)
        groups = [np.flatnonzero(owner == k) for k in range(4)]
        if min(len(group) for group in groups) == 0:
            continue
        # Merging: the pair whose common ball costs least, and for each group left its own best ball.
        price = {
            pair: cost[:, np.concatenate([groups[k] for k in pair])].max(axis=1).min()
            for pair in combinations(range(4), 2)
        }
        chosen = np.empty(3, np.int64)
        assert merge(cost, start, 3, chosen) == 3
        pair = min(price, key=lambda each: price[each])
        merged = [group for k, group in enumerate(groups) if k not in pair]
        merged.append(np.concatenate([groups[k] for k in pair]))
        assert set(chosen.tolist()) == {int(cost[:, group].max(axis=1).argmin()) for group in merged}
        # Bursting: the ball without which the others do best for its pieces.
        assert burst(cost, start, 3, chosen) == 3
        without = [cost[np.delete(start, k)][:, groups[k]].min(axis=0).max() for k in range(4)]
        assert chosen.tolist() == np.delete(start, int(np.argmin(without))).tolist()


@pytest.mark.parametrize("by_sum", [False, True])
def test_polishing_never_gets_worse_and_ends_at_rest(by_sum: bool) -> None:
    for seed in range(20):
        cost, weight = table(seed)
        chosen, owner = np.array([0, 1, 2]), np.empty(PIECES, np.int64)
        assign_pieces(cost, chosen, owner)
        before = total_badness(cost, weight, chosen, owner, by_sum)
        after = polish(cost, weight, by_sum, chosen, owner)
        least = cost[chosen].min(axis=0)
        assert after == pytest.approx((weight * np.maximum(least, 0.0) ** 2).sum() if by_sum else least.max())
        assert after <= before
        assert (cost[chosen[owner], np.arange(PIECES)] == least).all()


def test_balls_without_pieces_are_put_to_use() -> None:
    cost = np.array([[0.0, 9.0, 9.0], [9.0, 0.0, 9.0], [9.0, 9.0, 0.0], [8.0, 8.0, 8.0]])
    chosen, owner = np.array([3, 3, 0]), np.empty(3, np.int64)
    # Ball 3 twice: the second has no piece. Then each other ball takes 8 m off one piece; the first found comes first.
    assert fill(cost, np.ones(3), chosen, 2, owner) == 3
    assert sorted(chosen.tolist()) == [0, 1, 3]
    assert cost[chosen[owner], np.arange(3)].tolist() == [0.0, 0.0, 8.0]


def test_costs_are_far_corners_less_depths() -> None:
    rng = np.random.default_rng(3)
    corner, center, depth = rng.random((6, 9)), rng.random((4, 3)), rng.random(4)
    members = np.array([5, 0, 3])
    cost = np.empty((4, 3))
    piece_costs(corner, members, center, depth, cost)
    far = np.linalg.norm(corner[members].reshape(1, 3, 3, 3) - center[:, None, None], axis=3).max(axis=2)
    assert cost == pytest.approx(far - depth[:, None])

    region, first_ball = np.array([0, 0, 1, 1, 1, 0]), np.array([0, 1, 4])
    owner, own = np.empty(6, np.int64), np.empty(6)
    assign_to_siblings(corner, region, first_ball, center, depth, owner, own)
    whole = np.linalg.norm(corner.reshape(6, 1, 3, 3) - center[None, :, None], axis=3).max(axis=2) - depth
    for piece in range(6):
        allowed = np.arange(first_ball[region[piece]], first_ball[region[piece] + 1])
        assert owner[piece] == allowed[whole[piece, allowed].argmin()]
        assert own[piece] == pytest.approx(whole[piece, owner[piece]])
