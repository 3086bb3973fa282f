"""Compiling: what may make arrays, checked indices, arguments by reference, and the processor that is compiled for."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from llvmlite import binding
from numba.core.errors import NumbaError
from own_command import HHSIM

from hhsim.kernels import target
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, jit, jit_allocating, jit_inline, jit_noinline
from hhsim.kernels.target import CHOICE, NATIVE, TargetWarning, chosen_target, named_target


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


@by_reference
class Part(NamedTuple):
    """A record with an array."""

    values: Array


@by_reference
class Whole(NamedTuple):
    """A record that holds another one, and a tuple of some."""

    first: Part
    parts: tuple[Part, ...]


def total(whole: Whole, which: int) -> float:
    """Sum of two values, of which one is chosen when it runs."""
    return whole.first.values[0] + whole.parts[which].values[0]


def allocated(whole: Whole, which: int) -> Array:
    """The same in an array of its own."""
    return np.full(1, whole.first.values[0] + whole.parts[which].values[0])


@pytest.mark.parametrize("kernel", [jit(total), jit_allocating(allocated)], ids=["plain", "allocating"])
def test_a_call_keeps_no_hold_of_what_it_was_given(kernel: Any) -> None:
    arrays = [np.arange(2.0) + k for k in range(3)]
    whole = Whole(Part(arrays[0]), (Part(arrays[1]), Part(arrays[2])))
    before = [sys.getrefcount(array) for array in arrays]
    for which in (0, 1):
        assert float(np.sum(kernel(whole, which))) == 1.0 + which
    assert [sys.getrefcount(array) for array in arrays] == before


V3 = "x86-64-v3"


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: dict.fromkeys(target.NEEDED[V3], True))


def test_the_named_target_is_taken_where_the_processor_can_run_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    assert chosen_target() == named_target() == V3
    monkeypatch.setenv(CHOICE, "x86-64-v9")
    with pytest.warns(TargetWarning, match="x86-64-v9.*expected nothing or native"):
        assert chosen_target() == V3


def test_the_environment_decides_before_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CHOICE, NATIVE)
    assert chosen_target() == NATIVE


def test_an_older_processor_compiles_for_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: {"avx2": True, "fma": False})
    assert chosen_target() == NATIVE
    assert named_target() is None
