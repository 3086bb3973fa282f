"""Tables in terminals of any width: no number is broken, columns go, rows turn into cards."""

import importlib
import re
import sys
from dataclasses import replace

import pytest
from conftest import Terminal

from hhsim.table.table import Table

console = importlib.import_module("hhsim.cli.console")

COLUMNS = ("figure", "hhsim", "unit", "paper")
ROWS = [
    ("force variation in the hold, trembling hand, mean", "1,234.0570", "% of hold", "310 to ≈ 1,000"),
    ("stuck ticks", "0", "", ""),
]


def shown(monkeypatch: pytest.MonkeyPatch, width: int, table: Table) -> str:
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
    table = replace(Table.of_cells(COLUMNS, ROWS, numbers=("hhsim", "paper")), optional=("paper",))
    text = shown(monkeypatch, width, table)
    assert "1,234.0570" in text
    assert ("310 to ≈ 1,000" in text) == (width >= 60)
    assert all(len(line) <= max(width, 26) for line in text.splitlines())
    for word in ["force", "variation", "in", "the", "hold,", "trembling", "hand,", "mean"]:
        assert word in text, "no word is broken either"


def test_a_row_that_would_be_many_lines_is_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    long = "what it stresses, at length, " * 12
    rows = [("cube", long, "3", ""), ("cup", long, "4", "x")]
    lines = shown(monkeypatch, 40, Table.of_cells(("name", "stresses", "level", "note"), rows)).splitlines()
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
    console.print_table(Table.of_cells(COLUMNS, ROWS, numbers=("hhsim",)))
    assert len(capsys.readouterr().out.splitlines()) == 4
