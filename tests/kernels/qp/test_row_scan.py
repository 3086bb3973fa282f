"""Passes over a program's rows against the plain matrix that they stand for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from qp_problems import Program, kernel_rows

from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.qp.active_set import CAPACITY, N_MAX
from hhsim.kernels.qp.row_scan import (
    ROWS_NAN,
    ROWS_ZERO,
    STRIP,
    ProgramRows,
    WideRows,
    most_violated,
    row_lengths,
    row_violations,
    unsound_rows,
)

SIZES = [0, 1, 2, 7, 8, 9, 31, 64, 65, 200]


def rows_in(start: int, stop: int) -> ProgramRows:
    """One group of rows, for what asks only where it lies."""
    none = np.empty((0, stop))
    return ProgramRows(0, none, none, np.empty(stop), np.array([start]), np.array([stop]), np.array([-1]))


@settings(max_examples=200)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 3),
    st.lists(st.sampled_from(SIZES), min_size=1, max_size=4),
    st.booleans(),
    st.sampled_from([ProgramRows, WideRows]),
)
def test_lengths_and_violations_are_those_of_the_dense_matrix(
    seed: int, strips: int, sizes: list[int], with_block: bool, kind: type[ProgramRows | WideRows]
) -> None:
    rng = np.random.default_rng(seed)
    n_common = STRIP * (min(strips, 1) if kind is ProgramRows else max(strips, 1))
    gap = rng.integers(0, 3, size=len(sizes))
    start = np.cumsum(np.array(sizes) + gap) - sizes
    stop = start + sizes
    rows = int(stop[-1]) + 1
    blocks = rng.integers(0, 2, size=len(sizes)) if with_block else np.zeros(len(sizes), dtype=np.int64)
    if n_common == 0:
        blocks[:] = 1
    offset = np.where(blocks > 0, n_common + 3 * np.arange(len(sizes)), -1)
    n = n_common + 3 * len(sizes)
    common, block = rng.normal(size=(n_common, rows)), rng.normal(size=(3, rows))
    rhs, x = rng.normal(size=rows), rng.normal(size=n)
    plain = Program(common, block, rhs, np.array([start, stop, offset]), x, 0.0, 0.0)
    dense = plain.matrix
    used = np.concatenate([np.arange(a, b) for a, b in zip(start, stop)])
    inverse_norm, violation = np.full(rows, np.nan), np.full(rows, np.nan)
    program = kernel_rows(plain, kind)
    row_lengths(program, inverse_norm)
    row_violations(program, x, inverse_norm, violation)
    norm = np.linalg.norm(dense, axis=1)
    inverse = np.divide(1.0, norm, out=np.zeros(rows), where=norm > 0.0)
    np.testing.assert_allclose(inverse_norm[used], inverse[used], rtol=1e-13)
    np.testing.assert_allclose(violation[used], ((rhs - dense @ x) * inverse)[used], atol=1e-12)
    unused = np.setdiff1d(np.arange(rows), used)
    if kind is WideRows and used.size > 0:
        # What lies between the groups is read with them; no group holds it, and nobody asks for it.
        unused = unused[(unused < used.min()) | (unused > used.max())]
    assert np.isnan(violation[unused]).all()
    assert np.isnan(inverse_norm[unused]).all()
    expected = -1 if used.size == 0 else used[np.argmax(violation[used])]
    assert most_violated(violation, program) == expected
    zero = (norm[used] == 0.0).any()
    assert unsound_rows(program, inverse_norm, violation) == (ROWS_ZERO if zero else 0)


@pytest.mark.parametrize("place", [0, 7, 8, 63, 64, 99])
def test_the_first_of_equal_rows_is_taken_and_nan_never(place: int) -> None:
    violation = np.zeros(100)
    violation[place:] = 1.0
    rows = rows_in(0, 100)
    assert most_violated(violation, rows) == place
    violation[place] = np.nan
    assert most_violated(violation, rows) == (place + 1 if place < 99 else 0)
    assert most_violated(np.full(100, np.nan), rows) == -1
    assert most_violated(violation, rows_in(0, 0)) == -1


def test_unsound_rows_are_told() -> None:
    rows = rows_in(1, 9)
    lengths, violation = np.ones(10), np.zeros(10)
    lengths[0], violation[9] = 0.0, np.nan
    assert unsound_rows(rows, lengths, violation) == 0
    violation[4] = np.nan
    assert unsound_rows(rows, lengths, violation) == ROWS_NAN
    lengths[5] = 0.0
    assert unsound_rows(rows, lengths, violation) == ROWS_NAN | ROWS_ZERO


def test_the_common_workspace_holds_every_program_of_a_hand() -> None:
    assert N_MAX >= DOF
    assert CAPACITY >= ROW_CAPACITY
