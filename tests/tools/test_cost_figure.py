"""The cost figure: ticks fall into the right bins, replays agree with each other, the picture is made."""

from pathlib import Path

import numpy as np
import pytest

from tools.cost_figure import BIN_EDGES, CostOptions, TickCosts, binned, draw_costs, main, measure, table


def test_bins_hold_their_lower_edge_and_not_their_upper_one() -> None:
    pairs = np.array([1, 2, 3, 3, 4, 5, 9, 10])
    costs = TickCosts(pairs, 1e-6 * pairs)
    low, high = binned(costs, [1, 3, 10], least=1)
    assert (low.first, low.last, low.ticks) == (1, 2, 2)
    assert (high.first, high.last, high.ticks) == (3, 9, 5)
    assert low.pairs == 1.5
    assert high.pairs == pytest.approx(24 / 5)
    assert high.median == pytest.approx(4e-6)


def test_statistics_of_a_bin_are_percentiles() -> None:
    cost = 1e-6 * np.random.default_rng(0).permutation(np.arange(101.0))
    (only,) = binned(TickCosts(np.full(101, 7), cost))
    assert (only.p10, only.median, only.p90, only.p99) == pytest.approx((10e-6, 50e-6, 90e-6, 99e-6))


def test_bins_of_few_ticks_are_left_out() -> None:
    costs = TickCosts(np.repeat([5, 15], [49, 50]), np.ones(99))
    assert [row.first for row in binned(costs, [1, 10, 20])] == [10]
    assert binned(TickCosts(np.zeros(0, np.int64), np.zeros(0)), least=0) == []


def test_edges_grow() -> None:
    assert (np.diff(BIN_EDGES) > 0).all()


def test_the_table_shows_microseconds() -> None:
    rows = binned(TickCosts(np.full(1000, 250), np.full(1000, 40e-6)))
    line = table({"coupled": rows}).splitlines()[1].split()
    assert line == ["coupled", "160", "to", "319", "1,000", "40.0", "40.0", "40.0", "40.0"]


def test_a_small_scene_is_measured_and_drawn(tmp_path: Path) -> None:
    import matplotlib.image

    options = CostOptions("cube", (1,), ("touch",), margins=(1e-3, 4e-3), rounds=2)
    reports: list[str] = []
    costs = measure(options, reports.append)
    assert reports == ["round 1 of 2: 4 replays", "round 2 of 2: 4 replays"]
    assert sorted(costs) == ["coupled", "progressive"]
    for ticks in costs.values():
        assert ticks.pairs.shape == ticks.cost.shape
        assert ticks.pairs.min() >= 1
        assert (ticks.cost > 0.0).all()
    bins = {method: binned(ticks, least=1) for method, ticks in costs.items()}
    assert all(sum(row.ticks for row in rows) == len(costs[method].pairs) for method, rows in bins.items())
    draw_costs(tmp_path / "cost.png", bins)
    assert matplotlib.image.imread(tmp_path / "cost.png").shape[:2] == (600, 1400)


def test_bad_arguments_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="usage"):
        main([])
    with pytest.raises(SystemExit, match="there is no folder"):
        main([str(tmp_path / "nowhere" / "cost.png")])
