"""Tables of benches on a page: cost against error."""

from pathlib import Path
from typing import Any

import pytest
from drawings_alone import leave_charts_undrawn

from hhsim.report.trade_off import bench_trade_off, has_trade_off
from hhsim.table.file import BenchTable, load_table, write_table
from hhsim.table.table import Column

COLUMNS = (Column("total", "whole tick", "s"), Column("case", "case"))


def table(tmp_path: Path, suite: str, columns: tuple[Column, ...], rows: list[dict[str, Any]]) -> BenchTable:
    write_table(tmp_path / "t.json", suite, columns, rows, {})
    return load_table(tmp_path / "t.json")


def test_the_picture_of_peers_has_each_configuration_and_names_other_engines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = leave_charts_undrawn(monkeypatch)
    row: dict[str, Any] = {"object": "cube", "motion": "all", "method": "coupled", "tick_cpu_p50": 1e-5}
    row |= {"mesh_error": 1e-6, "ours": True, "frontier": True}
    rows = [{**row, "surface": surface} for surface in ("spheres", "mesh")]
    rows += [{**row, "method": "mujoco", "surface": "mesh", "ours": False}, {**rows[0], "motion": "grasp"}]
    found = table(tmp_path, "peers", tuple(Column(name, name) for name in rows[0]), rows)
    assert has_trade_off(found)
    made = bench_trade_off("peers", found.rows)
    assert made is not None and made.alt.endswith("3 points.")
    (figure,) = figures
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["cube: off the true mesh [mm]", ""]
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert names == {"coupled", "spheres", "the mesh itself", "mujoco"}


def test_a_table_without_numbers_or_of_another_suite_has_none(tmp_path: Path) -> None:
    nothing = dict.fromkeys(("object", "motion", "method", "surface"), "all") | {
        "tick_cpu_p50": None,
        "mesh_error": None,
    }
    assert bench_trade_off("peers", [{**nothing, "ours": True, "frontier": False}]) is None
    assert not has_trade_off(table(tmp_path, "peers", COLUMNS, [{"total": 1.0, "case": "S"}]))
    assert not has_trade_off(table(tmp_path, "hard", COLUMNS, [{"total": 1.0, "case": "S"}]))
