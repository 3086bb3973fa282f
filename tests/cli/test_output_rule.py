"""The rule for outputs, held by every command: none replaces an input, goes through a link, or another kind of file."""

import ast
import importlib
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import pytest

from hhsim.errors import HhsimError, OutputError
from hhsim.repair.repair import repair_both_hands, repair_recording
from hhsim.repair.request import PICTURE, REPORT, RESULT, RepairRequest
from hhsim.report.report import Report, write_report
from hhsim.system.atomic_write import new_files, partial_file, write_together
from hhsim.system.output_path import check_output_path, check_picture, keeping
from hhsim.table.file import check_table_path
from hhsim.view.sink import MAGIC

# As the commands import it: of hhsim.cli, not of the folder.
written: Any = importlib.import_module("hhsim.cli.arguments.command")
COMMANDS: list[Any] = [
    found
    for found in importlib.import_module("tools.cli_reference").commands()
    if not isinstance(found.command, click.Group)
]
PROJECT = Path(__file__).parents[2]
PRECIOUS = b"\x89PNG\r\n\x1a\nnobody has it twice"
WRITES = re.compile(r"\b([Ww]rit(e|ten)|[Dd]raw|Picture|[Oo]utput file|a film|Folder of the results|Keep the|Record\b)")
READ_ALL_THE_SAME = {
    "--self-contact": "keeps fingers out of each other",
    "--as": "says in which format OUT is",
    "--baseline": "is compared with",
}
"""Options whose help speaks of writing, and that name no output."""
OPENS = re.compile(r"write_(text|bytes)|touch|to_csv|savez|copyfile|open\(|File\(")
"""In the text of a module that may open a file to write."""
WRITERS = {
    "hhsim/system/atomic_write.py": "the writers that all others use",
    "hhsim/result/writer.py": "a result grows in a file that was not there",
    "hhsim/result/labelled.py": "into a partial file",
    "hhsim/submissions/scene_folder.py": "into a new folder",
    "hhsim/kernels/kernel_cache.py": "a kernel beside its own, whose place it takes when it is whole",
    "hhsim/sweep/repair_batch.py": "the null device",
    "hhsim/recordings/formats/hhsim.py": "an image in memory",
    "hhsim/system/checksummed_file.py": "adds the seal to a file that was just written",
    "hhsim/live/processes.py": "memory, no file",
    "hhsim/live/real_time.py": "the system's, not the user's",
    "cli/repair.py": "lines as they come, into a file that was not there",
}
"""Modules that open a file to write by themselves, and why none of these replaces anything."""


def outputs() -> Iterator[Any]:
    for found in COMMANDS:
        for parameter in found.command.params:
            if isinstance(parameter.type, written.WrittenPath):
                yield pytest.param(found.command, parameter, id=f"{found.path} {parameter.opts[0]}")


def test_every_command_holds_it_and_every_option_says_whether_it_writes() -> None:
    assert {"hhsim replay --out", "hhsim view --rerun"} < {case.id for case in outputs()}
    for found in COMMANDS:
        assert isinstance(found.command, written.Command), found.path
        for parameter in found.command.params:
            text, name = getattr(parameter, "help", "") or "", f"{found.path} {parameter.opts[0]}"
            writes = isinstance(parameter.type, written.WrittenPath)
            if not getattr(parameter, "is_flag", False) and parameter.opts[0] not in READ_ALL_THE_SAME:
                assert writes or not WRITES.search(text), name
            assert not writes or parameter.opts[0] not in READ_ALL_THE_SAME, name


def _words(command: click.Command, output: click.Parameter, given: str, named: str) -> list[str]:
    """A line of a command that names an input wherever it takes one, and an output."""
    words = []
    for parameter in command.params:
        if isinstance(parameter, click.Argument) and parameter is not output:
            words.append(given)
        elif parameter.required and parameter is not output:
            words += [parameter.opts[0], given]
    return [*words, named] if isinstance(output, click.Argument) else [*words, output.opts[0], named]


