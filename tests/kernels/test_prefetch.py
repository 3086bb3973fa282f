"""Asking for memory ahead: it reaches the machine code, and changes nothing."""

import platform

import numpy as np
import pytest
from numpy.typing import NDArray

from hhsim.kernels.jit import JIT_ENABLED, jit
from hhsim.kernels.prefetch import prefetch


@jit
def total(rows: NDArray[np.float64]) -> float:
    found = 0.0
    for i in range(rows.shape[0]):
        # The last ones lie beyond the array.
        prefetch(rows, i + 4, 128)
        found += rows[i, 0]
    return found


def test_nothing_changes() -> None:
    rows = np.arange(320.0).reshape(20, 16)
    before = rows.copy()
    assert total(rows) == before[:, 0].sum()
    np.testing.assert_array_equal(rows, before)


@pytest.mark.skipif(not JIT_ENABLED or platform.machine() != "x86_64", reason="names an instruction of x86-64")
def test_each_line_is_asked_for() -> None:
    total(np.zeros((2, 16)))
    (code,) = total.inspect_asm().values()  # type: ignore[attr-defined]
    assert "prefetcht0" in code and "64(" in code
