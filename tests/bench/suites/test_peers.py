"""Peers: what is run and left out, that its figures are those of the runs, with a made-up engine and the command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from drawings_alone import trade_offs_undrawn
from hypothesis import given
from hypothesis import strategies as st

from hhsim.bench.suite import run_cells
from hhsim.bench.suites.peers import Peers
from hhsim.bench.trade_off import Run as MethodRun
from hhsim.bench.trade_off import Way, draw_trade_off, frontier, mark_frontier
from hhsim.errors import InputError
from hhsim.solver.options import SolverOptions
from hhsim.table.file import ALL

FAKE, GONE = "outside_methods:PushedEverywhere", "outside_methods:NotBuilt"
BOTH = Peers.planned(methods=("coupled", "paper"))


def made_up(
    method: str, time: float, error: float, name: str = "cube", motion: str = "grasp", **figures: float
) -> MethodRun:
    times, figures = [np.full(4, time)] * 2, {"mesh_error": error, **figures}
    return MethodRun(name, motion, Way(SolverOptions(method=method)), figures, times, times)


def test_what_is_not_installed_is_left_out_with_a_line() -> None:
    ways, notes = Peers.planned(methods=("coupled", GONE, FAKE)).installed()
    assert [(way.solver.method, way.solver.surface) for way in ways] == [
        ("coupled", "mesh"), ("coupled", "spheres"), (FAKE, "mesh"),
    ]  # fmt: skip
    assert notes == [f"left out: {GONE} needs a library that is not built"]
    with pytest.raises(InputError, match="needs a library that is not built"):
        list(run_cells(Peers.planned(methods=(GONE,))))


def test_a_hand_inside_is_told_by_how_much() -> None:
    suite = Peers.planned(
        objects=("cube",), motions=("touch",), methods=("coupled", FAKE), repetitions=1, rate=50.0, hands=20
    )
    ours, _, other = list(run_cells(suite))
    assert ours.failure == other.failure == ""
    assert ours.figures["mesh_error"] < 2e-6
    # The user's finger is in the cube, and the palm, which is said to be pushed, far away from it.
    assert other.figures["mesh_depth_max"] > 1e-3
    assert other.figures["contact_error_max"] > 0.01
    np.testing.assert_allclose(other.other, 7e-9)
    rows = suite.rows([ours, other])
    assert [set(row) for row in rows] == [{column.name for column in suite.columns()}] * len(rows)


@pytest.mark.soak
def test_a_run_that_takes_long_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    suite = Peers.planned(objects=("cube",), motions=("touch",), methods=(FAKE,), repetitions=2, rate=50.0, hands=5)
    (twice,) = list(run_cells(suite))
    monkeypatch.setattr("hhsim.bench.trade_off.LONG", 0.0)
    (once,) = list(run_cells(suite))
    assert (len(twice.cpu), len(once.cpu)) == (2, 1)
    assert [row["repetitions"] for row in suite.rows([twice, once])] == [2, 1, 1, 1]


def test_who_is_as_near_and_faster_wins() -> None:
    rows = Peers.planned().rows(
        [made_up("coupled", 1e-5, 1e-4), made_up(FAKE, 5e-6, 2e-4), made_up("penalty", 4e-5, 3e-4)]
    )
    single = {row["method"]: row for row in rows if row["motion"] != ALL}
    won = [f"cube, grasp: none of ours is as near and as fast as {FAKE}"]
    assert Peers.planned().lines(rows) == won
    assert single[FAKE]["times_ours"] == pytest.approx(0.5)
    assert single["penalty"]["times_ours"] == pytest.approx(4.0)
    assert {name for name, row in single.items() if row["frontier"]} == {"coupled", FAKE}
    for error, found in ((1e-5, won), (2e-4, [])):
        rows = Peers.planned().rows([made_up("coupled", 1e-5, 1e-4), made_up(FAKE, 1e-3, error)])
        assert Peers.planned().lines(rows) == found


def test_the_command_writes_table_and_picture(run: Run, tmp_path: Path) -> None:
    answer = run(
        "bench", "peers", "--object", "cube", "--motion", "touch", "--method", f"coupled,{FAKE},{GONE}", "--rate", "50",
        "--repetitions", "1", "--json", "--out", "peers.json",
    )  # fmt: skip
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    assert f"left out: {GONE} needs a library that is not built" in document["notes"]
    table = json.loads((tmp_path / "peers.json").read_text())
    assert table["suite"] == "peers" and {row["method"] for row in table["rows"]} == {"coupled", FAKE}
    assert (tmp_path / "peers.png").stat().st_size > 10_000


def test_the_picture_has_each_method_on_its_surface_and_names_other_engines(monkeypatch: pytest.MonkeyPatch) -> None:
    figures = trade_offs_undrawn(monkeypatch)
    row: dict[str, Any] = {"object": "cube", "motion": "all", "method": "coupled", "tick_cpu_p50": 1e-5}
    row |= {"mesh_error": 1e-6, "ours": True, "frontier": True}
    rows = [{**row, "surface": surface} for surface in ("spheres", "mesh")]
    rows += [{**row, "method": "mujoco", "surface": "mesh", "ours": False}, {**rows[0], "motion": "grasp"}]
    draw_trade_off(Path("peers.png"), rows)
    assert [axes.get_title(loc="left") for axes in figures[0].axes] == ["cube: off the true mesh [mm]", ""]
    names = {text.get_text() for text in figures[0].legends[0].get_texts()}
    assert names == {"coupled", "spheres", "the mesh itself", "mujoco"}


def test_rows_sum_up_by_worst_mean_and_count() -> None:
    runs = [
        made_up("coupled", 1e-5, 1e-4, motion="touch", force_hold_mean=2e-3, samples=3),
        made_up("coupled", 3e-5, 3e-4, force_hold_mean=4e-3, samples=4),
        made_up("coupled", 9e-3, 2e-4, "cup", force_hold_mean=np.nan, samples=5),
    ]
    rows = BOTH.rows(runs)
    assert [(row["object"], row["motion"]) for row in rows[3:]] == [("cube", ALL), ("cup", ALL), (ALL, ALL)]
    cube, cup, everything = rows[3:]
    assert (cube["mesh_error"], cube["samples"], cube["contact_ticks"]) == (3e-4, 7, 8)
    assert (cube["force_hold_mean"], cube["tick_cpu_p50"]) == pytest.approx((3e-3, 2e-5))
    assert np.isnan(cup["force_hold_mean"]) and everything["force_hold_mean"] == pytest.approx(3e-3)


def test_a_run_that_fails_wins_nothing_and_is_told() -> None:
    failed = MethodRun("cube", "touch", Way(SolverOptions(method="paper")), failure="it broke")
    rows = BOTH.rows([made_up("coupled", 1e-5, 1e-4, motion="touch"), failed])
    assert [row["failed_runs"] for row in rows] == [0, 1, 0, 1, 0, 1]
    assert np.isnan(rows[1]["tick_cpu_p50"]) and np.isnan(rows[1]["mesh_error"])
    assert [row["frontier"] for row in rows] == [True, False] * 3
    assert BOTH.notes([failed, failed])[-1:] == [
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
