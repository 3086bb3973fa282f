"""A process of a session as its supervisor sees it."""

import itertools
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from hhsim.live import child_process
from hhsim.live.child_process import ChildProcess

Start = Callable[..., ChildProcess]


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    started = []

    def begin(program: str, *arguments: str, descriptors: tuple[int, ...] = ()) -> ChildProcess:
        (tmp_path / "child_program.py").write_text(program)
        started.append(ChildProcess("child", "child_program", arguments, descriptors))
        return started[-1]

    yield begin
    for child in started:
        child.send(signal.SIGKILL)
        child.wait(10.0)
        child.close()


def test_an_error_is_told_by_its_last_line(start: Start) -> None:
    child = start(
        "import sys\nprint('much before')\nprint('hhsim: error: no glove here', file=sys.stderr)\nsys.exit(2)"
    )
    assert child.wait(60.0)
    assert (child.code, child.running) == (2, False)
    assert child.how_it_ended() == "ended with code 2: no glove here"


def test_a_long_output_is_cut_and_never_blocks_it(start: Start) -> None:
    child = start("print('x' * 10_000_000)\nprint('the end')\n1 / 0")
    assert child.wait(60.0)
    assert child.last_line() == "ZeroDivisionError: division by zero"


def test_a_signal_is_told_by_its_name(start: Start) -> None:
    child = start("import time\ntime.sleep(60)")
    assert child.running
    assert child.how_it_ended() == "is running"
    assert not child.wait(0.01)
    child.send(signal.SIGKILL)
    assert child.wait(60.0)
    assert child.how_it_ended() == "was ended by SIGKILL"
    child.send(signal.SIGKILL)


@pytest.mark.parametrize("program", ["time.sleep(60)", "while True:\n    pass"])
def test_its_own_time_is_what_it_computes_and_what_it_sleeps(start: Start, program: str) -> None:
    child = start(f"import time\n{program}")
    looks = itertools.count()
    assert not child.wait_own_time(0.3, lambda: next(looks) > 4)
    assert child.running and next(looks) > 6, "what it has done begins its time anew"


def had(child: ChildProcess, step: float, ran: float, waited: float) -> int:
    """After how many looks its 3 s are over, or a thousand; each is so long, with so much computed and waited [s]."""
    clock, looks = [0.0], [0]

    def look(seconds: float) -> bool:
        looks[0] += 1
        clock[0] += step
        return looks[0] == 1000

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "wait", look)
        patch.setattr(child_process, "_processor_time", lambda process: (ran * looks[0], waited * looks[0]))
        patch.setattr(child_process, "time", SimpleNamespace(monotonic=lambda: clock[0]))
        child.wait_own_time(2.999)
    return looks[0]


def test_time_in_which_others_have_the_processor_is_not_its_own(start: Start) -> None:
    child = start("import time\ntime.sleep(60)")
    assert had(child, step=0.05, ran=0.0, waited=0.0) == 60, "it sleeps"
    assert had(child, step=0.05, ran=0.05, waited=0.0) == 60, "it computes"
    assert had(child, step=0.05, ran=0.01, waited=0.04) == 300, "others have four fifths of its processor"
    assert had(child, step=0.05, ran=0.0, waited=0.05) == 1000, "others have all of it"
    assert had(child, step=0.05, ran=0.0, waited=0.15) == 1000, "three threads wait"
    assert had(child, step=5.0, ran=0.0, waited=0.0) == 30, "who looks had to wait for a processor itself"


def test_what_it_started_has_its_time_with_it(start: Start) -> None:
    program = "import subprocess, sys\nsubprocess.run([sys.executable, '-c', 'while True: pass'])"
    child = start(program)
    until = time.monotonic() + 60.0
    while child_process._processor_time(child.pid)[0] < 0.5:
        assert time.monotonic() < until
        time.sleep(0.01)
    own = sum(int(task.read_text().split()[0]) for task in Path(f"/proc/{child.pid}/task").glob("*/schedstat"))
    assert child_process._processor_time(child.pid)[0] > 1e-9 * own
    os.killpg(child.pid, signal.SIGKILL)


def test_it_inherits_its_descriptors_and_leads_a_session_of_its_own(start: Start) -> None:
    descriptor = os.memfd_create("test")
    child = start(
        "import os, sys\nos.write(int(sys.argv[1]), f'{os.getsid(0)} {os.getpid()}'.encode())",
        str(descriptor),
        descriptors=(descriptor,),
    )
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
