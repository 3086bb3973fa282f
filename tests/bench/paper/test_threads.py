"""The table of `hhsim bench threads`: what it averages, what it says of it, and the command."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from conftest import Run

from hhsim.bench.paper import threads
from hhsim.bench.paper.threads import COLUMNS, ThreadsOptions, best_speedup, measure, remarks
from hhsim.bench.table import load_table

SMALL = ThreadsOptions(objects=("cup",), level=3, threads=(2,), instances=2, rounds=2)


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    return measure(SMALL)


def test_there_is_a_row_for_each_case_and_number_of_threads(rows: list[dict[str, Any]]) -> None:
    found = {(row["case"], row["method"], row["threads"]) for row in rows}
    assert found == {(case, "progressive", t) for case in ("SF", "TF", "FF", "WH") for t in (1, 2)}
    assert len(rows) == len(found)
    assert all(set(row) == {column.name for column in COLUMNS} for row in rows)


def test_rows_add_up(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        assert row["instances"] == 2
        assert row["detection"] + row["response"] > 0.0
        alone = next(r for r in rows if r["threads"] == 1 and all(r[k] == row[k] for k in ("case", "method")))
        assert row["contacts"] == alone["contacts"], "the same ticks, whatever the number of threads"
        assert row["speedup"] == pytest.approx(alone["total"] / row["total"])
    contacts = {row["case"]: row["contacts"] for row in rows}
    assert contacts["FF"] > contacts["SF"] > 0
    best = max(row["speedup"] for row in rows if row["threads"] == 2)
    assert best_speedup(rows).startswith(f"2 threads are at best {best:.2f} times as fast as one (cup, ")


def test_helpers_without_a_processor_are_told_of() -> None:
    row = {"threads": 2, "total": 1.0, "total_cpu": 1.95}
    assert remarks([row, {**row, "threads": 1}]) == []
    (note,) = remarks([{**row, "total_cpu": 1.3}])
    assert "for 30 % of the time" in note


def test_the_command_writes_the_table(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The second run prints what the first one measured.
    monkeypatch.setattr(threads, "measure", cache(measure))
    few = ("--object", "cup", "--instances", "1", "--rounds", "1")
    answer = run("bench", "threads", *few, "--out", "a.h5", "--json")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    table = load_table(tmp_path / "a.h5")
    assert table.suite == "threads"
    assert [row["threads"] for row in table.rows] == [1, 2] * 4
    assert (tmp_path / "a.csv").exists()
    assert [row["total"] for row in table.rows] == [row["total"] for row in document["rows"]]

    answer = run("bench", "threads", *few, "--out", "b.h5")
    assert answer.code == 0, answer.err
    assert "wall time of a tick in contact, mean of 1 instances" in answer.out
    assert best_speedup(document["rows"]) in answer.out


def test_a_replay_takes_threads(run: Run) -> None:
    short = ("replay", "sphere", "touch", "--rate", "100", "--method", "progressive", "--json")
    alone, shared = (json.loads(run(*short, *more, "--out", "a.h5").out) for more in ((), ("--threads", "2")))
    assert alone["ticks"] == shared["ticks"]
    note = "CPU times are those of all 2 threads together, waiting for each other included"
    assert note in shared["notes"] and note not in alone["notes"]
    for wrong in (("--threads", "9"), ("--threads", "2", "--qp", "daqp")):
        assert run(*short, *wrong).code == 2
