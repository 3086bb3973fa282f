"""Runs that set time against error: their sums, their frontier, failures, and who is compared with whom."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.bench.suites.peers import Peers
from hhsim.bench.trade_off import Run, Way, frontier, mark_frontier
from hhsim.solver.options import SolverOptions
from hhsim.table.file import ALL

PEERS = Peers.planned(methods=("coupled", "paper"))
ONE, TWO = (Way(SolverOptions(method=method)) for method in ("coupled", "paper"))


def made_up(name: str, motion: str, cost: float, **figures: float) -> Run:
    return Run(name, motion, ONE, figures, cpu=[np.full(4, cost)] * 2, other=[np.full(4, 2.0 * cost)] * 2)


def test_rows_sum_up_by_worst_mean_and_count() -> None:
    runs = [
        made_up("cube", "touch", 1e-5, mesh_error=1e-4, force_hold_mean=2e-3, samples=3),
        made_up("cube", "grasp", 3e-5, mesh_error=3e-4, force_hold_mean=4e-3, samples=4),
        made_up("cup", "grasp", 9e-3, mesh_error=2e-4, force_hold_mean=np.nan, samples=5),
    ]
    rows = PEERS.rows(runs)
    assert [(row["object"], row["motion"]) for row in rows[3:]] == [("cube", ALL), ("cup", ALL), (ALL, ALL)]
    cube, cup, everything = rows[3:]
    assert (cube["mesh_error"], cube["samples"], cube["contact_ticks"]) == (3e-4, 7, 8)
    assert (cube["force_hold_mean"], cube["tick_cpu_p50"]) == pytest.approx((3e-3, 2e-5))
    assert np.isnan(cup["force_hold_mean"]) and everything["force_hold_mean"] == pytest.approx(3e-3)


def test_a_run_that_fails_wins_nothing_and_is_told() -> None:
    failed = Run("cube", "touch", TWO, failure="it broke")
    rows = PEERS.rows([made_up("cube", "touch", 1e-5, mesh_error=1e-4), failed])
    assert [row["failed_runs"] for row in rows] == [0, 1, 0, 1, 0, 1]
    assert np.isnan(rows[1]["tick_cpu_p50"]) and np.isnan(rows[1]["mesh_error"])
    assert [row["frontier"] for row in rows] == [True, False] * 3
    assert PEERS.notes([failed, failed])[-1:] == [
        "2 of 2 runs could not be done; the first: paper, cube, touch: it broke"
    ]


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
