"""A process of a session as its supervisor sees it."""

import itertools
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hhsim.live.processes import LOOK, ChildProcess

Start = Callable[..., ChildProcess]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    started = []

    def begin(program: str) -> ChildProcess:
        (tmp_path / "child_program.py").write_text(program)
        started.append(ChildProcess("child", "child_program", 0, []))
        return started[-1]

    yield begin
    for child in started:
        child.send(signal.SIGKILL)
        child.wait(10.0)
        child.close()


def test_a_long_output_is_cut_and_never_blocks_it(start: Start) -> None:
    child = start("print('x' * 10_000_000)\nprint('the end')\n1 / 0")
    assert child.wait(60.0)
    assert child.last_line() == "ZeroDivisionError: division by zero"


def test_what_it_has_done_begins_its_time_anew(start: Start) -> None:
    child = start("import time\ntime.sleep(60)")
    looks = itertools.count()
    assert not child.wait(2.0 * LOOK, lambda: min(next(looks), 6))
    assert child.running and next(looks) > 7


def test_nothing_is_imported_from_where_the_command_was_typed(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "clones" / "hhsim").mkdir(parents=True)
    (tmp_path / "clones" / "signal.py").write_text("raise SystemExit('not this one')\n")
    monkeypatch.chdir(tmp_path / "clones")
    child = start("import signal\nfrom hhsim import __version__")
    assert child.wait(60.0)
    assert (child.code, child.last_line()) == (0, "")
