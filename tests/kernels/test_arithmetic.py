"""Fused products and sums in lanes are rounded as exact arithmetic says."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.kernels.arithmetic import LANES, dot, fused, least_above
from hhsim.kernels.jit import Array, jit

NUMBERS = st.floats(-1e100, 1e100, allow_subnormal=False)


@jit
def fused_of(first: float, second: float, third: float) -> float:
    return fused(first, second, third)


@jit
def dot_of(first: Array, second: Array, chunks: int) -> float:
    return dot(first, second, chunks)


def rounded_once(first: float, second: float, third: float) -> float:
    return float(Fraction(first) * Fraction(second) + Fraction(third))


@given(NUMBERS, NUMBERS, NUMBERS)
def test_a_fused_product_is_rounded_once(first: float, second: float, third: float) -> None:
    assert fused_of(first, second, third) == rounded_once(first, second, third)
    near = -first * second
    assert fused_of(first, second, near) == rounded_once(first, second, near)


def test_a_fused_product_keeps_what_is_not_finite() -> None:
    assert math.isnan(fused_of(math.inf, 0.0, 1.0))
    assert fused_of(math.inf, -1.0, 1.0) == -math.inf


@pytest.mark.parametrize("chunks", [0, 1, 2, 5])
def test_a_sum_is_that_of_its_lanes_by_halves(chunks: int) -> None:
    random = np.random.default_rng(chunks)
    for _ in range(20):
        first, second = random.normal(size=(2, LANES * chunks)) * 10.0 ** random.integers(-8, 8, (2, LANES * chunks))
        lanes = [0.0] * LANES
        for i, (a, b) in enumerate(zip(first, second, strict=True)):
            lanes[i % LANES] = rounded_once(float(a), float(b), lanes[i % LANES])
        while len(lanes) > 1:
            lanes = [low + high for low, high in zip(lanes[: len(lanes) // 2], lanes[len(lanes) // 2 :], strict=True)]
        assert dot_of(first, second, chunks) == lanes[0]


@jit
def least_of(values: Array, start: int, stop: int, above: float) -> float:
    return least_above(values, start, stop, above)


@given(st.lists(st.floats(allow_nan=False), max_size=40), st.integers(0, 9), st.floats(allow_nan=False))
def test_the_least_above_a_bound(values: list[float], start: int, above: float) -> None:
    expected = min((value for value in values[start:] if value > above), default=math.inf)
    assert least_of(np.array(values), min(start, len(values)), len(values), above) == expected
