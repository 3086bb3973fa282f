"""The guardian, in processes of its own: it frees the fingers when the loop cannot, and ends when nobody needs it."""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest
from live_scripted import make_setup

from hhsim.live.ipc.config import LiveSetup, OutputLimits, RealTimeWishes, write_setup
from hhsim.live.ipc.records import Stage
from hhsim.live.ipc.session_memory import SessionMemory

PROGRAM = Path(__file__).parents[2] / "guarded_loop.py"
MS = 1_000_000
PATIENCE = 60.0


class Line(NamedTuple):
    time_ns: int
    who: str
    stiffness: float


class Guarded:
    """A session of a loop and a guardian, with what the glove was told."""

    def __init__(self, folder: Path, setup: LiveSetup) -> None:
        self.memory = SessionMemory.create()
        self.setup = write_setup(setup)
        self.log = folder / "log"
        self.children: list[subprocess.Popen[bytes]] = []

    def start(self, who: str) -> subprocess.Popen[bytes]:
        child = subprocess.Popen(
            [sys.executable, str(PROGRAM), who, str(self.log), "--setup", str(self.setup), *self.memory.arguments()],
            pass_fds=(self.setup, *self.memory.descriptors),
        )
        self.children.append(child)
        return child

    def lines(self) -> list[Line]:
        if not self.log.exists():
            return []
        parts = (line.split() for line in self.log.read_text().splitlines())
        return [Line(int(stamp), who, float(stiffness)) for stamp, who, stiffness in parts]

    def until(self, condition: Callable[[], object], what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f"{what} did not come about in {PATIENCE:g} s"
            time.sleep(0.005)

    def until_guardian_lives_on(self) -> None:
        seen = int(self.memory.status["guardian_ns"])
        self.until(lambda: self.memory.status["guardian_ns"] > seen + 50 * MS, "a sign of life of the guardian")

    def hold(self) -> tuple[subprocess.Popen[bytes], subprocess.Popen[bytes]]:
        """Guardian and loop, once a finger is held."""
        guardian = self.start("guardian")
        loop = self.start("loop")
        self.until(lambda: self.memory.status["command_stiffness"].max() > 0.1, "a finger that is held")
        return guardian, loop

    @property
    def limit_ns(self) -> int:
        """Within this the fingers must be free: 50 ms where the guardian has real-time scheduling."""
        try:
            policies = [os.sched_getscheduler(child.pid) for child in self.children]
        except OSError:
            policies = []
        real_time = bool(policies) and all(policy == os.SCHED_FIFO for policy in policies)
        return 50 * MS if real_time else 500 * MS


SUPERVISOR = """
import subprocess, sys, time
sys.path.insert(0, sys.argv[1])
from live_scripted import make_setup
from hhsim.live.ipc.config import RealTimeWishes, write_setup
from hhsim.live.ipc.session_memory import SessionMemory
memory = SessionMemory.create()
setup = write_setup(make_setup(real_time=RealTimeWishes(lock_memory=False, cpu=-1)))
for name in ("guardian", "loop_process"):
    arguments = ["--setup", str(setup), *memory.arguments()]
    command = [sys.executable, "-m", f"hhsim.live.{name}", *arguments]
    child = subprocess.Popen(command, pass_fds=(setup, *memory.descriptors))
    print(child.pid)
while memory.status["ticks"] < 20:
    time.sleep(0.01)
print("running", flush=True)
time.sleep(1000)
"""


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Guarded]:
    setup = make_setup(output=OutputLimits(ramp=0.05), real_time=RealTimeWishes(cpu=-1))
    session = Guarded(tmp_path, setup)
    yield session
    for child in session.children:
        if child.poll() is None:
            child.kill()
            child.wait()


def test_a_loop_that_is_killed_is_spoken_for(guarded: Guarded) -> None:
    guardian, loop = guarded.hold()
    limit = guarded.limit_ns
    assert not any(line.who == "guardian" for line in guarded.lines()), "it is quiet while the loop is well"
    killed = time.monotonic_ns()
    loop.kill()
    loop.wait()
    guarded.until(lambda: guarded.lines()[-1].who == "guardian", "a word of the guardian")
    after = [line for line in guarded.lines() if line.time_ns >= killed and line.who == "guardian"]
    assert after[0].stiffness == 0.0
    assert after[0].time_ns - killed <= limit
    guardian.send_signal(signal.SIGTERM)
    assert guardian.wait(PATIENCE) == 0
    spoken = [line for line in guarded.lines() if line.who == "guardian" and line.stiffness == 0.0]
    assert len(spoken) >= 3, "again and again: a first word may be lost"
    assert guarded.memory.status["guardian_releases"] == len(spoken) - 1, "its last word is a matter of course"
    assert guarded.memory.status["guardian_armed"] == 0
    assert guarded.lines()[-1].stiffness == -1.0, "its connection is closed"


