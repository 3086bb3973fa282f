"""The word that a program is given while kernels are compiled: once, where something is compiled, and not elsewhere."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hhsim.system.compile_notice import COMPILING

PROGRAM = """\
import logging, sys
import numpy as np
import numba
import hhsim

hhsim.HandSolver
logging.getLogger("hhsim").setLevel(sys.argv[1])
numba.njit(lambda: 1)()
from hhsim.kernels.rotation import quaternion_to_matrix, rotation_vector_between

one, other = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(3)
quaternion_to_matrix(one, np.empty((3, 3)))
rotation_vector_between(one, one, other)
"""


@pytest.mark.soak
def test_a_program_is_told_once_that_kernels_are_compiled_and_can_silence_it(tmp_path: Path) -> None:
    def told(level: str, cache: str) -> str:
        environment = {**os.environ, "HHSIM_CACHE_DIR": str(tmp_path / cache)}
        command = [sys.executable, "-c", PROGRAM, level]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr

    assert told("WARNING", "a") == f"{COMPILING}\n"
    assert told("WARNING", "a") == ""  # it lies in the cache
    assert told("ERROR", "b") == ""
