"""The page of repairs: what is counted, which rows are the worst, and that it asks nobody for anything."""

import math
import re
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from report_reader import read_page

from hhsim.repair.request import REPORT, RepairRequest
from hhsim.sweep.repair_manifest import PlannedRepair, RowOutcome, State
from hhsim.sweep.repair_page import RepairedRow, brief_table, repair_page, repair_table


def row(folder: Path, name: str, depth: float | None, state: State = "repaired", **more: float) -> RepairedRow:
    """A row with a depth [m], in a folder of its own."""
    request = RepairRequest(folder / f"{name}.npz", "cube", folder / name / f"{name}.npz")
    figures: dict[str, float | None] = (
        {} if depth is None else {"depth_cones_max_before": 10 * depth, "depth_cones_max_after": depth, **more}
    )
    outcome = RowOutcome(digest=name, state=state, reason="" if state == "repaired" else "why", figures=figures)
    return RepairedRow(PlannedRepair(name, request, 1.0), outcome)


@pytest.fixture
def rows(tmp_path: Path) -> list[RepairedRow]:
    """Twelve repaired rows of growing depth, one that missed, two that were refused, one that failed."""
    found = [row(tmp_path, f"r{i}", 1e-4 * i, contacts_kept_5mm_after=1.0 - 0.01 * i) for i in range(12)]
    found.append(row(tmp_path, "missed", 5e-3, "missed", contacts_kept_5mm_after=math.nan))
    found += [row(tmp_path, name, None, "refused") for name in ("<b>no", "no & no")]
    return [*found, row(tmp_path, "failed", None, "failed")]


def page(rows: list[RepairedRow]) -> str:
    return repair_page(rows, repair_table(rows), "m.toml")


def test_it_counts_and_ranks(rows: list[RepairedRow]) -> None:
    found = read_page(page(rows))
    counts = {cells[0].partition(":")[0]: cells[1:] for cells in found.rows("Yield")[1:]}
    assert counts == {
        "imported": ["13", "81.2 %"],
        "repaired": ["12", "75.0 %"],
        "missed": ["1", "6.2 %"],
        "refused": ["2", "12.5 %"],
        "failed": ["1", "6.2 %"],
    }
    assert "12 of 16 recordings repaired within all limits." in found.one("header").text
    depths = np.array([*(0.1 * i for i in range(12)), 5.0])
    line = next(cells for cells in found.rows("Figures over all")[1:] if cells[0] == "PD, cones, max after [mm]")
    marks = (depths.min(), np.median(depths), depths.mean(), np.quantile(depths, 0.9), depths.max())
    assert line[1:] == ["13", *(f"{value:.3f}" for value in marks)]
    deepest, contacts = (e.text for e in found.all("article"))
    assert re.findall(r"(missed|r\d+)\s+[\d.]+", deepest)[:3] == ["missed", "r11", "r10"]
    assert re.findall(r"(missed|r\d+)\s+[\d.]+", contacts) == [f"r{i}" for i in range(11, 1, -1)]
    assert [cells[0] for cells in found.rows("All recordings")[1:]] == [one.name for one in rows]


def test_a_terminal_has_a_few_figures_of_the_skin_where_there_is_one(rows: list[RepairedRow], tmp_path: Path) -> None:
    skinned = row(tmp_path, "skin", 1e-3, depth_skin_max_after=2e-3, jerk_after=3.0)
    cells = {record["name"]: record for record in brief_table([*rows, skinned]).records}
    assert list(cells["skin"]) == ["name", "state", "frames", "marked", "PD before", "PD after", "kept, 5 mm", "reason"]
    assert cells["skin"]["PD after"] == 2e-3 and cells["skin"]["PD before"] == 1e-2
    assert cells["r3"]["PD after"] == pytest.approx(3e-4)
    assert cells["r3"]["kept, 5 mm"] == pytest.approx(0.97) and cells["failed"]["reason"] == "why"


def test_names_lead_to_reports(rows: list[RepairedRow], tmp_path: Path) -> None:
    of = {row.name: row.planned.request for row in rows}
    for name in ("missed", "r11", "<b>no"):
        (tmp_path / name).mkdir()
        of[name].beside(REPORT).write_text("")
    links = {e.attributes["href"] for e in read_page(page(rows)).all("a")}
    assert links == {f"{quote(name)}/{quote(of[name].beside(REPORT).name)}" for name in ("missed", "r11", "<b>no")}


def test_it_has_no_script_and_is_the_same_again(rows: list[RepairedRow]) -> None:
    text = page(rows)
    found = read_page(text)
    assert text == page(rows)
    assert not found.all("script")
    names = [e.attributes["id"] for e in found.elements if "id" in e.attributes]
    assert len(names) == len(set(names))


def test_rows_without_a_figure_make_a_page(tmp_path: Path) -> None:
    found = read_page(page([row(tmp_path, "one", None, "failed")]))
    assert not found.all("article")
    assert found.rows("All recordings")[1][0] == "one"
    read_page(page([row(tmp_path, "one", 0.0)]))
