"""Tables of the bench: every number comes back, units stand beside them, and nothing foreign is destroyed."""

import json
import math
from pathlib import Path

import pytest

from hhsim.errors import InputError, OutputError
from hhsim.table.file import check_table_path, load_table, write_table
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


def test_a_table_comes_back_with_all_it_says(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_table(path, "hard", COLUMNS, ROWS, OPTIONS)
    table = load_table(path)
    assert (table.suite, table.columns, table.options) == ("hard", COLUMNS, OPTIONS)
    assert {"hhsim_version", "git_revision", "git_dirty", "created_utc"} < table.attributes.keys()
    assert json.loads(table.attributes["machine"])["cores"] > 0 and "numpy" in json.loads(table.attributes["packages"])
    first, second, third = table.rows
    assert first == ROWS[0] and math.isnan(second["tick_p50"])
    assert {**second, "tick_p50": None} == ROWS[1] and third == {**ROWS[2], "method": ""}
    assert sorted(found.name for found in tmp_path.iterdir()) == ["a.csv", "a.json"]
    write_table(path, "hard", COLUMNS, [], {})
    assert load_table(path).rows == ()
    write_table(path, "hard", [Column("x", "a number")], [{"x": None}], {})
    assert math.isnan(load_table(path).rows[0]["x"])


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "hhsim-tree"}, "hhsim-tree"),
        ({"version": 2}, "version 2"),
        ({"columns": None}, "no readable table"),
        ({"columns": [{"name": "gone", "unit": "1", "shown": "", "says": ""}]}, "gone"),
        ({"rows": [3]}, "no readable table"),
        ({"suite": None, "options": 5}, "no readable table"),
    ],
)
def test_files_that_are_no_table_are_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = tmp_path / "a.json"
    with pytest.raises(InputError, match="no such file"):
        load_table(path)
    write_table(path, "hard", COLUMNS, ROWS, {})
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document)[:-9])
    with pytest.raises(InputError, match="no readable table"):
        load_table(path)
    path.write_text(json.dumps(document | change))
    with pytest.raises(InputError, match=message):
        load_table(path)
