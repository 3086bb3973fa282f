"""The order in which a session's processes start and end, and what is told of their deaths, with stand-ins for them."""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import sampled
from live_peers import until
from live_scripted import make_setup

from hhsim.live.processes import Stage, write_setup
from hhsim.live.session import supervisor
from hhsim.live.session.supervisor import LOOP, RECORDER, VIEWER, WATCHDOG, Supervisor
from hhsim.result.schema import FAULT, WARNING

pytestmark = pytest.mark.slow

# Without hhsim's numerics, which every one of them would load.
BEGIN = """
import os, signal, sys, time
from hhsim.live.session.memory import SessionMemory
from hhsim.live.processes import LIVE_STATUS, SharedBlock, Stage, process_setup
(given,) = process_setup("stand-in", None)
if isinstance(given, SessionMemory):
    status, events = given.status, given.events
else:
    # The watchdog's setup names the status block, and it has nothing else.
    status = SharedBlock(given.status, LIVE_STATUS).array[0]
def mark(word):
    with open({marks!r}, "a") as file:
        file.write(word + " ")
"""
GOOD_LOOP = """
events.slot()["text"] = b"the loop is here"
events.publish()
status["stage"] = Stage.RUNNING
while not status["stop_requested"]:
    time.sleep(0.005)
mark("loop")
status["stage"] = Stage.ENDED
"""
FAULTY_LOOP = """
for time_ns, text in ((5, b"on the way"), ({at}, b"at the end")):
    slot = events.slot()
    slot["time_ns"], slot["level"], slot["text"] = time_ns, 2, text
    events.publish()
status["ticks"], status["ending_ns"], status["stage"] = 1, 9, Stage.ENDING
while not status["stop_requested"]:
    time.sleep(0.005)
status["stage"] = Stage.ENDED
"""
STUBBORN_LOOP = "signal.signal(signal.SIGTERM, signal.SIG_IGN)\nstatus['stage'] = Stage.RUNNING\ntime.sleep(60)"
POLITE_LOOP = "status['stage'] = Stage.RUNNING\ntime.sleep(60)"
SLOW_LOOP = """
status["stage"] = Stage.RUNNING
while not status["stop_requested"]:
    time.sleep(0.005)
status["stage"] = Stage.ENDING
while not os.path.exists({go!r}):
    status["stage"] = Stage.ENDING
    time.sleep(0.005)
status["stage"] = Stage.ENDED
"""
COMPILING_LOOP = """
def end(number, frame):
    status["stage"] = Stage.ENDED
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
mark("compiling")
time.sleep(1000)
"""
NO_GLOVE = "print('hhsim: error: no glove at 127.0.0.1:1', file=sys.stderr)\nsys.exit(2)"
UNTIL_ENDED = "while status['stage'] != Stage.ENDED:\n    time.sleep(0.005)\nmark('{name}')"
WATCHDOG_UNTIL_ENDED = "time.sleep(0.1)\n" + UNTIL_ENDED.format(name="watchdog")
MORTAL = "time.sleep(0.3)\nsys.exit(5)"
FULL_DISK = "print('hhsim: error: no space left', file=sys.stderr)\nsys.exit(2)"

Make = Callable[..., Supervisor]


@pytest.fixture
def marks(tmp_path: Path) -> Path:
    return tmp_path / "marks"


@pytest.fixture
def make(tmp_path: Path, marks: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Make]:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(supervisor, "MODULES", {name: f"{name}_program" for name in supervisor.MODULES})
    # The memory alone: the scene in front of it would load the numerics.
    monkeypatch.setattr(supervisor, "write_setup", lambda *parts: write_setup(parts[-1]))
    programs = {
        LOOP: GOOD_LOOP,
        WATCHDOG: WATCHDOG_UNTIL_ENDED,
        RECORDER: UNTIL_ENDED.format(name="recorder"),
        VIEWER: UNTIL_ENDED.format(name="viewer"),
    }
    made: list[Supervisor] = []

    def session(*, record: bool = True, view: bool = False, **changed: str) -> Supervisor:
        begin = BEGIN.format(marks=str(marks))
        for name, program in {**programs, **changed}.items():
            (tmp_path / f"{name}_program.py").write_text(begin + program)
        setup = make_setup(record=tmp_path / "session.h5" if record else None, rerun="spawn" if view else None)
        made.append(Supervisor(setup))
        return made[-1]

    yield session
    for each in made:
        each.end()


def run(session: Supervisor, reached: Callable[[], bool]) -> None:
    until(lambda: not session.poll() or reached())