def test_a_loop_that_stands_still_is_spoken_for_until_it_goes_on(guarded: Guarded) -> None:
    guardian, loop = guarded.hold()
    limit = guarded.limit_ns
    stopped = time.monotonic_ns()
    loop.send_signal(signal.SIGSTOP)
    guarded.until(lambda: guarded.memory.status["guardian_releases"] >= 3, "three words of the guardian")
    spoken = [line for line in guarded.lines() if line.who == "guardian"]
    assert spoken[0].time_ns - stopped <= limit
    gaps = [after.time_ns - before.time_ns for before, after in pairwise(spoken)]
    assert all(gap >= 19 * MS for gap in gaps)
    went_on = time.monotonic_ns()
    loop.send_signal(signal.SIGCONT)

    def since() -> list[Line]:
        return [line for line in guarded.lines() if line.who == "loop" and line.time_ns > went_on]

    guarded.until(lambda: any(line.stiffness > 0.1 for line in since()), "a finger that is held again")
    assert since()[0].stiffness == 0.0, "a loop that stood still frees the fingers before it holds them again"
    loop.send_signal(signal.SIGINT)
    assert loop.wait(PATIENCE) == 0
    assert guardian.wait(PATIENCE) == 0


def test_the_guardian_outlives_the_loop_whatever_signal_it_gets(guarded: Guarded) -> None:
    guardian, loop = guarded.hold()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        guardian.send_signal(number)
        guarded.until_guardian_lives_on()
        assert guardian.poll() is None
    loop.send_signal(signal.SIGINT)
    assert loop.wait(PATIENCE) == 0
    assert guardian.wait(PATIENCE) == 0
    told = [line for line in guarded.lines() if line.stiffness >= 0.0]
    assert told[-1].stiffness == 0.0
    assert any(line.who == "loop" and line.stiffness == -1.0 for line in guarded.lines()), "the loop closed its glove"
    assert guarded.memory.status["stage"] == Stage.ENDED


def test_a_loop_whose_guardian_is_killed_frees_the_fingers_until_there_is_another(guarded: Guarded) -> None:
    guardian, loop = guarded.hold()
    guardian.kill()
    guardian.wait()
    guarded.until(lambda: guarded.memory.status["command_stiffness"].max() == 0.0, "fingers that are free")
    guarded.start("guardian")
    guarded.until(lambda: guarded.memory.status["command_stiffness"].max() > 0.1, "a finger that is held again")
    loop.send_signal(signal.SIGTERM)
    assert loop.wait(PATIENCE) == 0


def test_a_guardian_without_a_loop_ends_when_it_is_asked_to(guarded: Guarded) -> None:
    guardian = guarded.start("guardian")
    guarded.until(lambda: guarded.memory.status["guardian_armed"], "a guardian that is armed")
    guardian.send_signal(signal.SIGTERM)
    assert guardian.wait(PATIENCE) == 0


def test_nobody_speaks_in_a_dry_run(tmp_path: Path) -> None:
    session = Guarded(tmp_path, make_setup(dry_run=True, duration=0.3))
    guardian, loop = session.start("guardian"), session.start("loop")
    assert loop.wait(PATIENCE) == 0
    assert guardian.wait(PATIENCE) == 0
    assert [line for line in session.lines() if line.stiffness >= 0.0] == []


def test_loop_and_guardian_end_when_their_supervisor_is_killed() -> None:
    arguments = [sys.executable, "-c", SUPERVISOR, str(PROGRAM.parent)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as supervisor:
        assert supervisor.stdout is not None
        words = [supervisor.stdout.readline().strip() for _ in range(3)]
        pids = [int(word) for word in words[:2]]
        ends = [os.pidfd_open(pid) for pid in pids]
        assert words[2] == "running"
        supervisor.kill()
    for pid, end in zip(pids, ends, strict=True):
        ended, _, _ = select.select([end], [], [], PATIENCE)
        os.close(end)
        if not ended:
            os.kill(pid, signal.SIGKILL)
        assert ended
