"""Tables of figures: their columns, and what becomes of them in text, a terminal and HTML."""

import csv
import importlib
import io
import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Terminal
from hypothesis import given
from hypothesis import strategies as st
from report_reader import read_page

from hhsim.errors import OutputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.table.file import check_table_path, write_table
from hhsim.table.html import environment, render
from hhsim.table.table import (
    UNITS,
    Column,
    Marked,
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


STYLE = render("report/style.css")
NASTY = '</td><script>alert("x")</script>&amp; \' "'


def filled(template: str, **values: Any) -> str:
    """A template of a few words with values in it."""
    return environment().from_string(template).render(values)


def table(headings: list[str], rows: list[list[str]], *, cards: bool = False, title: str = "t") -> str:
    """A table whose second column is of numbers."""
    shown = Table.of_cells(headings, rows, title, numbers=headings[1:2])
    return filled("{% from 'table/parts.html' import table %}{{ table(shown, cards) }}", shown=shown, cards=cards)


@given(st.text())
def test_text_comes_back_as_it_was(text: str) -> None:
    page = filled('<p title="{{ text }}">{{ text }}</p>', text=text)
    read = read_page(page).one("p")
    # A reader of HTML sees every line end as "\n", and none of what no document may hold.
    illegal = "[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]"
    plain = re.sub(illegal, "\N{REPLACEMENT CHARACTER}", text)
    assert read.text == read.attributes["title"] == plain
    assert page.count("<") == 2 and page.encode().decode() == page


@given(st.lists(st.lists(st.text(max_size=8), min_size=2, max_size=2), max_size=4), st.text(max_size=12))
def test_a_table_holds_the_cells_that_it_is_given(rows: list[list[str]], caption: str) -> None:
    found = read_page(table(["one", "two"], rows, title=caption))
    assert found.rows("")[0] == ["one", "two"]
    assert found.rows("")[1:] == [[read_page(filled("<p>{{ c }}</p>", c=c)).one("p").text for c in row] for row in rows]
    assert [cell.attributes["scope"] for cell in found.all("th")] == ["col", "col"] + ["row"] * len(rows)
    assert all(cell.attributes.get("class") == "number" for cell in found.all("td"))


def test_a_marked_cell_has_its_mood_and_the_words_below_it() -> None:
    found = read_page(table(["a", "b"], [["x", Marked("1.5", "bad", NASTY)], ["y", Marked("2")]]))
    assert (found.one("b").text, found.one("b").attributes["class"]) == ("1.5", "bad")
    assert found.one("small").text == NASTY
    assert [cell.text for cell in found.all("td")] == [f"1.5 {NASTY}", "2"]


def test_a_page_says_what_it_is_and_asks_nobody() -> None:
    found = read_page(render("report/page.html", title="T & T", generator="hhsim report", version="1"))
    assert found.one("html").attributes["lang"] == "en"
    assert found.one("title").text == "T & T"
    each = [meta.attributes for meta in found.all("meta")]
    metas = {meta.get("name") or meta.get("http-equiv"): meta for meta in each}
    assert metas["viewport"]["content"] == "width=device-width, initial-scale=1"
    assert metas["generator"]["content"] == "hhsim report 1"
    assert "default-src 'none'" in str(metas["Content-Security-Policy"]["content"])
    assert not found.all("script")


def luminance(color: str) -> float:
    """Relative luminance of WCAG 2.1."""
    values = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


SCHEMES = [dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", block)) for block in re.findall(r"(?s):root \{(.*?)\}", STYLE)]


@pytest.mark.parametrize("colors", SCHEMES, ids=["light", "dark", "paper"])
def test_text_has_contrast_in_every_scheme(colors: dict[str, str]) -> None:
    colors = {**SCHEMES[0], **colors}
    for name in ("ink", "soft", "link", "good", "bad", "note"):
        for ground in ("paper", "band"):
            dark, light = sorted(luminance(colors[which]) + 0.05 for which in (name, ground))
            assert light / dark >= 4.5, f"{name} on {ground}"


def test_the_style_asks_for_nothing_from_outside() -> None:
    assert not any(mark in STYLE for mark in ("url(", "@import", "<"))


console = importlib.import_module("hhsim.cli.console")

WIDE = ("figure", "hhsim", "unit", "paper")
WIDE_ROWS = [
    ("force variation in the hold, trembling hand, mean", "1,234.0570", "% of hold", "310 to ≈ 1,000"),
    ("stuck ticks", "0", "", ""),
]


def in_terminal(monkeypatch: pytest.MonkeyPatch, width: int, table: Table) -> str:
    """A table as a terminal of a width has it."""
    terminal = Terminal()
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", terminal)
        patched.setenv("TERM", "xterm")
        patched.setenv("COLUMNS", str(width))
        console.print_table(table)
    return re.sub(r"\x1b\[[0-9;]*m", "", terminal.getvalue())


@pytest.mark.parametrize("width", [20, 30, 40, 60, 80, 100, 160])
def test_no_number_is_broken_and_no_line_too_long(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    table = replace(Table.of_cells(WIDE, WIDE_ROWS, numbers=("hhsim", "paper")), optional=("paper",))
    text = in_terminal(monkeypatch, width, table)
    assert "1,234.0570" in text
    assert ("310 to ≈ 1,000" in text) == (width >= 60)
    assert all(len(line) <= max(width, 26) for line in text.splitlines())
    for word in ["force", "variation", "in", "the", "hold,", "trembling", "hand,", "mean"]:
        assert word in text, "no word is broken either"


def test_a_row_that_would_be_many_lines_is_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    long = "what it stresses, at length, " * 12
    rows = [("cube", long, "3", ""), ("cup", long, "4", "x")]
    lines = in_terminal(monkeypatch, 40, Table.of_cells(("name", "stresses", "level", "note"), rows)).splitlines()
    assert lines[0] == "cube" and lines.count("") == 1
    assert lines[lines.index("") + 1] == "cup"
    assert "  level     3" in lines
    assert sum(line.startswith("  note") for line in lines) == 1, "an empty cell has no line"
    assert all(len(line) <= 40 for line in lines)


@pytest.mark.parametrize("word", ["", "1"])
def test_no_color_is_heeded(word: str, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    for name, value in {"TERM": "xterm-256color", "COLORTERM": "truecolor", "NO_COLOR": word}.items():
        monkeypatch.setenv(name, value)
    with console.progress(quiet=False) as report:
        report("ticks", 1, 2)
    coloured = re.findall(r"\x1b\[(?:[\d;]*;)?(?:[349]\d|10\d)[\d;]*m", terminal.getvalue())
    assert "ticks" in terminal.getvalue() and bool(coloured) == (word == "")


def test_a_pipe_gets_a_line_of_progress_from_time_to_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "SILENCE", 0.01)
    with console.progress(quiet=True) as report:
        report("ticks", 1, 2)
    with console.progress(quiet=False) as report:
        # The first line is there before anything is reported.
        while not (text := capsys.readouterr().err):
            pass
        report("ticks", 1_000, 2_000)
        while "ticks" not in (later := capsys.readouterr().err):
            pass
    assert re.fullmatch(r"(hhsim: getting ready, 0 s\n)+", text)
    assert "hhsim: ticks: 1,000 of 2,000, 0 s\n" in later


def test_a_pipe_has_no_width(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    console.print_table(Table.of_cells(WIDE, WIDE_ROWS, numbers=("hhsim",)))
    assert len(capsys.readouterr().out.splitlines()) == 4
