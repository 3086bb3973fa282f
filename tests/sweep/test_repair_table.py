"""The table of repairs that a terminal has room for."""

from pathlib import Path

import pytest

from hhsim.repair.request import RepairRequest
from hhsim.sweep.repair_batch import RepairedRow, RowOutcome, State, brief_table, repair_table
from hhsim.sweep.repair_manifest import PlannedRepair


def row(folder: Path, name: str, depth: float | None, state: State = "repaired", **more: float) -> RepairedRow:
    """A row with a depth [m], in a folder of its own."""
    request = RepairRequest(folder / f"{name}.npz", "cube", folder / name / f"{name}.npz")
    figures: dict[str, float | None] = (
        {} if depth is None else {"depth_cones_max_before": 10 * depth, "depth_cones_max_after": depth, **more}
    )
    outcome = RowOutcome(digest=name, state=state, reason="" if state == "repaired" else "why", figures=figures)
    return RepairedRow(PlannedRepair(name, request, 1.0), outcome)


def test_a_terminal_has_a_few_figures_of_the_skin_where_there_is_one(tmp_path: Path) -> None:
    rows = [row(tmp_path, "r3", 3e-4, contacts_kept_5mm_after=0.97), row(tmp_path, "failed", None, "failed")]
    skinned = row(tmp_path, "skin", 1e-3, depth_skin_max_after=2e-3, jerk_after=3.0)
    cells = {record["name"]: record for record in brief_table(repair_table([*rows, skinned])).records}
    assert list(cells["skin"]) == ["name", "state", "frames", "marked", "PD before", "PD after", "kept, 5 mm", "reason"]
    assert cells["skin"]["PD after"] == 2e-3 and cells["skin"]["PD before"] == 1e-2
    assert cells["r3"]["PD after"] == pytest.approx(3e-4)
    assert cells["r3"]["kept, 5 mm"] == pytest.approx(0.97) and cells["failed"]["reason"] == "why"
