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

    def begin(program: str, setup: int = 0) -> ChildProcess:
        (tmp_path / "child_program.py").write_text(program)
        started.append(ChildProcess("child", "child_program", setup, []))
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


def test_it_inherits_its_descriptors_and_leads_a_session_of_its_own(start: Start) -> None:
    descriptor = os.memfd_create("test")
    child = start("import os, sys\nos.write(int(sys.argv[2]), f'{os.getsid(0)} {os.getpid()}'.encode())", descriptor)
    assert child.wait(60.0)
    assert child.code == 0
    assert os.pread(descriptor, 100, 0) == f"{child.pid} {child.pid}".encode()
    assert os.getsid(0) != child.pid
    os.close(descriptor)


def test_nothing_is_imported_from_where_the_command_was_typed(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "clones" / "hhsim").mkdir(parents=True)
    (tmp_path / "clones" / "signal.py").write_text("raise SystemExit('not this one')\n")
    monkeypatch.chdir(tmp_path / "clones")
    child = start("import signal\nfrom hhsim import __version__")
    assert child.wait(60.0)
    assert (child.code, child.last_line()) == (0, "")
