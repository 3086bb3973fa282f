"""Tables of the bench: every number is as it was, units stand beside them, and nothing foreign is destroyed."""

import json
import math
from pathlib import Path

import pytest

from hhsim.errors import OutputError
from hhsim.table.file import check_table_path, write_table
from hhsim.table.table import Column

COLUMNS = (
    Column("method", "method of the solver"),
    Column("level", "level of the sphere tree"),
    Column("tick_p50", "median CPU time of a tick", "µs"),
    Column("passed", "whether the bar was met"),
)
ROWS = (
    {"method": "coupled", "level": 4, "tick_p50": 0.1 + 0.2, "passed": True},
    {"method": 'a, "b"\nμ', "level": -3, "tick_p50": None, "passed": False},
    {"method": None, "level": 2**60, "tick_p50": 1.0, "passed": False},
)
OPTIONS = {"seed": 3, "objects": ["bunny"], "nothing": None}


def test_a_table_holds_all_it_says(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_table(path, "hard", COLUMNS, ROWS, OPTIONS)
    table = json.loads(path.read_text())
    assert (table["format"], table["version"], table["suite"], table["options"]) == ("hhsim-bench", 1, "hard", OPTIONS)
    assert table["columns"][2] == {"name": "tick_p50", "unit": "s", "shown": "µs", "says": COLUMNS[2].says}
    assert {"hhsim_version", "git_revision", "git_dirty", "created_utc"} < table.keys()
    assert json.loads(table["machine"])["cores"] > 0 and "numpy" in json.loads(table["packages"])
    assert table["rows"] == list(ROWS)
    assert sorted(found.name for found in tmp_path.iterdir()) == ["a.csv", "a.json"]
    write_table(path, "hard", [Column("x", "a number")], [{"x": math.nan}], {})
    assert json.loads(path.read_text())["rows"] == [{"x": None}]


def test_what_is_no_table_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("thesis")
    (tmp_path / "b.json").write_text('{"format": "hhsim-cell"}')
    (tmp_path / "c.csv").write_text("thesis")
    (tmp_path / "d.csv").mkdir()
    before = sorted(path.name for path in tmp_path.iterdir())
    for name, message in (
        ("a.json", "no table"),
        ("b.json", "no table"),
        ("c.json", r"c\.csv exists"),
        ("d.json", r"d\.csv is a folder"),
        ("a.csv", "must end in .json"),
        ("none/a.json", "no folder"),
    ):
        with pytest.raises(OutputError, match=message):
            check_table_path(tmp_path / name)
        with pytest.raises(OutputError, match=message):
            write_table(tmp_path / name, "hard", COLUMNS, ROWS, OPTIONS)
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "a.json").read_text() == "thesis"
