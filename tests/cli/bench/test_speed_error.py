"""`hhsim bench speed-error` end to end, small."""

import json
from pathlib import Path

from conftest import Run

from hhsim.bench.table import load_table

COMMAND = (
    "bench speed-error --object cube --motion touch --method coupled,progressive --surface spheres --level 2 "
    "--linearisations 12 --qp active-set --repetitions 1 --rate 33"
)
SMALL = COMMAND.split()


def test_it_prints_tables_and_writes_three_files(run: Run, tmp_path: Path) -> None:
    answer = run(*SMALL, "--out", "a.h5")
    assert answer.code == 0, answer.err
    assert "Methods and what they touch (cube: touch)" in answer.out
    assert "the table is in a.h5 and a.csv, the picture in a.png" in answer.out
    assert "compare them within this run, not between machines" in answer.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.h5", "a.png"]
    table = load_table(tmp_path / "a.h5")
    assert table.suite == "speed-error"
    assert table.options["levels"] == [2]
    assert [(row["object"], row["motion"], row["method"]) for row in table.rows] == [
        (name, motion, method)
        for name, motion in (("cube", "touch"), ("cube", "all"), ("all", "all"))
        for method in ("coupled", "progressive")
    ]
    assert all(float(row["penetration_max"]) <= 1e-6 for row in table.rows)
    assert "tick_cpu_p50 [s]" in (tmp_path / "a.csv").read_text().splitlines()[0]


def test_json_is_one_document(run: Run, tmp_path: Path) -> None:
    answer = run(*SMALL, "--json", "--out", "a.h5", "--plot", "b.svg")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    assert (document["table"], document["csv"], document["plot"]) == ("a.h5", "a.csv", "b.svg")
    assert [row["method"] for row in document["configurations"]] == ["coupled", "progressive"]
    assert document["units"]["tick_cpu_p50"] == "s"
    first = document["configurations"][0]
    assert 0.0 < first["tick_cpu_p50"] < 1.0
    assert 0.0 < first["contact_error_max"] < 0.02
    assert (tmp_path / "b.svg").is_file()


def test_a_picture_of_yours_is_not_replaced(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("holiday")
    answer = run(*SMALL, "--out", "a.h5")
    assert answer.code == 2
    assert "a.png exists" in answer.err
    assert (tmp_path / "a.png").read_text() == "holiday"
