"""Every suite by one command: what it refuses, prints, writes and keeps."""

import json
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from conftest import Run

from hhsim.bench import suite as module
from hhsim.bench import suites
from hhsim.bench.plan import SUITES, suite_lines
from hhsim.bench.suite import run_tasks_of
from hhsim.errors import InputError, OutputError

REFUSED: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("speed-error", {"objects": ("buny",)}, "unknown object 'buny': did you mean bunny"),
    ("speed-error", {"motions": ("grip",)}, "unknown trajectory 'grip'"),
    ("speed-error", {"methods": ("couple",)}, "unknown method 'couple': did you mean coupled"),
    ("speed-error", {"backends": ("quadprg",)}, "unknown QP solver 'quadprg'"),
    ("speed-error", {"surfaces": ("mash",)}, "unknown surface 'mash': did you mean mesh"),
    ("speed-error", {"motions": ("never",)}, "'never' touches nothing"),
    ("speed-error", {"levels": (6,)}, "whole number from 1 to 5"),
    ("speed-error", {"surfaces": (), "methods": ("coupled",)}, "surfaces = .*at least one name"),
    ("speed-error", {"surfaces": ("mesh",), "methods": ("coupled", "paper")}, "takes the surface spheres"),
    ("peers", {"motions": ("never",)}, "touches nothing"),
    ("peers", {"objects": ()}, "objects = .*at least one name"),
    ("paper", {"methods": ("best",)}, "best"),
    ("paper", {"objects": ("mug",)}, "mug"),
    ("paper", {"methods": ()}, "methods = .*at least one name"),
    ("paper", {"repetitions": 0}, "repetitions = 0"),
    ("paper", {"threads": 6}, "= 6; expected a whole number from 1 to 5"),
    ("hard", {"ticks": 10}, "ticks = 10; expected a whole number from 8000"),
)
COMMANDS = (
    ("stress --surface mesh --method paper", "method paper takes the surface spheres, not mesh: "),
    ("stress bunyn", "unknown object 'bunyn': did you mean bunny?"),
    ("speed-error --level 0", "expected whole numbers from 1 to 5 with commas between"),
    ("speed-error --out none/a.json", "there is no folder"),
    ("stress --out x.csv", "x.csv must end in .json: the CSV file of the same name goes beside it"),
    ("hard fast-swip", "unknown hard case 'fast-swip': did you mean fast-swipe?"),
    ("hard flat-finger", "hard case 'flat-finger' is made of triangles alone: it takes --surface mesh"),
    ("hard --method couple", "unknown method 'couple': did you mean coupled?"),
    ("hard --resume .", ". holds other files, and no bench"),
    ("peers --plot a.json", "no picture by its ending"),
    ("stress --size nan", "nan is not in the range"),
    ("paper --quick --plot thesis.parquet", "thesis.parquet"),
)


