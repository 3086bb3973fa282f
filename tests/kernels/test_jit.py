"""The jit factory: one implementation for each type, code that is compiled once for all, and memory asked for ahead."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba.core.errors import NumbaError

from hhsim.kernels.jit import JIT_ENABLED, jit, jit_allocating, jit_inline, jit_noinline, jit_pasted


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
