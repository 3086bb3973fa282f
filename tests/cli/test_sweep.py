"""`hhsim sweep` as users meet it."""

import csv
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from sweep_plans import PLAN, write_plan

from hhsim.sweep import engines
from hhsim.sweep.engines import TaskEnd
from hhsim.sweep.sweep import CellTask


@pytest.fixture
def planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A plan whose cells run in this process; those of `paper` fail."""

    def here(tasks: Sequence[CellTask], scheduler: str, jobs: int) -> Any:
        for task in tasks:
            yield TaskEnd(task.digest, "no way") if task.cell.method == "paper" else task.run()

    monkeypatch.setattr(engines, "run_tasks", here)
    return write_plan(
        tmp_path, PLAN.replace('"penalty"', '"paper"') + "[options.deep]\nlevel = 3\nlinearisations = 9\n"
    )


def test_a_sweep_from_dry_run_to_table(run: Run, planned: Path, tmp_path: Path) -> None:
    answer = run("sweep", str(planned), "--dry-run")
    assert answer.code == 0, answer.err
    assert "4 cells: 0 done, 4 to run, 800 ticks" in answer.out
    assert not (tmp_path / "results").exists()
    answer = run("sweep", str(planned))
    assert answer.code == 1, answer.err
    assert "4 cells: 2 done now, 2 failed" in answer.out
    assert re.search(r"cylinder, short, paper, deep +level=3 linearisations=9 +no way", answer.out)
    assert re.search(r"cylinder +short +coupled +spheres +deep: level=3 linearisations=9 +within limits ", answer.out)
    assert "all figures of each cell are in results/small/table.csv" in answer.out and " ± " not in answer.out
    table = list(csv.DictReader((tmp_path / "results/small/table.csv").read_text().splitlines()))
    assert [row["verdict"] for row in table].count("failed") == 2 and {row["reason"] for row in table} == {
        "no way",
        "",
        "contact_error_max",
    }
    document = json.loads(run("sweep", str(planned), "--json").out)
    assert (document["done_now"], document["done_before"], len(document["failed"])) == (0, 2, 2)
    done = [(row, told) for row, told in zip(document["rows"], table, strict=True) if row["verdict"] != "failed"]
    assert all(float(told["tick_cpu_p50 [s]"]) == row["tick_cpu_p50"] > 0.0 for row, told in done) and len(done) == 2
    quiet = run("sweep", str(planned), "--quiet")
    assert quiet.out == "" and len(document["failed"][0]["options"]) in (1, 2)
    assert quiet.err.splitlines()[0] == "hhsim: missed: 2 cells failed"
    assert "hhsim: missed: cylinder, short, paper, deep: no way" in quiet.err.splitlines()[1:]
