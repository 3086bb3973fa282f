"""The command line as users meet it: its entry point, run as a process of its own or inside the test."""

import errno
import importlib
import importlib.metadata
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from conftest import Run
from own_command import HHSIM

import hhsim
from hhsim.errors import InputError
from hhsim.trees.file import load_tree
from hhsim.trees.foreign_tree import load_sph

(POINT,) = importlib.metadata.entry_points(group="console_scripts", name="hhsim")
entry = importlib.import_module(POINT.module)
COMMANDS: dict[str, str] = entry.COMMANDS


def test_help_imports_nothing_that_is_slow() -> None:
    script = (
        "import sys; sys.argv = ['hhsim', '--help']\n"
        "from hhsim.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: print(*sorted(name for name in sys.modules if '.' not in name), file=sys.stderr)"
    )
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    loaded = set(answer.stderr.split())
    assert "click" in loaded
    slow = {"numpy", "numba", "rich", "trimesh", "h5py", "scipy", "matplotlib", "rerun", "qpsolvers", "msgspec"}
    assert loaded.isdisjoint(slow)


def test_help_lists_every_command_on_a_line(run: Run) -> None:
    answer = run("--help")
    assert answer.code == 0
    assert answer.err == ""
    for name, line in COMMANDS.items():
        assert any(row.split(maxsplit=1) == [name, line] for row in answer.out.splitlines()), name
    assert run().out == answer.out
    assert all(len(row) <= 80 for row in answer.out.splitlines())


def test_the_version_is_that_of_the_package(run: Run) -> None:
    assert run("--version") == (0, f"hhsim {hhsim.__version__}\n", "")


def test_every_command_explains_itself(repository: Path) -> None:
    context, page = click.Context(entry.hhsim), (repository / "docs" / "cli.md").read_text(encoding="utf-8")
    for name, line in COMMANDS.items():
        command = entry.hhsim.get_command(context, name)
        assert command.get_short_help_str(limit=200) == line, name
        assert f"hhsim {name}" in page


def test_machines_get_an_error_as_a_document(run: Run) -> None:
    answer = run("repllay", "--json")
    assert answer.document(2) == {"error": "unknown command 'repllay': did you mean replay?"}
    assert answer.err.startswith("hhsim: error: ")


NOTE = "the 30 ticks so far are in run.h5 (complete = 0)"
NOTED, STOPPED = InputError("the glove\nwent away"), KeyboardInterrupt()
for raised in (NOTED, STOPPED):
    raised.add_note(NOTE)
