"""The jit factory: one implementation for each type, code that is compiled once for all, and memory asked for ahead."""

import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core import event
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from hhsim.kernels.jit import JIT_ENABLED, generic, jit, jit_allocating, jit_inline, jit_noinline, jit_pasted
from hhsim.kernels.prefetch import prefetch


class Metres(NamedTuple):
    value: float


class Feet(NamedTuple):
    value: float


@generic
def in_metres(length: Any, times: float) -> float:
    """A length, so many times, in metres."""
    return 0.0


@in_metres.of(Metres)
@jit
def _metres(length: Any, times: float) -> float:
    return length.value * times  # type: ignore[no-any-return]


@in_metres.of(Feet)
@jit
def _feet(length: Any, times: float) -> float:
    return length.value * times * 0.3048  # type: ignore[no-any-return]


@jit
def total(length: Any, count: int) -> float:
    found = 0.0
    for _ in range(count):
        found += in_metres(length, 2.0)
    return found


def test_a_generic_kernel_is_chosen_by_type_from_kernels_and_from_python() -> None:
    assert in_metres(Metres(3.0), 2.0) == 6.0
    assert in_metres(Feet(10.0), 1.0) == pytest.approx(3.048)
    assert total(Metres(3.0), 4) == 24.0
    assert total(Feet(10.0), 1) == pytest.approx(6.096)
    with pytest.raises(TypeError, match="not implemented for float"):
        in_metres(3.0, 1.0)


@pytest.mark.skipif(not JIT_ENABLED, reason="nothing is compiled")
@pytest.mark.parametrize("decorator", [jit, jit_inline, jit_noinline, jit_pasted, jit_allocating])
def test_a_kernel_that_does_not_say_so_can_make_no_array(decorator: Callable[..., Any]) -> None:
    @decorator
    def made(count: int) -> Any:
        return np.zeros(count)

    if decorator is jit_allocating:
        assert made(3).tolist() == [0.0, 0.0, 0.0]
        return
    with pytest.raises(NumbaError):
        made(3)


class Passes(event.Listener):  # type: ignore[misc]
    """The passes of numba's compiler that ran."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def on_start(self, event: Any) -> None:
        self.names.append(event.data["name"])

    def on_end(self, event: Any) -> None:
        pass


@contextmanager
def passes() -> Iterator[list[str]]:
    listener = Passes()
    with event.install_listener("numba:run_pass", listener):
        yield listener.names


def weigh(values: NDArray[np.float64], factor: float) -> tuple[float, int]:
    total, least = 0.0, 0
    for i in range(values.size):
        total += factor * values[i]
        if values[i] < values[least]:
            least = i
    return total, least


@pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler nothing is compiled")
@pytest.mark.parametrize("make", [jit, jit_inline])
def test_what_callers_link_is_what_python_calls(make: Any) -> None:
    inner = make(weigh)

    @jit
    def outer(values: NDArray[np.float64], factor: float) -> float:
        total, least = inner(values, factor)
        return float(total + least)

    values = np.random.default_rng(0).normal(size=1000)
    of_both = outer(values, 0.3)
    with passes() as ran:
        total, least = inner(values, 0.3)
    assert ran == []
    assert total + least == of_both
    with passes() as ran:
        anew = make(weigh)(values, 0.3)
    assert any("native_lowering" in name for name in ran)
    assert anew == (total, least)
    assert inner.address(values, 0.3) != 0


@pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler nothing is inlined")
@pytest.mark.parametrize(("make", "said"), [(jit, set()), (jit_inline, {"alwaysinline"}), (jit_noinline, {"noinline"})])
def test_whether_a_kernel_is_inlined_does_not_depend_on_who_compiles_it(make: Any, said: set[str]) -> None:
    inner = make(weigh)

    @jit_inline
    def middle(values: NDArray[np.float64]) -> float:
        total, least = inner(values, 2.0)
        return float(total + least)

    @jit
    def outer(values: NDArray[np.float64]) -> float:
        return middle(values)

    outer(np.ones(8))
    (compiled,) = inner.callee.overloads.values()
    code = compiled.library._get_module_for_linking().get_function(compiled.fndesc.llvm_func_name)
    attributes = " ".join(str(attribute) for attribute in code.attributes)
    assert {word for word in ("alwaysinline", "noinline") if word in attributes} == said


@jit
def first_column(rows: NDArray[np.float64]) -> float:
    found = 0.0
    for i in range(rows.shape[0]):
        # The last ones lie beyond the array.
        prefetch(rows, i + 4, 128)
        found += rows[i, 0]
    return found


@pytest.mark.skipif(not JIT_ENABLED or platform.machine() != "x86_64", reason="names an instruction of x86-64")
def test_each_line_is_asked_for() -> None:
    first_column(np.zeros((2, 16)))
    (code,) = first_column.inspect_asm().values()  # type: ignore[attr-defined]
    assert "prefetcht0" in code and "64(" in code
