"""Turns to compile: of two processes that need one kernel the second waits and loads it, but not for ever."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locks of this kind")


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