@pytest.mark.parametrize(("command", "output"), list(outputs()))
def test_neither_a_link_nor_an_input_is_replaced(
    command: click.Command, output: click.Parameter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["hhsim"])
    # A film, a viewer's recording or a picture would be replaced by one of its kind: the rule alone keeps it.
    suffix = next(
        (each for each in (".rrd", ".gif", ".png") if each in f"{output.make_metavar(click.Context(command))}"), ".png"
    )
    content = MAGIC + PRECIOUS if suffix == ".rrd" else PRECIOUS
    given, link, same = (Path(f"{name}{suffix}") for name in ("input", "link", "same"))
    given.write_bytes(content)
    link.symlink_to(given)
    os.link(given, same)
    takes = any(isinstance(each, click.Argument) and each is not output for each in command.params)
    for named, said in ((link, "is a symbolic link"), (given, "is an input"), (same, "same file as the input")):
        if named != link and not takes:
            continue
        with pytest.raises(OutputError, match=said):
            command.main(_words(command, output, str(given), str(named)), standalone_mode=False)
        assert (given.read_bytes(), given.stat().st_nlink, link.is_symlink()) == (content, 2, True)
    assert {path.name for path in Path().iterdir()} == {given.name, link.name, same.name}


Check = Callable[[Path], object]


def _repair(both: bool) -> Check:
    request = RepairRequest(Path("grasp.npz"), "sphere", Path("free.npz"))
    return lambda _: (repair_both_hands if both else repair_recording)(request)


@pytest.mark.parametrize(
    ("check", "beside"),
    [
        *((_repair(both=False), f"free{name}") for name in (".npz", f"-{RESULT}", f"-{REPORT}", f"-{PICTURE}")),
        *((_repair(both=True), f"free{name}") for name in (".npz", f"-right-{REPORT}", f"-left-{RESULT}")),
        (lambda _: check_table_path(Path("table.json")), "table.csv"),
        (lambda _: write_report(Report("", "", {"hand": b""}, (), ()), Path("page.html")), "page-hand.png"),
        (check_picture, "picture.png"),
        (check_output_path, "output.npz"),
    ],
)
def test_a_file_beside_an_output_is_none_that_exists(
    check: Check, beside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("grasp.npz").write_bytes(b"")
    Path(beside).symlink_to("mesh.stl")
    for content, said in ((None, f"{beside} is a symbolic link"), (b"other", f"{beside} exists")):
        if content:
            Path(beside).unlink()
            Path(beside).write_bytes(content)
        with pytest.raises(OutputError, match=said):
            check(Path(beside))
        assert {path.name for path in Path().iterdir()} == {"grasp.npz", beside}
        assert content is None or Path(beside).read_bytes() == content


def test_writers_keep_inputs_and_links_that_nobody_checked(tmp_path: Path) -> None:
    given, link, other = (tmp_path / name for name in ("given", "link", "other"))
    given.write_bytes(b"given")
    link.symlink_to(given)
    with keeping([given]):
        for path in (given, link):
            with pytest.raises(OutputError):
                write_together({other: b"new", path: b"new"})
            with pytest.raises(OutputError), partial_file(path):
                pass
    write_together({given: b"new"})
    assert given.read_bytes() == b"new" and sorted(tmp_path.iterdir()) == [given, link]


def test_new_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    first, last = tmp_path / "a.csv", tmp_path / "b.h5"
    for fault in ("the disk is full", ""):
        last.write_bytes(b"" if fault else b"somebody was faster")
        with pytest.raises(HhsimError) as caught, new_files(first) as folder:
            (folder / first.name).write_bytes(b"1")
            (folder / last.name).write_bytes(b"2")
            if fault:
                raise OutputError(f"cannot write {folder / last.name}: {fault}")
        assert f"{last}" in str(caught.value)
        assert list(tmp_path.iterdir()) == [last]


def test_no_other_module_opens_a_file_to_write() -> None:
    found = {}
    for path in (*PROJECT.glob("hhsim/**/*.py"), *PROJECT.glob("cli/**/*.py")):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if OPENS.search(text) else ():
            if isinstance(node, ast.Call) and _opens_to_write(node):
                found[path.relative_to(PROJECT).as_posix()] = node.lineno
    assert found.keys() == WRITERS.keys(), found


def _opens_to_write(call: ast.Call) -> bool:
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    if name in ("write_text", "write_bytes", "touch", "to_csv", "savez", "savez_compressed", "copyfile"):
        # Into memory or a stream.
        return not (call.args and getattr(call.args[0], "id", "") in ("image", "out"))
    modes = [each.value for each in call.args if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    return name in ("open", "fdopen", "File") and any(re.fullmatch(r"[wax]b?\+?|r\+b?", mode) for mode in modes)
