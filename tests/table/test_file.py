"""Tables of the bench: every bit comes back, units stand beside the numbers, and nothing foreign is destroyed."""

import json
import math
from pathlib import Path

import h5py
import numpy as np
import pytest

from hhsim.errors import InputError, OutputError
from hhsim.table.file import check_table_path, csv_path, load_table, write_table
from hhsim.table.table import Column

COLUMNS = (
    Column("method", "method of the solver"),
    Column("level", "level of the sphere tree"),
    Column("tick_p50", "median CPU time of a tick", "s"),
    Column("passed", "whether the bar was met"),
)
ROWS = (
    {"method": "coupled", "level": 4, "tick_p50": 2.5e-5, "passed": True},
    {"method": 'a, "b"\nμ', "level": np.int64(-3), "tick_p50": None, "passed": np.bool_(False)},
    {"method": "", "level": 2**60, "tick_p50": 1, "passed": False},
)
OPTIONS = {"seed": 3, "objects": ["bunny"], "nothing": None}


def test_a_table_comes_back_with_all_it_says(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_table(path, "hard", COLUMNS, ROWS, OPTIONS)
    table = load_table(path)
    assert table.suite == "hard"
    assert table.columns == COLUMNS
    assert table.options == OPTIONS
    assert [list(row) for row in table.rows] == [[column.name for column in COLUMNS]] * 3
    assert [row["method"] for row in table.rows] == [row["method"] for row in ROWS]
    assert [row["level"] for row in table.rows] == [4, -3, 2**60]
    assert [row["passed"] for row in table.rows] == [True, False, False]
    first, second, third = (row["tick_p50"] for row in table.rows)
    assert (first, third) == (2.5e-5, 1.0)
    assert isinstance(second, float)
    assert math.isnan(second)
    assert {type(row["passed"]) for row in table.rows} == {bool}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.h5"]


def test_the_file_says_what_a_result_says_of_its_origin(tmp_path: Path) -> None:
    write_table(tmp_path / "a.h5", "hard", COLUMNS, ROWS, OPTIONS)
    with h5py.File(tmp_path / "a.h5") as file:
        attributes = dict(file.attrs)
        assert (attributes["format"], attributes["schema_version"], attributes["complete"]) == ("hhsim-bench", 1, 1)
        assert {"hhsim_version", "git_revision", "git_dirty", "created_utc"} < attributes.keys()
        assert json.loads(attributes["machine"])["cores"] > 0
        assert "numpy" in json.loads(attributes["packages"])
        assert set(file) == {column.name for column in COLUMNS}
        for column in COLUMNS:
            found = file[column.name].attrs
            assert (found["units"], found["long_name"]) == (column.unit or "1", column.says)


def test_a_table_may_have_no_rows_and_a_column_no_numbers(tmp_path: Path) -> None:
    write_table(tmp_path / "a.h5", "hard", COLUMNS, [], {})
    assert load_table(tmp_path / "a.h5").rows == ()
    write_table(tmp_path / "a.h5", "hard", [Column("x", "a number")], [{"x": None}, {"x": None}], {})
    assert all(math.isnan(float(row["x"])) for row in load_table(tmp_path / "a.h5").rows)


def test_what_is_no_table_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_text("thesis")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.attrs["format"] = "hhsim-result"
    (tmp_path / "c.csv").write_text("thesis")
    (tmp_path / "d.csv").mkdir()
    for name, message in (
        ("a.h5", "no table"),
        ("b.h5", "no table"),
        ("c.h5", r"c\.csv exists"),
        ("d.h5", r"d\.csv is a folder"),
        ("a.csv", "must end in .h5"),
        ("none/a.h5", "no folder"),
    ):
        with pytest.raises(OutputError, match=message):
            check_table_path(tmp_path / name)
        with pytest.raises(OutputError, match=message):
            write_table(tmp_path / name, "hard", COLUMNS, ROWS, OPTIONS)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "b.h5", "c.csv", "d.csv"]
    assert (tmp_path / "a.h5").read_text() == "thesis"


def test_files_that_are_no_table_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with pytest.raises(InputError, match="no such file"):
        load_table(path)
    path.write_text("thesis")
    with pytest.raises(InputError, match="no readable table"):
        load_table(path)
    path.unlink()
    for attribute, value, message in (("format", "hhsim-tree", "hhsim-tree"), ("schema_version", 2, "version 2")):
        write_table(path, "hard", COLUMNS, ROWS, {})
        with h5py.File(path, "a") as file:
            file.attrs[attribute] = value
        with pytest.raises(InputError, match=message):
            load_table(path)
        path.unlink()
        csv_path(path).unlink()
    write_table(path, "hard", COLUMNS, ROWS, {})
    with h5py.File(path, "a") as file:
        del file["level"]
    with pytest.raises(InputError, match="level"):
        load_table(path)
