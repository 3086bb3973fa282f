"""Charts of benches: every suite that can be run has one, its points are the rows, and its units keep the numbers."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawings_alone import drawn

from hhsim.bench import mesh_size
from hhsim.bench.manipulation import answers as manipulation
from hhsim.bench.paper import table as paper
from hhsim.bench.paper import threads
from hhsim.bench.qp import bench as qp
from hhsim.bench.robustness import hard, recorded, stress
from hhsim.bench.table import BenchTable, load_table, write_table
from hhsim.report import bench_chart
from hhsim.report.bench_chart import CHARTS, bench_figure, shown_unit
from hhsim.report.bench_trade_off import TRADE_OFF_COLUMNS
from hhsim.table.table import Column, unit_size

COLUMNS = {
    "paper": paper.ROW_COLUMNS,
    "hard": hard.COLUMNS,
    "manipulation": manipulation.COLUMNS,
    "stress": stress.COLUMNS,
    "recorded": recorded.COLUMNS,
    "qp": qp.COLUMNS,
    "mesh-size": mesh_size.COLUMNS,
    "threads": threads.COLUMNS,
}


@pytest.mark.parametrize("suite", sorted(CHARTS))
def test_a_chart_names_columns_that_its_suite_has(suite: str) -> None:
    chart, names = CHARTS[suite], {column.name for column in COLUMNS[suite]}
    assert {chart.series, *chart.labels, *filter(None, (chart.x, chart.y))} <= names


def test_every_suite_has_a_chart() -> None:
    assert {*CHARTS, *TRADE_OFF_COLUMNS} == set(importlib.import_module("hhsim.cli.bench").SUITES)


def table(tmp_path: Path, suite: str, columns: tuple[Column, ...], rows: list[dict[str, Any]]) -> BenchTable:
    write_table(tmp_path / "t.h5", suite, columns, rows, {})
    return load_table(tmp_path / "t.h5")


THREADS = (Column("threads", "threads"), Column("total", "whole tick", "s"), Column("case", "case"))


def test_the_points_are_the_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows: list[dict[str, Any]] = [
        {"threads": n, "total": 1e-5 * (k + 1) / n, "case": case} for k, case in enumerate("SW") for n in (1, 2, 4)
    ]
    found = table(tmp_path, "threads", THREADS, [*rows, {"threads": 8, "total": None, "case": "S"}])
    drawn: list[np.ndarray] = []
    points = bench_chart._draw_points

    def kept(axes: Any, *arguments: Any) -> Any:
        handles = points(axes, *arguments)
        drawn.extend(np.column_stack(line.get_data()) for line in axes.lines)
        return handles

    monkeypatch.setattr(bench_chart, "_draw_points", kept)
    figure = bench_figure(found)
    assert figure is not None
    assert "6 points" in figure.alt
    expected = [[[row["threads"], 1e6 * row["total"]] for row in rows if row["case"] == case] for case in "SW"]
    np.testing.assert_allclose(np.array(drawn[:2]), np.array(expected, dtype=np.float64))


def test_the_picture_of_peers_has_each_configuration_and_names_other_engines(tmp_path: Path) -> None:
    row: dict[str, Any] = {"object": "cube", "motion": "all", "method": "coupled", "tick_cpu_p50": 1e-5}
    row |= {"mesh_error": 1e-6, "ours": True, "frontier": True}
    rows = [{**row, "surface": surface} for surface in ("spheres", "mesh")]
    rows += [{**row, "method": "mujoco", "surface": "mesh", "ours": False}, {**rows[0], "motion": "grasp"}]
    columns = tuple(Column(name, name) for name in rows[0])
    made = bench_figure(table(tmp_path, "peers", columns, rows))
    assert made is not None and made.alt.endswith("3 points.")
    with drawn(made, 7.0) as figure:
        (axes,) = figure.axes
        assert {text.get_text() for text in axes.texts} == {"cube: off the true mesh [mm]", "mujoco"}
        names = {text.get_text() for text in figure.legends[0].get_texts()}
        assert names == {"coupled", "spheres", "the mesh itself", "other programs"}


def test_a_table_without_numbers_or_of_another_suite_has_none(tmp_path: Path) -> None:
    assert bench_figure(table(tmp_path, "threads", THREADS, [{"threads": 1, "total": None, "case": "S"}])) is None
    assert bench_figure(table(tmp_path, "threads", THREADS[:2], [{"threads": 1, "total": 1.0}])) is None
    assert bench_figure(table(tmp_path, "own", THREADS, [{"threads": 1, "total": 1.0, "case": "S"}])) is None


@pytest.mark.parametrize(
    ("largest", "unit"), [(2.0, "s"), (0.9, "ms"), (1e-3, "ms"), (9e-4, "µs"), (5e-8, "ns"), (0.0, "s"), (None, "s")]
)
def test_the_unit_keeps_the_largest_number_at_one_or_more(tmp_path: Path, largest: float | None, unit: str) -> None:
    rows = [{"threads": 1, "total": value, "case": "S"} for value in (largest, None)]
    found = shown_unit(table(tmp_path, "threads", THREADS, rows), "total")
    assert found == unit
    if largest:
        assert 1.0 <= largest / unit_size(found) < 1e3 or unit in ("s", "ns")