def notices(session: Supervisor, level: int = 0) -> str:
    return " / ".join(text for _, at, text in session.end().notices if at >= level)


def running(session: Supervisor) -> bool:
    return session.stage == Stage.RUNNING


def test_a_session_ends_in_order_and_the_watchdog_is_last(make: Make, marks: Path) -> None:
    session = make(view=True)
    with session:
        run(session, lambda: running(session))
        pids = [session.pid(name) for name in (LOOP, WATCHDOG, RECORDER, VIEWER)]
        assert None not in pids
        session.request_stop("a key")
        session.request_stop("another reason")
    words = marks.read_text().split()
    assert words[0] == "loop"
    assert sorted(words[1:]) == ["recorder", "viewer", "watchdog"]
    outcome = session.end()
    assert (outcome.reason, outcome.loop_failed, outcome.record_failed) == ("a key", "", "")
    assert notices(session, WARNING) == ""
    assert "the loop is here" in notices(session)
    assert session.end().error == ""
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.parametrize(("at", "fault"), [(8, ""), (9, "at the end")])
def test_a_fault_counts_as_one_at_the_end_if_it_was_then(make: Make, at: int, fault: str) -> None:
    with make(record=False, loop=FAULTY_LOOP.format(at=at)) as session:
        until(lambda: session.stage == Stage.ENDING)
    assert session.end().fault_at_end == fault


def test_a_glove_that_is_not_there_is_told_as_the_loop_told_it(make: Make) -> None:
    session = make(loop=NO_GLOVE)
    with session:
        run(session, lambda: False)
    assert session.end().error == "no glove at 127.0.0.1:1"


@pytest.mark.parametrize(
    ("program", "last"),
    sampled([(POLITE_LOOP, "SIGTERM"), (STUBBORN_LOOP, "SIGKILL")], lambda _, case: case[1] == "SIGKILL"),
)
def test_a_loop_that_does_not_end_is_ended(
    make: Make, program: str, last: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "LOOP_PATIENCE", 0.7)
    session = make(loop=program)
    with session:
        run(session, lambda: running(session))
        session.request_stop("a key")
    assert f"the loop does not end: it gets {last}" in notices(session, FAULT)
    assert f"ended by {last}" in session.end().loop_failed
    assert session.end().reason == "a key"
    assert re.match(f"the session ended early: .*{last}", session.end().error)


@pytest.mark.soak
def test_the_end_waits_for_what_is_under_way_and_says_what_it_waits_for(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go = tmp_path / "go"
    session = make(loop=SLOW_LOOP.format(go=str(go)))
    monkeypatch.setattr(supervisor, "TOLD", 0.0)
    notice = session._notice

    def noticed(text: str, level: int, **more: bool) -> None:
        notice(text, level, **more)
        if "has the glove released" in text:
            go.touch()

    session._notice = noticed
    with session:
        run(session, lambda: running(session))
        session.request_stop("a key")
    assert notices(session, WARNING) == "" and session.end().loop_failed == ""
    assert "waiting for the loop, which has the glove released" in notices(session)


@pytest.mark.soak
def test_a_session_that_has_not_begun_ends_with_the_kernel_that_is_compiled(make: Make, marks: Path) -> None:
    session = make(loop=COMPILING_LOOP)
    with session:
        run(session, lambda: marks.exists() and "compiling" in marks.read_text())
        session.request_stop("a key")
    assert notices(session, WARNING) == "" and session.end().loop_failed == ""
    assert session.end().error == ""


@pytest.mark.parametrize("part", sampled([RECORDER, VIEWER], lambda _, part: part == RECORDER))
def test_the_session_goes_on_without_a_recorder_or_a_viewer(make: Make, part: str) -> None:
    session = make(view=True, **{part: FULL_DISK})
    with session:
        run(session, lambda: running(session))
        run(session, lambda: session.pid(part) is None)
        assert session.poll()
        assert running(session)
    assert f"the {part} ended with code 2: no space left" in notices(session, WARNING)
    assert session.end().loop_failed == ""
    if part == RECORDER:
        assert re.match(r"the recording .*session.h5 is not whole: ended with code 2: no space", session.end().error)
    else:
        assert session.end().error == ""


@pytest.mark.soak
def test_a_terminal_that_is_gone_does_not_keep_the_session_from_ending(make: Make) -> None:
    session = make(watchdog=MORTAL)

    def gone(text: str, level: int) -> None:
        raise OSError("Input/output error")

    session._say = gone
    with session:
        run(session, lambda: session.end is not None and session._outcome.watchdog_restarts > 0)
    assert session.end().loop_failed == ""
