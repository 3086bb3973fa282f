"""Pictures of the docs: each can be written, and shows what it is of."""

from pathlib import Path

import pytest
from matplotlib.image import imread

from tools.cost_figure import CostOptions, binned, draw_costs, measure


@pytest.mark.soak
def test_the_costs_are_drawn(tmp_path: Path) -> None:
    costs = measure(CostOptions("cube", (1,), ("touch",), margins=(1e-3, 4e-3), rounds=2), lambda report: None)
    bins = {method: binned(ticks, least=1) for method, ticks in costs.items()}
    assert all(sum(row.ticks for row in rows) == len(costs[method].pairs) for method, rows in bins.items())
    draw_costs(tmp_path / "cost.png", bins)
    picture = imread(tmp_path / "cost.png")[:, :, :3]
    assert picture.shape[1] == 1400
    assert 0.01 < (picture < 0.95).all(axis=2).mean() < 0.6
