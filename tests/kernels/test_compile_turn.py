"""Turns to compile: of two processes that need one kernel the second waits and loads it, but not for ever."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hhsim.kernels import compile_turn
from hhsim.kernels.compile_turn import Turns

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locks of this kind")

HOLDER = """
import sys, time
from pathlib import Path
from hhsim.kernels.compile_turn import Turns
turns = Turns(Path(sys.argv[1]))
with turns.kept():
    assert not turns.take("a kernel")
    print("mine", flush=True)
    sys.stdin.readline()
print("ended", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that has the turn of a kernel until a line comes."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "turns")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "mine\n"
        yield process
        process.kill()


def test_another_kernels_turn_is_free_and_ones_own_is_no_other(holder: subprocess.Popen[str], tmp_path: Path) -> None:
    turns = Turns(tmp_path / "turns")
    assert not turns.take("another") and not turns.take("another")


def test_who_has_it_is_waited_for_until_it_ends_it(holder: subprocess.Popen[str], tmp_path: Path) -> None:
    turns = Turns(tmp_path / "turns")
    child = os.fork()
    if child == 0:
        os._exit(0 if turns.take("a kernel") else 1)
    time.sleep(0.1)
    assert os.waitpid(child, os.WNOHANG) == (0, 0), "it has not waited"
    assert holder.stdin is not None and holder.stdout is not None
    print(file=holder.stdin, flush=True)
    assert holder.stdout.readline() == "ended\n"
    assert os.waitpid(child, 0)[1] == 0
    assert not turns.take("a kernel")


def test_a_process_that_dies_has_no_turn(holder: subprocess.Popen[str], tmp_path: Path) -> None:
    holder.kill()
    holder.wait()
    assert not Turns(tmp_path / "turns").take("a kernel")


def test_a_process_that_is_stopped_is_waited_for_once(
    holder: subprocess.Popen[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compile_turn, "PATIENCE", 0.2)
    holder.send_signal(signal.SIGSTOP)
    turns, told = Turns(tmp_path / "turns"), []
    turns.on_wait = lambda: told.append(time.monotonic())
    began = time.monotonic()
    assert turns.take("a kernel") and turns.take("a kernel")
    assert len(told) == 2 and told[0] - began < 0.2 <= told[1] - began
    with turns.kept():
        pass
    assert turns._patience == 0.0 and turns._held == []


def test_where_there_are_no_locks_nobody_waits(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    turns = Turns(tmp_path / "file" / "turns")
    with turns.kept():
        assert not turns.take("a kernel")
    assert turns._held == []


COMPILED = """
import sys, time
from pathlib import Path
from hhsim.kernels.kernel_cache import compiled_kernels
from hhsim.kernels.rotation import quaternion_to_matrix
import numpy as np
Path(sys.argv[1]).touch()
while not Path(sys.argv[2]).exists():
    time.sleep(0.001)
quaternion_to_matrix(np.array([1.0, 0.0, 0.0, 0.0]), np.empty((3, 3)))
print(compiled_kernels())
"""


def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(tmp_path: Path) -> None:
    environment = {**os.environ, "HHSIM_CACHE_DIR": str(tmp_path / "cache")}
    go = tmp_path / "go"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", COMPILED, str(tmp_path / str(one)), str(go)], stdout=subprocess.PIPE, env=environment
        )
        for one in range(3)
    ]
    while not all((tmp_path / str(one)).exists() for one in range(3)):
        assert all(process.poll() is None for process in processes)
        time.sleep(0.01)
    go.touch()
    counts = sorted(int(process.communicate()[0]) for process in processes)
    assert counts[:2] == [0, 0] and counts[2] > 0
