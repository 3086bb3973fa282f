"""A kernel that other kernels call and Python, too: what was compiled for the ones is made use of for the other."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from numba.core import event
from numpy.typing import NDArray

from hhsim.kernels.jit import JIT_ENABLED, jit, jit_inline, jit_vector

pytestmark = pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler nothing is compiled")


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


@pytest.mark.parametrize("make", [jit, jit_inline, jit_vector])
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
