"""Tables: where a column has its values, how they are shown, what files say of units, and what they never replace."""

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hhsim.errors import OutputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.table.file import check_table_path, write_table
from hhsim.table.table import (
    UNITS,
    Column,
    Table,
    markdown_text,
    number,
    plain_text,
    shown,
    stored_unit,
    unit_size,
    words,
)
from hhsim.table.terminal import terminal_text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        ("as it is", 2, "as it is"),
        (True, None, "yes"),
        (None, 1, "—"),
        (math.nan, None, "—"),
        (1234.567, 1, "1,234.6"),
        (-1e-9, 2, "0.00"),
        (1234567, None, "1,234,567"),
        (20000.0, None, "20,000"),
        (1.23456, None, "1.235"),
        (math.inf, None, "inf"),
        (np.float64(0.5), 2, "0.50"),
        (np.int64(7), None, "7"),
    ],
)
def test_a_value_is_shown_short(value: Any, digits: int | None, text: str) -> None:
    assert shown(value, digits) == text


def test_headings_have_the_unit_that_is_shown_and_files_the_stored_one() -> None:
    table = Table((words("name"), number("time", "time", "µs", 1), number("count")), [])
    assert table.headings == ["name", "time [µs]", "count"]
    assert table.csv() == "name,time [s],count\n"
    assert (stored_unit("mm"), unit_size("mm"), stored_unit("N"), stored_unit("")) == ("m", 1e-3, "N", "1")


def test_every_unit_of_a_run_metric_is_an_si_unit_or_one_that_is_known() -> None:
    assert {metric.unit for metric in run_metrics().values()} <= UNITS.keys() | {"N", "%", "s"}


def test_numbers_of_a_csv_file_come_back_bit_for_bit() -> None:
    rows = [{"name": 'a, "b"', "value": 0.1 + 0.2, "flag": True}, {"name": "", "value": math.nan, "flag": None}]
    table = Table((words("name"), number("value", digits=1), Column("flag")), rows)
    first, second = csv.DictReader(io.StringIO(table.csv()))
    assert (first["name"], float(first["value"]), first["flag"]) == ('a, "b"', 0.1 + 0.2, "1")
    assert second == {"name": "", "value": "", "flag": ""}
    assert table.records[0] == rows[0]


@pytest.mark.parametrize("command", ["\x1b[2J", "\x1b]0;owned\x07", "\x9b31m", "\x7f", "\u202e", "\udc9b"])
def test_what_commands_a_terminal_is_spelled(command: str) -> None:
    table = Table.of_cells([f"na{command}me"], [[f"a{command}b"]], f"title{command}")
    for text in (plain_text(f"a{command}"), terminal_text(table, in_terminal=False), table.markdown()):
        assert command[0] not in text and ascii(command[0])[1:-1] in text.replace("&#92;", "\\")
    assert plain_text("a\tb\n\u00b5m \udcff") == "a\tb\n\u00b5m \udcff"


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ('=HYPERLINK("x")', '\'=HYPERLINK("x")'),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("-2+3", "'-2+3"),
        ("-2.5", "-2.5"),
        ("-", "-"),
        (-1.5, "-1.5"),
        ("a=b", "a=b"),
    ],
)
def test_no_cell_of_a_csv_file_is_a_formula(cell: Any, written: str) -> None:
    heading, row = csv.reader(io.StringIO(Table.of_cells([str(cell)], [[cell]]).csv()))
    assert heading == row == [written]


def test_markdown_has_no_link_and_no_tag_of_a_file() -> None:
    text = markdown_text("<b>[x](javascript:1) ![y](http://z) a\\|b [mm]")
    assert text == "&lt;b>\\[x](javascript:1) !\\[y](http://z) a&#92;\\|b [mm]"


def test_a_table_of_markdown_aligns_numbers_and_escapes_the_rest() -> None:
    table = Table((words("na|me"), number("n")), [{"na|me": "a_b <c>", "n": 1234}])
    assert table.markdown() == "| na\\|me | n |\n|---|---:|\n| a\\_b &lt;c> | 1,234 |"


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
