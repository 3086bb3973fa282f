"""The watchdog's process ends with its session and loads little; the drills show that it frees the fingers."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

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
for name, descriptor in (("watchdog", write_setup(*watched)), ("loop", write_setup(whole, memory))):
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


@pytest.mark.parametrize("driver", ["dexmo", "udp"])
def test_the_watchdog_is_small(driver: str) -> None:
    program = f"import sys, hhsim.live.session.watchdog, hhsim.live.drivers.{driver}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert len([name for name in loaded if name.split(".")[0] == "hhsim"]) <= 22
    assert {"numba", "trimesh", "h5py", "scipy"}.isdisjoint(loaded)