@pytest.mark.parametrize(("suite", "values", "message"), REFUSED)
def test_impossible_settings_are_refused(suite: str, values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SUITES[suite].planned(**values)


@pytest.mark.parametrize(("words", "message"), COMMANDS)
def test_a_command_refuses_before_the_work(run: Run, tmp_path: Path, words: str, message: str) -> None:
    (tmp_path / "thesis.parquet").write_text("no programs")
    answer = run("bench", *words.split())
    assert (answer.code, answer.out) == (2, "") and message in answer.err
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["thesis.parquet"]


PLAN = """
line = "Doubles of numbers."
help = "Double numbers."
shown = "number twice=double"

[options]
numbers = { default = [1, 2, 3], help = "Numbers." }
repetitions = { default = 1, help = "Repetitions." }
table = { help = "Table of numbers.", metavar = "FILE" }

[preset]
flag = "quick"
help = "One number."
values = { numbers = [7] }

[figures]
number = "a number"
twice = { says = "twice as much", unit = "mm" }
times = "how often"
"""
DOUBLES = """
from dataclasses import dataclass

from hhsim.bench.suite import Suite
from hhsim.system.settings_file import Count
from hhsim.table.table import Column, Table


@dataclass(frozen=True, kw_only=True)
class Doubles(Suite):
    numbers: tuple[Count, ...]
    repetitions: Count
    table: str | None
    is_portable = True

    def cells(self, progress):
        return self.numbers

    def run(self, cell, before):
        if cell == 66:
            raise KeyboardInterrupt
        return [{"number": cell, "twice": 2.0 * cell, "times": 1 if before is None else before[0]["times"] + 1}]

    def title(self):
        return "Doubles"

    def missed(self, rows):
        return [f"{row['number']} is unlucky" for row in rows if row["number"] == 13]

    def lines(self, rows):
        return ["all are doubled"]

    def notes(self, figures):
        return ["a note"]

    def listed(self):
        return Table((Column("number", of=lambda number: number),), self.numbers)


SUITE = Doubles
"""


@pytest.fixture(scope="module")
def doubles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a suite: a module and its plan."""
    folder = tmp_path_factory.mktemp("suites")
    (folder / "doubles.py").write_text(DOUBLES.lstrip())
    (folder / "doubles.toml").write_text(PLAN)
    return folder


@pytest.fixture
def bench(run: Run, doubles: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Run the command of the suite of doubles, which is there like those that ship."""
    monkeypatch.setattr(suites, "__path__", [*suites.__path__, str(doubles)])
    module._cells.cache_clear()
    return lambda *words: run("bench", "doubles", *words)


def test_a_suite_is_a_module_and_a_plan(bench: Callable[..., Any], tmp_path: Path) -> None:
    assert suite_lines()["doubles"] == "Doubles of numbers."
    assert "--numbers NUMBERS" in bench("--help").out
    # What a file holds is a part of the settings that name it.
    for content in ("a", "a", "b"):
        (tmp_path / "table.txt").write_text(content)
        assert bench("--table", "table.txt", "--resume", "of_files", "--quiet").code == 0
    assert len(list((tmp_path / "of_files").glob("*.json"))) == 1 + 2 * 3


def test_a_suite_has_one_table_for_people_files_and_programs(bench: Callable[..., Any], tmp_path: Path) -> None:
    answer = bench("--out", "a.json", "--numbers", "4,5", "--repetitions", "3")
    assert answer.code == 0
    assert [" ".join(line.split()) for line in answer.out.splitlines() if "──" not in line] == [
        *("Doubles", "number double [mm]", "4 8,000", "5 10,000", "", "all are doubled"),
        "the table is in a.json and a.csv",
    ]
    assert answer.err.splitlines()[-1] == "hhsim: note: a note"
    table = json.loads((tmp_path / "a.json").read_text())
    assert (table["suite"], table["options"]) == ("doubles", {"numbers": [4, 5], "repetitions": 3, "table": None})
    assert table["rows"] == [{"number": n, "twice": 2.0 * n, "times": 3} for n in (4, 5)]
    assert (tmp_path / "a.csv").read_text().splitlines()[:2] == ["number,twice [m],times", "4,8.0,3"]
    document = json.loads(bench("--out", "a.json", "--json", "--quick").out)
    assert document["options"]["numbers"] == [7] and document["units"]["twice"] == "m"
    assert document["rows"] == [{"number": 7, "twice": 14.0, "times": 1}]
    assert (document["missed"], document["notes"], document["table"]) == ([], ["a note"], "a.json")
    assert json.loads(bench("--quick", "--numbers", "9", "--json").out)["options"]["numbers"] == [9]


def test_a_missed_bar_is_exit_code_1_and_quiet_says_nothing(bench: Callable[..., Any]) -> None:
    loud, quiet = bench("--numbers", "13"), bench("--numbers", "13", "--quiet")
    assert (loud.code, quiet.code, quiet.out, quiet.err) == (1, 1, "", "")
    assert "missed: 13 is unlucky" in loud.out.splitlines()
    listed = bench("--list")
    assert listed.code == 0 and listed.out.split()[2:] == ["1", "2", "3"]
    assert json.loads(bench("--list", "--json").out)["rows"] == [{"number": n} for n in (1, 2, 3)]


def test_an_interrupt_keeps_the_cells_that_are_done(bench: Callable[..., Any], tmp_path: Path) -> None:
    answer = bench("--numbers", "4,66,5", "--out", "table.json")
    assert (answer.code, answer.out) == (130, "")
    assert "interrupted; what ran so far, 1 in all, is in table.json" in answer.err
    assert [row["number"] for row in json.loads((tmp_path / "table.json").read_text())["rows"]] == [4]


def test_cells_that_are_kept_are_not_run_again(
    bench: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = bench("--numbers", "4,5", "--resume", "kept", "--json")
    (done, _) = sorted(path for path in (tmp_path / "kept").glob("*.json") if path.name != module.MARK)
    done.write_text(json.dumps([{"number": 4, "twice": 0.5, "times": 1}]))
    again = json.loads(bench("--numbers", "4,5", "--resume", "kept", "--json").out)
    assert json.loads(first.out)["rows"][0]["twice"] == 8.0
    assert 0.5 in [row["twice"] for row in again["rows"]]
    other = json.loads(bench("--numbers", "4,5", "--repetitions", "2", "--resume", "kept", "--json").out)
    assert 0.5 not in [row["twice"] for row in other["rows"]], "other settings are another bench"


@pytest.mark.soak
def test_processes_give_the_rows_of_one(tmp_path: Path) -> None:
    suite = SUITES["hard"].planned(cases=("never-touches", "too-many-pairs"), methods=("coupled",))
    alone = run_tasks_of(suite, folder=tmp_path / "one")
    assert repr(run_tasks_of(suite, jobs=2)) == repr(alone)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds other files"):
        run_tasks_of(suite, folder=tmp_path / "other")


def test_every_suite_has_a_line_and_a_plan_of_its_settings() -> None:
    assert list(suite_lines()) == SUITES.names() and all(line.endswith(".") for line in suite_lines().values())
    for suite in SUITES.values():
        assert {field.name for field in fields(suite)} == set(suite.plan().options)
        assert suite.planned() == suite.planned() and suite.planned(is_preset=True)
        assert len({column.name for column in suite.columns()}) == len(suite.columns())
