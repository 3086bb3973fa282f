"""NamedTuples that kernels take by reference, against the same function of Python."""

import pickle
import sys
from itertools import pairwise
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.extending import intrinsic

from hhsim.kernels.by_reference import Reference, by_reference, declare_row, write_rows
from hhsim.kernels.jit import JIT_ENABLED, Array, Indices, jit, jit_allocating

pytestmark = pytest.mark.skipif(not JIT_ENABLED, reason="the kernels are not compiled here")


@by_reference
class Part(NamedTuple):
    """A record with a field of each kind that kernels have."""

    flag: bool
    size: int
    scale: float
    values: Array
    rows: Indices


@by_reference
class Whole(NamedTuple):
    """A record that holds another one, and a tuple of some."""

    first: Part
    parts: tuple[Part, ...]
    offset: float


class Plain(NamedTuple):
    """A record by value that holds one by reference."""

    part: Part


def total(part: Part, factor: float) -> float:
    """Sum what a part holds, weighted."""
    found = 1.0 if part.flag else -1.0
    for i in range(part.size):
        found += factor * part.scale * part.values[i] * part.rows[i]
    part.values[0] += 1.0
    return found


inner = jit(total)


def outer(whole: Whole, plain: Plain, which: int) -> float:
    """Choose a part by a number that is known when it runs."""
    return inner(whole.parts[which], whole.offset) + inner(whole.first, 2.0) + inner(plain.part, 0.5)


compiled: Any = jit(outer)


def allocating(whole: Whole, plain: Plain, which: int) -> Array:
    """Return what `outer` does in an array of its own."""
    return np.full(1, inner(whole.parts[which], whole.offset) + inner(plain.part, 0.5))


counting: Any = jit_allocating(allocating)


def part_of(seed: int, count: int) -> Part:
    rng = np.random.default_rng(seed)
    return Part(bool(seed % 2), count, float(rng.normal()), rng.normal(size=count), rng.integers(-9, 9, count))


@by_reference
class Pair(NamedTuple):
    """A record in one of `Nested`."""

    values: Array
    rows: Indices


@by_reference
class Nested(NamedTuple):
    """A record as those of parts of a surface: another one first, arrays of several dimensions, a number last."""

    inner: Pair
    block: Array
    size: int


def weighed(nested: Nested) -> float:
    """Sum what a record holds, each value by its place."""
    found = 100.0 * nested.size
    for i in range(nested.inner.values.shape[0]):
        found += (i + 1) * nested.inner.values[i] + (i + 2) * nested.inner.rows[i]
    for i in range(nested.block.shape[0]):
        for j in range(nested.block.shape[1]):
            found += (3 * i + 2 * j + 1) * nested.block[i, j]
    nested.inner.values[0] += 1.0
    return found


@by_reference
class Loaded(NamedTuple):
    """A record as that of a whole surface: a record with a record in it, and a factor."""

    nested: Nested
    factor: float


weigh = jit(weighed)
nested_in_row = intrinsic(declare_row)


def from_row(like: Loaded, rows: Indices, number: int) -> float:
    """Return what `weighed` does for the record in a row, times its factor."""
    loaded = nested_in_row(like, rows, number, 0)
    return loaded.factor * weigh(loaded.nested)


in_row: Any = jit(from_row)


@given(st.integers(0, 1000), st.lists(st.integers(1, 5), min_size=1, max_size=4))
def test_what_is_written_in_rows_is_read_as_python_does(seed: int, counts: list[int]) -> None:
    rng = np.random.default_rng(seed)
    # Slices of common arrays, as the parts of a surface are.
    ends = np.cumsum([0, *counts])
    values, whole, block = rng.normal(size=ends[-1]), rng.integers(-9, 9, ends[-1]), rng.normal(size=(ends[-1], 3))
    spans = [slice(*span) for span in pairwise(ends)]
    parts = [Nested(Pair(values[span], whole[span]), block[span], k) for k, span in enumerate(spans)]
    rows = write_rows([Loaded(part, 0.5 - k) for k, part in enumerate(parts)])
    like = Loaded(Nested(Pair(values, whole), block, 7), 1.0)
    for number, part in enumerate(parts):
        before = part.inner.values[0]
        expected = weighed(part._replace(inner=Pair(part.inner.values.copy(), part.inner.rows)))
        assert in_row(like, rows, number) == pytest.approx((0.5 - number) * expected, rel=1e-12, abs=1e-12)
        assert part.inner.values[0] == before + 1.0


@given(st.integers(0, 1000), st.integers(1, 5), st.integers(0, 2))
def test_fields_are_read_and_arrays_written_as_python_does(seed: int, count: int, which: int) -> None:
    parts = tuple(part_of(seed + k, count) for k in range(3))
    given = Whole(part_of(seed + 3, count), parts, 0.25), Plain(part_of(seed + 4, count)), which
    twin = pickle.loads(pickle.dumps(given))
    assert compiled(*given) == outer(*twin)
    for one, other in zip((given[0].first, *parts, given[1].part), (twin[0].first, *twin[0].parts, twin[1].part)):
        np.testing.assert_array_equal(one.values, other.values)


def test_a_kernel_is_compiled_once_for_equal_types_and_its_symbol_is_short() -> None:
    compiled(Whole(part_of(1, 2), (part_of(2, 2),) * 3, 1.0), Plain(part_of(3, 2)), 0)
    known = len(compiled.signatures)
    compiled(Whole(part_of(4, 3), (part_of(5, 3),) * 3, 1.0), Plain(part_of(6, 3)), 1)
    assert len(compiled.signatures) == known
    kinds = compiled.signatures[0]
    assert isinstance(kinds[0], Reference)
    assert len(str(kinds[0])) < 40
    assert pickle.loads(pickle.dumps(kinds[0])) == kinds[0]


def test_other_types_of_fields_are_another_type() -> None:
    part, kernel = part_of(1, 2), cast(Any, inner)
    other: Any = part.values
    assert len({str(kernel.typeof_pyval(each)) for each in (part, part._replace(rows=other))}) == 2


@pytest.mark.parametrize("kernel", [compiled, counting], ids=["plain", "allocating"])
def test_a_call_keeps_no_hold_of_what_it_was_given(kernel: Any) -> None:
    whole, plain = Whole(part_of(1, 2), (part_of(2, 2),) * 3, 1.0), Plain(part_of(3, 2))
    arrays = [array for part in (whole.first, *whole.parts, plain.part) for array in (part.values, part.rows)]
    before = [sys.getrefcount(array) for array in arrays]
    for _ in range(3):
        kernel(whole, plain, 1)
    assert [sys.getrefcount(array) for array in arrays] == before
