"""What the system grants, in processes of their own, where each refusal is said; and who had the processor."""

import itertools
import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from live_scripted import make_setup

from hhsim.live import real_time
from hhsim.live.cpu_accounts import UNKNOWN, CpuAccounts
from hhsim.live.processes import LOOK, ChildProcess, write_setup
from hhsim.live.real_time import RealTimeWishes, described, keep_off, processors_awake
from hhsim.live.session.memory import SessionMemory

ASK = """
import json, os, sys, gc, resource
from hhsim.live.real_time import RealTimeWishes, become_real_time
{before}
mode = become_real_time(RealTimeWishes({wishes}))
print(json.dumps([mode, os.sched_getscheduler(0), sorted(os.sched_getaffinity(0)), gc.isenabled()]))
"""


def ask(wishes: str = "", before: str = "") -> tuple[dict[str, Any], int, list[int], bool]:
    child = subprocess.run(
        [sys.executable, "-c", ASK.format(wishes=wishes, before=before)], capture_output=True, text=True, check=True
    )
    mode, policy, cpus, collects = json.loads(child.stdout)
    return mode, policy, cpus, collects


def test_what_is_achieved_is_what_the_process_has() -> None:
    mode, policy, cpus, collects = ask("lock_memory=False")
    assert mode["timer_slack_ns"] == 1
    assert mode["gc_frozen"] is True
    assert collects is False
    assert (mode["fifo"] == 50) == (policy == os.SCHED_FIFO)
    assert (mode["cpu"] == -1) or cpus == [mode["cpu"]]
    assert (mode["fifo"] == 0) == any("SCHED_FIFO" in line for line in mode["refused"])


def test_without_the_right_every_wish_is_refused_in_a_line() -> None:
    before = """
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
if os.getuid() == 0:
    os.setgid(65534)
    os.setuid(65534)
"""
    mode, policy, _, _ = ask("cpu=4000", before)
    refused = mode["refused"]
    assert (mode["fifo"], mode["memory_locked"], policy) == (0, False, os.SCHED_OTHER)
    assert any("no SCHED_FIFO at priority 50" in line and "ulimit -r" in line for line in refused)
    assert any("memory is not locked" in line and "ulimit -l" in line for line in refused)
    assert mode["cpu"] == -1 and any("may not use 4000" in line for line in refused)
    assert mode["gc_frozen"] is True, "what needs no right is done all the same"
    assert "ordinary scheduling" in described(mode)


def test_processors_are_kept_awake_while_a_block_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = tmp_path / "cpu_dma_latency"
    monkeypatch.setattr(real_time, "IDLE_LATENCY", device)
    mode: dict[str, Any] = {"awake": False, "refused": []}
    with processors_awake(RealTimeWishes(), mode):
        assert mode["awake"] is False
        assert not device.exists(), "no file takes the place of a device that is not there"
    assert [line for line in mode["refused"] if f"{device}: No such file" in line]

    device.write_bytes(b"")
    mode["refused"] = []
    with processors_awake(RealTimeWishes.none(), mode):
        assert (device.read_bytes(), mode["awake"]) == (b"", False)
    with processors_awake(RealTimeWishes(), mode):
        assert device.read_bytes() == bytes(4), "an int of 0 µs"
        assert mode == {"awake": True, "refused": []}
        assert device in opened()
    assert device not in opened()


def opened() -> set[Path]:
    return {link.resolve() for link in Path("/proc/self/fd").iterdir()}


LOCKED = """
from hhsim.live.real_time import lock_memory
try:
    lock_memory()
except OSError:
    raise SystemExit(77)
print(*(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmLck")))
"""


def test_what_a_loop_uses_is_locked() -> None:
    child = subprocess.run([sys.executable, "-c", LOCKED], capture_output=True, text=True, check=False)
    if child.returncode == 77:
        pytest.skip("no memory can be locked here")
    assert int(child.stdout) > 1000, child.stderr


