"""Runs that set time against error: their sums, their frontier, failures, and who is compared with whom."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.bench.figures import figure, mean, worst
from hhsim.bench.trade_off import Run, Way, competing, failure_remark, frontier, mark_frontier, summed_rows
from hhsim.solver.options import SolverOptions
from hhsim.table.file import ALL

FIGURES = (figure("error", "", "m", worst), figure("off", "", "m", mean), figure("lag", "", "", np.nansum))


ONE, TWO = (Way(SolverOptions(method=method)) for method in ("coupled", "paper"))


def made_up(name: str, motion: str, cost: float, **figures: float) -> Run:
    return Run(name, motion, ONE, figures, cpu=[np.full(4, cost)] * 2, other=[np.full(4, 2.0 * cost)] * 2)


def rows_of_runs(runs: list[Run]) -> list[dict[str, Any]]:
    return summed_rows(runs, FIGURES, lambda group: {"way": group[0].way})


def test_rows_sum_up_by_worst_mean_and_count() -> None:
    runs = [
        made_up("cube", "touch", 1e-5, error=1e-4, off=2e-3, lag=3),
        made_up("cube", "grasp", 3e-5, error=3e-4, off=4e-3, lag=4),
        made_up("cup", "grasp", 9e-3, error=2e-4, off=np.nan, lag=5),
    ]
    rows = rows_of_runs(runs)
    assert [(row["object"], row["motion"]) for row in rows[3:]] == [("cube", ALL), ("cup", ALL), (ALL, ALL)]
    cube, cup, everything = rows[3:]
    assert (cube["error"], cube["lag"], cube["contact_ticks"]) == (3e-4, 7, 8)
    assert (cube["off"], cube["tick_cpu_p50"]) == pytest.approx((3e-3, 2e-5))
    assert np.isnan(cup["off"]) and everything["off"] == pytest.approx(3e-3)


def test_a_run_that_fails_wins_nothing_and_is_told() -> None:
    failed = Run("cube", "touch", TWO, failure="it broke")
    rows = rows_of_runs([made_up("cube", "touch", 1e-5, error=1e-4), failed])
    assert [row["failed_runs"] for row in rows] == [0, 1, 0, 1, 0, 1]
    assert np.isnan(rows[1]["tick_cpu_p50"]) and np.isnan(rows[1]["error"])
    assert all(len(group) == 1 for group in competing(rows))
    told = failure_remark([failed, failed])
    assert told == ["2 of 2 runs could not be done; the first: paper, cube, touch: it broke"]


def test_a_frontier_leaves_out_hair_breadths() -> None:
    errors = ((1e-5, 2e-4), (3e-5, 5e-5), (2e-5, 1e-6), (4e-5, 9.9e-7))
    group = [{"tick_cpu_p50": time, "error": error, "best": False} for time, error in errors]
    mark_frontier(group, "best", "error")
    assert [row["best"] for row in group] == [True, False, True, False]


coordinate = st.one_of(st.integers(0, 5).map(float), st.floats(allow_nan=True, allow_infinity=True))


@given(st.lists(st.tuples(coordinate, coordinate), max_size=30))
def test_the_frontier_holds_exactly_what_no_other_point_beats(points: list[tuple[float, float]]) -> None:
    found = frontier([x for x, _ in points], [y for _, y in points])
    values = [points[i] for i in found]
    assert values == sorted(values) and len(set(values)) == len(values)
    whole = [p for p in points if not (np.isnan(p[0]) or np.isnan(p[1]))]
    unbeaten = {(x, y) for x, y in whole if not any(a <= x and b <= y and (a < x or b < y) for a, b in whole)}
    assert set(values) == unbeaten
