"""What a viewer costs: the arithmetic, held against pairs whose answer is known."""

import math

import pytest

from tools.viewer_cost import Command, viewer_cost


def commands(*walls: float, cpu: float = 1.0, tick: float = 1e-5, ticks: int = 10_000) -> list[Command]:
    return [Command(wall, cpu, tick, ticks) for wall in walls]


def test_the_ratios_are_those_of_the_medians() -> None:
    without = commands(2.0, 2.2, 9.0, 2.1, 1.9, cpu=2.0)
    with_ = commands(2.2, 2.31, 2.3, 2.4, 2.28, cpu=2.5, tick=1.1e-5)
    cost = viewer_cost(without, with_, [0.7, 0.6, 0.8])
    assert (cost.pairs, cost.ticks, cost.wall, cost.write) == (5, 10_000, 2.1, 0.7)
    assert math.isclose(cost.wall_ratio, 2.3 / 2.1)
    assert math.isclose(cost.cpu_ratio, 1.25)
    assert math.isclose(cost.tick_ratio, 1.1)
    # The ratios of the pairs: 1.1, 1.05, 0.256, 1.143, 1.2.
    assert cost.wall_quartiles == pytest.approx((1.05, 2.4 / 2.1))
    assert cost.missed == ()


@pytest.mark.parametrize(
    ("factor", "write", "ticks", "missed"),
    [
        (1.099, 0.99, 10_000, []),
        (1.101, 0.99, 10_000, ["the command takes 10.1 % longer, allowed are 10"]),
        (1.0, 1.01, 3_334, ["writing takes 1.01 s, allowed is 1 s for 10,000 ticks"]),
        (1.0, 1.99, 20_000, []),
        (1.0, 2.01, 20_000, ["writing takes 2.01 s, allowed is 1 s for 10,000 ticks"]),
    ],
)
def test_a_bar_that_is_missed_is_said(factor: float, write: float, ticks: int, missed: list[str]) -> None:
    cost = viewer_cost(commands(2.0, ticks=ticks), commands(2.0 * factor, ticks=ticks), [write])
    assert list(cost.missed) == missed
