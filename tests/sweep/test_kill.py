"""At length: killed at random moments and resumed, a sweep has the files of one that nobody disturbed."""

import contextlib
import random
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from own_command import HHSIM
from sweep_plans import PLAN, without_times, write_plan

pytestmark = pytest.mark.soak
KILLS = 5
WIDE = PLAN.replace('["cylinder"]', '["cylinder", "cube", "cup"]').replace(
    '["short.toml"]', '["short.toml", "pinch", "grasp", "touch"]'
)
ENTRY = (*HHSIM, "sweep", "plan.toml", "--quiet")


@contextlib.contextmanager
def cluster() -> Iterator[str]:
    """A scheduler and two workers, started apart."""
    pytest.importorskip("distributed")
    dask = shutil.which("dask", path=Path(sys.executable).parent)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    port = address.rpartition(":")[2]
    commands = [[dask, "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]]
    commands += 2 * [[dask, "worker", address, "--nthreads", "1", "--no-dashboard"]]
    with contextlib.ExitStack() as stack:
        for command in commands:
            process = stack.enter_context(subprocess.Popen(command, stderr=subprocess.DEVNULL))
            stack.callback(process.terminate)
        yield address


@pytest.mark.parametrize("engine", ["one process", "two processes", "dask"])
def test_killed_and_resumed_it_has_the_same_files(tmp_path: Path, engine: str) -> None:
    write_plan(tmp_path, WIDE)
    subprocess.run([*ENTRY, "--out", "undisturbed"], cwd=tmp_path, check=True)
    chance = random.Random(engine)
    with contextlib.ExitStack() as stack:
        how = ["--jobs", "1" if engine == "one process" else "2"]
        if engine == "dask":
            how = ["--scheduler", stack.enter_context(cluster())]
        command = [*ENTRY, "--out", "killed", *how]
        for _ in range(KILLS):
            process = subprocess.Popen(command, cwd=tmp_path)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(chance.uniform(3.0, 10.0))
            process.send_signal(signal.SIGKILL)
            process.wait()
        subprocess.run(command, cwd=tmp_path, check=True)
    names = sorted(path.name for path in (tmp_path / "undisturbed" / "cells").iterdir())
    assert sorted(path.name for path in (tmp_path / "killed" / "cells").iterdir()) == names
    for name in (name for name in names if name.endswith(".h5")):
        one, other = (tmp_path / folder / "cells" / name for folder in ("undisturbed", "killed"))
        assert without_times(one) == without_times(other), name
