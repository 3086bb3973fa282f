"""The table of `hhsim bench threads`: what it averages, what it says of it, and the command."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from conftest import Run

from hhsim.bench import threads as bench_threads
from hhsim.bench.table import load_table
from hhsim.bench.threads import COLUMNS, ThreadsOptions, measure, remarks, when_threads_pay

SMALL = ThreadsOptions(objects=("cube",), level=3, threads=(2,), instances=20, rounds=2)


def row(contacts: float, speedup: float, **others: Any) -> dict[str, Any]:
    made = {
        "object": "cup",
        "case": "WH",
        "method": "progressive",
        "threads": 2,
        "contacts": contacts,
        "speedup": speedup,
    }
    return {**made, "helpers_ran": 1.0, "cpu_ratio": 2.0, **others}


@pytest.fixture(scope="module")
def rows() -> list[dict[str, Any]]:
    return measure(SMALL)


def test_there_is_a_row_for_each_case_method_and_number_of_threads(rows: list[dict[str, Any]]) -> None:
    found = {(row["case"], row["method"], row["threads"]) for row in rows}
    assert found == {(case, "progressive", threads) for case in ("SF", "TF", "FF", "WH") for threads in (1, 2)}
    assert len(rows) == len(found)
    assert all(set(row) == {column.name for column in COLUMNS} for row in rows)


def test_rows_add_up(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        assert row["instances"] == 20
        assert 0.0 < row["detection"] + row["response"] < row["total"]
        alone = next(r for r in rows if r["threads"] == 1 and all(r[k] == row[k] for k in ("case", "method")))
        assert row["contacts"] == alone["contacts"], "the same ticks, whatever the number of threads"
        assert row["speedup"] == pytest.approx(alone["total"] / row["total"])
        assert row["cpu_ratio"] == pytest.approx(row["total_cpu"] / alone["total_cpu"])
        assert (row["helpers_ran"] is None) == (row["threads"] == 1)
    contacts = {row["case"]: row["contacts"] for row in rows}
    assert contacts["FF"] > contacts["SF"] > 0


def test_instances_lie_where_the_hand_closes_and_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    from hhsim.hand.model import HandModel

    monkeypatch.setattr(bench_threads, "MOTIONS", {"SF": bench_threads.MOTIONS["SF"]})
    group = bench_threads._groups(SMALL, HandModel.default(), lambda *_: None)[0]
    bench_threads._run(group[0], 20)
    at = group[0].instances
    assert at is not None
    assert len(set(at.tolist())) == 20
    phases = {phase.name: phase for phase in group[0].scene.ticks.phases}
    assert phases["touch"].first_tick <= at.min() < phases["hold"].first_tick
    assert phases["hold"].first_tick < at.max() <= phases["hold"].last_tick


@pytest.mark.parametrize(
    ("speedups", "words"),
    [
        ([0.7, 0.9, 1.04], "never pays here: at best 1.04 times as fast (cup, WH)"),
        ([1.2, 1.05, 1.3], "pays in 3 of 3 scenes: at best 1.30 times as fast"),
        ([0.7, 1.3, 0.9], "pays in 1 of 3 scenes: at best 1.30 times as fast"),
    ],
)
def test_the_sentence_says_what_the_rows_say(speedups: list[float], words: str) -> None:
    rows = [row(100.0 * (i + 1), speedup) for i, speedup in enumerate(speedups)]
    (sentence,) = when_threads_pay([*rows, row(50.0, 1.0, threads=1)])
    assert sentence.startswith("progressive, 2 threads: ")
    assert words in sentence
    assert "2.0 times the processor time" in sentence


def test_helpers_that_were_kept_from_working_are_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    assert remarks([row(10.0, 1.0)]) == []
    (starved,) = remarks([row(10.0, 1.0, helpers_ran=0.3)])
    assert "for 30 % of the time" in starved
    (sentence,) = when_threads_pay([row(10.0, 1.0, helpers_ran=0.3)])
    assert "no verdict" in sentence
    (crowded,) = remarks([row(10.0, 1.0, threads=3)])
    assert "3 threads on 2 processors" in crowded


def test_the_command_writes_the_table_and_says_when_threads_pay(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The second run prints what the first one measured.
    monkeypatch.setattr(bench_threads, "measure", cache(measure))
    few = ("--object", "cup", "--instances", "5", "--rounds", "1")
    answer = run("bench", "threads", *few, "--out", "a.h5", "--json")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    assert document["when"][0].startswith("progressive, 2 threads: ")
    table = load_table(tmp_path / "a.h5")
    assert table.suite == "threads"
    assert table.columns == COLUMNS
    assert [row["threads"] for row in table.rows] == [1, 2] * 4
    assert (tmp_path / "a.csv").exists()
    assert [row["total"] for row in table.rows] == [row["total"] for row in document["rows"]]

    answer = run("bench", "threads", *few, "--out", "b.h5")
    assert answer.code == 0, answer.err
    assert "wall time of a tick, mean of 5 instances in contact" in answer.out
    assert "progressive, 2 threads: " in answer.out
    assert "the table is in b.h5 and b.csv" in answer.out


def test_a_replay_takes_threads(run: Run) -> None:
    short = ("replay", "sphere", "touch", "--rate", "100", "--method", "progressive", "--json")
    alone, shared = (json.loads(run(*short, *more, "--out", "a.h5").out) for more in ((), ("--threads", "2")))
    assert alone["ticks"] == shared["ticks"]
    note = "CPU times are those of all 2 threads together, waiting for each other included"
    assert note in shared["notes"] and note not in alone["notes"]
    for wrong in (("--threads", "9"), ("--threads", "2", "--qp", "daqp")):
        assert run(*short, *wrong).code == 2
