"""The jit factory: a kernel with one implementation for each type."""

from typing import Any, NamedTuple

import pytest

from hhsim.kernels.jit import generic, jit


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
