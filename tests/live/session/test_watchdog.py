"""The watchdog's process ends with its session and loads little; the drills show that it frees the fingers."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from live_scripted import make_setup

from hhsim.live.gloves import GLOVES, GloveConfig, configure
from hhsim.live.processes import write_setup
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.session.memory import SessionMemory

TESTS = Path(__file__).parents[2]
PATIENCE = 120.0

SUPERVISOR = """
import subprocess, sys, time
sys.path.insert(0, sys.argv[1])
from live_scripted import make_setup
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.processes import write_setup
from hhsim.live.session.memory import SessionMemory
memory = SessionMemory.create()
whole = make_setup(real_time=RealTimeWishes(lock_memory=False, cpu=-1))
watched = whole.for_watchdog(memory.descriptors)
for name, descriptor in (("watchdog", write_setup(*watched)), ("loop", memory.with_setup(whole))):
    command = [sys.executable, "-m", f"hhsim.live.session.{name}", "--setup", str(descriptor)]
    child = subprocess.Popen(command, pass_fds=(descriptor, *memory.descriptors))
    print(child.pid)
while memory.status["ticks"] < 20:
    time.sleep(0.01)
print("running", flush=True)
time.sleep(1000)
"""


def test_loop_and_watchdog_end_when_their_supervisor_is_killed() -> None:
    arguments = [sys.executable, "-c", SUPERVISOR, str(TESTS)]
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
    descriptor = write_setup(*setup.for_watchdog(memory.descriptors))
    with subprocess.Popen(
        [sys.executable, "-c", LOADED, "--setup", str(descriptor)],
        pass_fds=(descriptor, memory.descriptor),
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
    runpy.run_module("hhsim.live.session.watchdog", run_name="__main__", alter_sys=True)
except SystemExit as end:
    assert not end.code
print(*sys.modules)
"""


@pytest.mark.parametrize("kind", GLOVES)
def test_the_watchdog_is_small(kind: str) -> None:
    loaded = loaded_by_the_watchdog(configure(kind))
    ours = [name for name in loaded if name.split(".")[0] == "hhsim"]
    assert len(ours) <= 22, ours
    assert {"numba", "trimesh", "h5py", "scipy"}.isdisjoint(loaded)