FULL = errno.ENOSPC, os.strerror(errno.ENOSPC)
LESS = "; raise a limit that is set (ulimit -v), or use less"
NO_MEMORY = MemoryError("Unable to allocate 7.28 TiB for an array")


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (NOTED, 2, f"error: the glove went away; {NOTE}"),
        (OSError(*FULL, "/cache/kernel.nbi"), 2, f"error: {FULL[1]}: /cache/kernel.nbi"),
        (OSError(*FULL), 2, "stdout, or the cache in /cache, for which HHSIM_CACHE_DIR names another folder"),
        (NO_MEMORY, 2, f"error: not enough memory: {NO_MEMORY}{LESS}"),
        (MemoryError(f"{NO_MEMORY} and data type {{'names': ['pose', 'safe']"), 2, f"{NO_MEMORY}{LESS}"),
        (MemoryError(), 2, f"error: not enough memory{LESS}"),
        (RuntimeError("can't start new thread"), 2, f"error: not enough memory: can't start new thread{LESS}"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 2, f"[Errno 12] Cannot allocate memory{LESS}"),
        (STOPPED, 130, f"interrupted; {NOTE}"),
    ],
)
def test_an_error_is_told_in_one_line_with_its_notes(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, line: str
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr(entry.hhsim, "invoke", fail)
    monkeypatch.setenv("HHSIM_CACHE_DIR", "/cache")
    answer = run("info")
    assert (answer.code, answer.out, answer.err.count("\n")) == (code, "", 1)
    assert answer.err.startswith("hhsim: ") and answer.err.endswith(f"{line}\n")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(["info"], ""), (["repllay", "--json"], "hhsim: error: unknown command 'repllay': did you mean replay?\n")],
)
def test_a_reader_that_leaves_is_no_error(arguments: list[str], told: str) -> None:
    process = subprocess.Popen([*HHSIM, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.close()
    errors = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 128 + signal.SIGPIPE
    assert errors == told


def test_numbers_that_json_lacks_are_null(capsys: pytest.CaptureFixture[str]) -> None:
    importlib.import_module("hhsim.cli.console").print_json({"a": math.nan, "b": [-math.inf, (np.float64("nan"), 1.5)]})
    assert json.loads(capsys.readouterr().out, parse_constant=pytest.fail) == {"a": None, "b": [None, [None, 1.5]]}


@pytest.mark.parametrize("host", ["pypi.org", "192.0.2.1"])
def test_no_command_that_tests_run_asks_another_machine(run: Run, monkeypatch: pytest.MonkeyPatch, host: str) -> None:
    # `run` holds it of every command; here it finds one.
    event = ("socket.getaddrinfo", host) if "org" in host else ("socket.connect", None, (host, 443))
    monkeypatch.setattr(entry.hhsim, "invoke", lambda _: sys.audit(*event))
    with pytest.raises(AssertionError, match=host):
        run("info")


@pytest.mark.parametrize(
    ("redirection", "code", "out", "err"),
    [
        pytest.param(">&-", 0, "", "", marks=pytest.mark.soak),
        pytest.param("2>&-", 0, "name", "", marks=pytest.mark.soak),
        ("<&- >&- 2>&-", 0, "", ""),
        ("> /dev/full", 2, "", "hhsim: error: No space left on device: stdout, or the cache in "),
    ],
)
def test_a_stream_that_is_closed_or_full_is_no_crash(redirection: str, code: int, out: str, err: str) -> None:
    if "/dev/full" in redirection and not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    command = ["sh", "-c", f'"$@" {redirection}', "sh", *HHSIM, "objects"]
    answer = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert answer.returncode == code, answer.stderr
    assert answer.stdout.startswith(out) and bool(answer.stdout) == bool(out)
    assert err in answer.stderr and len(answer.stderr.splitlines()) == bool(err)


def test_an_encoding_without_our_letters_is_no_crash(run: Run) -> None:
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    table = subprocess.run([*HHSIM, "objects"], capture_output=True, text=True, env=environment)
    assert (table.returncode, table.stderr) == (0, "")
    assert " ? " in table.stdout
    document = run("objects", "--json").out
    assert document.isascii() and len(json.loads(document)["objects"]) == 11


def test_info_tells_people_and_machines_the_same_and_each_thing_once(run: Run) -> None:
    document, table = run("info", "--json").document(), run("info")
    assert (table.code, table.err) == (0, "")
    for value in (document["hhsim"], document["machine"]["cpu"], document["packages"]["numpy"]):
        assert value in table.out
    names = [line.split()[0] for line in table.out.splitlines()[2:]]
    assert names.count("hhsim") == names.count("numpy") == 1


@pytest.mark.parametrize("command", ["objects", "trajectories"])
def test_a_catalogue_tells_people_and_machines_the_same(run: Run, command: str) -> None:
    items = run(command, "--json").document()[command]
    lines = run(command).out.splitlines()[2:]
    assert [line.split()[0] for line in lines] == [item["name"] for item in items]
    assert len(items) >= 10 and all(item["title"] in line for item, line in zip(items, lines))


def test_the_examples_are_copied_to_a_new_folder_as_they_are(run: Run, repository: Path, tmp_path: Path) -> None:
    answer = run("examples", "mine")
    assert (answer.code, answer.err) == (0, "") and "mine/README.md says what each shows" in answer.out
    copied = {path.relative_to(tmp_path / "mine"): path for path in (tmp_path / "mine").rglob("*") if path.is_file()}
    tracked = {path for path in (repository / "examples").rglob("*") if path.is_file() and "__" not in str(path)}
    assert {repository / "examples" / name for name in copied} == tracked
    assert all(path.read_bytes() == (repository / "examples" / name).read_bytes() for name, path in copied.items())
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    answer = run("examples", "mine")
    assert answer.code == 2 and "mine exists, so nothing is written there: name a new folder" in answer.err


def test_a_tree_is_built_measured_written_and_drawn(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.render.spheres_figure.PIXELS", 100)
    document = run("build-tree", "cube", "--level", "2", "--out", "cube.h5", "--plot", "c.png", "--json").document()
    assert document["plot"] == "c.png" and (tmp_path / "c.png").stat().st_size > 10_000
    tree = load_tree(tmp_path / "cube.h5")
    assert document["leaves"] == tree.leaf_count <= 64
    assert [level["spheres"] for level in document["levels"]] == [error.spheres for error in tree.errors]
    assert all(level["gap_max"] == 0.0 for level in document["levels"])
    table = run("build-tree", "cube", "--level", "2", "--out", "cube.sph")
    assert f"{tree.leaf_count:,} leaves" in table.out
    assert load_sph(tmp_path / "cube.sph").leaf_count == tree.leaf_count
    assert run("build-tree", "cube", "--level", "1", "--out", "cube.sph", "--quiet") == (0, "", "")
    assert run("build-tree", "cube", "--level", "1", "--quiet").out == ""
    assert len(list((tmp_path / "results").glob("*-cube-tree-1.h5"))) == 1


@pytest.mark.soak
def test_trees_of_so_many_leaves_or_within_an_error(run: Run, tmp_path: Path) -> None:

    document = run("build-tree", "cube", "--leaves", "100", "--json", "--threads", "2").document()
    assert (document["leaves"], document["proved"], document["faults"]) == (100, True, [])
    assert run("build-tree", "cube", "--leaves", "100", "--json").document()["cached"]
    answer = run("build-tree", "cube", "--max-error", "9mm", "--cover", "balanced", "--out", "cube.h5")
    tree = load_tree(tmp_path / "cube.h5")
    assert tree.options["max_error"] == pytest.approx(9e-3)
    assert max(tree.covers[-1].bound, tree.covers[-1].gap) <= tree.options["max_error"]
    assert "the fewest spheres that were found within 9 mm" in answer.out
    assert f"no part of the mesh is farther than {1e3 * tree.covers[-1].gap:.3f} mm outside of the leaves" in answer.out
    wrong = run("build-tree", "cube", "--max-error", "1um", "--level", "1")
    assert wrong.code == 2 and "no cover of up to 8 spheres is within 0.001 mm" in wrong.err


def test_compilation_is_announced_where_and_when_it_happens(capsys: pytest.CaptureFixture[str]) -> None:
    from hhsim.kernels.jit import jit

    announce_compilation = importlib.import_module("hhsim.cli.console").announce_compilation

    @click.command()
    @click.option("--quiet", is_flag=True)
    def command(quiet: bool) -> None:
        announce_compilation(quiet=quiet)
        print("begun", file=sys.stderr)
        for number in (1, 2):
            jit(lambda number=number: number)()

    announcement = "hhsim: compiling the kernels that this needs: once, and again after an upgrade"
    for arguments, lines in (([], ["begun", announcement]), (["--quiet"], ["begun"])):
        command(arguments, standalone_mode=False)
        jit(lambda: 3)()
        assert capsys.readouterr().err.splitlines() == lines


@pytest.mark.parametrize(
    ("words", "offered"),
    [("hhsim repl", "replay"), ("hhsim build-tree te", "teapot"), ("hhsim build-tree cube --bran", "--branching")],
)
def test_the_shell_is_offered_commands_names_and_options(
    run: Run, monkeypatch: pytest.MonkeyPatch, words: str, offered: str
) -> None:
    monkeypatch.setenv("_HHSIM_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert run() == (0, f"plain,{offered}\n", "")
