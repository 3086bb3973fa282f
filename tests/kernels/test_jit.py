"""The jit factory: what may make arrays, and ticks whose every index is checked."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.errors import NumbaError
from own_command import HHSIM

from hhsim.kernels.jit import jit, jit_allocating, jit_inline, jit_noinline


@pytest.mark.parametrize("decorator", [jit, jit_inline, jit_noinline, jit_allocating])
def test_a_kernel_that_does_not_say_so_can_make_no_array(decorator: Callable[..., Any]) -> None:
    @decorator
    def made(count: int) -> Any:
        return np.zeros(count)

    if decorator is jit_allocating:
        assert made(3).tolist() == [0.0, 0.0, 0.0]
        return
    with pytest.raises(NumbaError):
        made(3)


@pytest.mark.slow
@pytest.mark.soak
@pytest.mark.parametrize("options", ["--method coupled", "--method progressive --force paper", "--method paper"])
def test_ticks_with_checked_bounds_are_the_same_to_rounding(tmp_path: Path, options: str) -> None:
    def replay(arguments: str, **environment: str) -> str:
        command = [*HHSIM, "replay", *arguments.split()]
        given = {**os.environ, **environment}
        return subprocess.run(command, env=given, capture_output=True, text=True, check=True).stdout

    result = tmp_path / "checked.h5"
    checks = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_OPT": "0", "HHSIM_CACHE_DIR": str(tmp_path / "cache")}
    assert "3,000 ticks" in replay(f"cube pinch {options} --out {result}", **checks)
    replay(str(result))
