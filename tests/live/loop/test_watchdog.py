"""The watchdog, in processes of its own: it frees the fingers when the loop cannot, and ends when nobody needs it."""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from live_drill import Fault
from live_scripted import make_setup
from machine_share import assert_in_time, keeps_time

from hhsim.live.devices.registry import GLOVES, GloveConfig, configure
from hhsim.live.ipc.config import LiveSetup, OutputLimits
from hhsim.live.ipc.session_memory import SessionMemory
from hhsim.live.ipc.status import Stage
from hhsim.live.loop.watchdog import RELEASE_NS
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.shared_memory import write_setup

pytestmark = keeps_time

PROGRAM = Path(__file__).parents[2] / "guarded_loop.py"
MS = 1_000_000
PATIENCE = 120.0


class Line(NamedTuple):
    time_ns: int
    who: str
    stiffness: float


class Guarded:
    """A session of a loop and a watchdog, with what the glove was told."""

    def __init__(self, folder: Path, setup: LiveSetup) -> None:
        self.memory = SessionMemory.create()
        watched = setup.for_watchdog(self.memory.descriptors.status)
        self.setups = {"loop": write_setup(setup), "watchdog": write_setup(watched)}
        self.log = folder / "log"
        self.children: list[subprocess.Popen[bytes]] = []

    def start(self, who: str) -> subprocess.Popen[bytes]:
        memory = self.memory.arguments() if who == "loop" else []
        child = subprocess.Popen(
            [sys.executable, str(PROGRAM), who, str(self.log), "--setup", str(self.setups[who]), *memory],
            pass_fds=(self.setups[who], *self.memory.descriptors),
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

    def until_watchdog_lives_on(self) -> None:
        seen = int(self.memory.status["watchdog_ns"])
        self.until(lambda: self.memory.status["watchdog_ns"] > seen + 50 * MS, "a sign of life of the watchdog")

    def hold(self) -> tuple[subprocess.Popen[bytes], subprocess.Popen[bytes]]:
        """Watchdog and loop, once a finger is held."""
        watchdog = self.start("watchdog")
        loop = self.start("loop")
        self.until(lambda: self.memory.status["command_stiffness"].max() > 0.1, "a finger that is held")
        return watchdog, loop

    def fault(self, breaks: Callable[[], object]) -> Fault:
        """Break something, while a finger is held."""
        return Fault(breaks, *(child.pid for child in self.children))


SUPERVISOR = """
import subprocess, sys, time
sys.path.insert(0, sys.argv[1])
from live_scripted import make_setup
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.shared_memory import write_setup
from hhsim.live.ipc.session_memory import SessionMemory
memory = SessionMemory.create()
whole = make_setup(real_time=RealTimeWishes(lock_memory=False, cpu=-1))
watched = whole.for_watchdog(memory.descriptors.status)
for name, setup, arguments in (("watchdog", watched, []), ("process", whole, memory.arguments())):
    descriptor = write_setup(setup)
    command = [sys.executable, "-m", f"hhsim.live.loop.{name}", "--setup", str(descriptor), *arguments]
    child = subprocess.Popen(command, pass_fds=(descriptor, *memory.descriptors))
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


def test_a_loop_that_stands_still_is_spoken_for_until_it_goes_on_whatever_signal_the_watchdog_gets(
    guarded: Guarded,
) -> None:
    watchdog, loop = guarded.hold()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        watchdog.send_signal(number)
        guarded.until_watchdog_lives_on()
        assert watchdog.poll() is None
    stopped = guarded.fault(lambda: loop.send_signal(signal.SIGSTOP))

    def words() -> list[Line]:
        return [line for line in guarded.lines() if line.who == "watchdog" and line.time_ns > stopped.before]

    guarded.until(lambda: len(words()) >= 3, "three words of the watchdog")
    spoken = words()
    assert_in_time(spoken[0].time_ns - stopped.since, stopped.allowed)
    assert len(spoken) - 1 <= (spoken[-1].time_ns - stopped.before) / RELEASE_NS, "and no more often than it has to"
    went_on = time.monotonic_ns()
    loop.send_signal(signal.SIGCONT)

    def since() -> list[Line]:
        return [line for line in guarded.lines() if line.who == "loop" and line.time_ns > went_on]

    guarded.until(lambda: any(line.stiffness > 0.1 for line in since()), "a finger that is held again")
    assert since()[0].stiffness == 0.0, "a loop that stood still frees the fingers before it holds them again"
    loop.send_signal(signal.SIGINT)
    assert loop.wait(PATIENCE) == 0
    assert watchdog.wait(PATIENCE) == 0
    commands = [line for line in guarded.lines() if line.stiffness >= 0.0]
    assert commands[-1].stiffness == 0.0
    assert any(line.who == "loop" and line.stiffness == -1.0 for line in guarded.lines()), "the loop closed its glove"
    assert guarded.memory.status["stage"] == Stage.ENDED


def test_a_watchdog_without_a_loop_ends_when_it_is_asked_to(guarded: Guarded) -> None:
    watchdog = guarded.start("watchdog")
    guarded.until(lambda: guarded.memory.status["watchdog_armed"], "a watchdog that is armed")
    watchdog.send_signal(signal.SIGTERM)
    assert watchdog.wait(PATIENCE) == 0


def test_nobody_speaks_in_a_dry_run(tmp_path: Path) -> None:
    session = Guarded(tmp_path, make_setup(dry_run=True, duration=0.3))
    watchdog, loop = session.start("watchdog"), session.start("loop")
    assert loop.wait(PATIENCE) == 0
    assert watchdog.wait(PATIENCE) == 0
    assert [line for line in session.lines() if line.stiffness >= 0.0] == []


def test_loop_and_watchdog_end_when_their_supervisor_is_killed() -> None:
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


def loaded_by_the_watchdog(config: GloveConfig) -> list[str]:
    """Modules of hhsim in the watchdog's process once it watches."""
    memory = SessionMemory.create()
    setup = make_setup(device=config, real_time=RealTimeWishes.none(), supervisor=os.getpid())
    descriptor = write_setup(setup.for_watchdog(memory.descriptors.status))
    with subprocess.Popen(
        [sys.executable, "-c", LOADED, "--setup", str(descriptor)],
        pass_fds=(descriptor, memory.descriptors.status),
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            end = time.monotonic() + PATIENCE
            while memory.status["watchdog_ns"] == 0:
                assert time.monotonic() < end and process.poll() is None
                time.sleep(0.005)
            process.terminate()
            answer, _ = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    return answer.split()


LOADED = """
import runpy, sys
sys.argv[0] = "watchdog"
try:
    runpy.run_module("hhsim.live.loop.watchdog", run_name="__main__", alter_sys=True)
except SystemExit as end:
    assert not end.code
print(*sys.modules)
"""


@pytest.mark.parametrize("kind", GLOVES)
def test_the_watchdog_is_small(kind: str) -> None:
    loaded = loaded_by_the_watchdog(configure(kind))
    ours = [name for name in loaded if name.split(".")[0] == "hhsim"]
    assert len(ours) <= 21, ours
    assert {"numba", "trimesh", "h5py", "scipy"}.isdisjoint(loaded)
