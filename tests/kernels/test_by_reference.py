"""NamedTuples that kernels take by reference: a call leaves no reference behind, which would leak what it was given."""

import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, jit, jit_allocating


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