CHILD = """
import os, time
from hhsim.live.real_time import end_with
print(end_with(os.getppid()), os.getpid(), flush=True)
time.sleep(100)
"""


def test_a_process_ends_with_the_one_that_started_it() -> None:
    program = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {CHILD!r}])"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as parent:
        granted, child = parent.stdout.readline().split()
        end = os.pidfd_open(int(child))
        parent.kill()
    assert granted == "True" and select.select([end], [], [], 60.0)[0]
    os.close(end)


@pytest.mark.soak
def test_a_loop_whose_supervisor_is_gone_does_not_begin() -> None:
    wishes, memory = RealTimeWishes(punctual=False, lock_memory=False, cpu=-1), SessionMemory.create()
    setup = write_setup(make_setup(real_time=wishes, supervisor=1 if os.getpid() != 1 else 2), memory)
    command = [sys.executable, "-m", "hhsim.live.session.loop", "--setup", str(setup)]
    child = subprocess.run(command, pass_fds=(setup, *memory.descriptors), capture_output=True, text=True)
    assert child.returncode == 2
    assert "supervisor" in child.stderr
    assert memory.status["ticks"] == 0


def test_the_neighbours_keep_off_the_loops_processor_where_there_is_another() -> None:
    before = os.sched_getaffinity(0)
    try:
        keep_off(-1)
        assert os.sched_getaffinity(0) == before
        keep_off(max(before))
        assert os.sched_getaffinity(0) == ((before - {max(before)}) or before)
        only = min(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {only})
        keep_off(only)
        assert os.sched_getaffinity(0) == {only}, "a machine of one processor has room for nobody else"
        assert RealTimeWishes().chosen().loop_cpu == -1
    finally:
        os.sched_setaffinity(0, before)


STAT = """cpu  30 0 20 900 1 0 0 {both} 0 0
cpu0 10 0 10 400 1 0 0 {first} 0 0
cpu1 20 0 10 500 0 0 0 {second} 0 0
intr 5 4 3
"""


def planted(folder: Path, first: int = 4, second: int = 7, schedule: str = "11 222 3\n") -> Path:
    (folder / "thread-self").mkdir(exist_ok=True)
    (folder / "stat").write_text(STAT.format(first=first, second=second, both=first + second))
    (folder / "thread-self" / "schedstat").write_text(schedule)
    return folder


def test_steal_is_that_of_the_processors_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    step = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    for cpu, steps in ((0, 4), (1, 7), (None, 11)):
        accounts = CpuAccounts(cpu, planted(tmp_path))
        assert (accounts.steal_ns(), accounts.run_delay_ns()) == (steps * step, 222)
        accounts.close()


def test_a_reading_is_of_now(tmp_path: Path) -> None:
    accounts = CpuAccounts(1, planted(tmp_path))
    before = accounts.steal_ns(), accounts.run_delay_ns()
    planted(tmp_path, second=9, schedule="12 5000222 4\n")
    assert accounts.steal_ns() - before[0] == 2 * accounts.steal_step_ns
    assert accounts.run_delay_ns() - before[1] == 5_000_000
    accounts.close()
    accounts.close()


@pytest.mark.parametrize("stat", [None, "", "cpu  1 2 3\ncpu1 20 0 10 500\n", "intr 1\n"])
@pytest.mark.parametrize("schedule", [None, "", "0\n", "a b c\n"])
def test_what_nobody_counts_is_unknown(tmp_path: Path, stat: str | None, schedule: str | None) -> None:
    planted(tmp_path)
    for path, text in ((tmp_path / "stat", stat), (tmp_path / "thread-self" / "schedstat", schedule)):
        path.unlink()
        if text is not None:
            path.write_text(text)
    accounts = CpuAccounts(1, tmp_path)
    assert (accounts.steal_ns(), accounts.run_delay_ns()) == (UNKNOWN, UNKNOWN)


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
