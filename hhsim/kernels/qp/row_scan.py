"""Passes over the rows of a program a_i · x >= b_i: lengths, violations and the most violated row.

Rows are stored as a structure of arrays in groups: all rows share `common` columns 0 … n_common - 1; the rows of group
g have three more in `block`, which stand for the variables group_block[g] … + 2 (none where it is negative). A contact
of the coupled problem thus takes 9 numbers, not 21. `ProgramRows` have the widths of a hand's programs: 6 and 6 + 3 in
the palm's and the coupled one, 3 in a finger's. Each width is read in one loop. `WideRows`, as a free object's are,
have many groups of a few rows, and starting a group takes as long as reading it: the common columns are read over all
groups at once, and over the rows between them, in strips.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from hhsim.kernels.arithmetic import product
from hhsim.kernels.jit import Array, Indices, as_int64, generic, jit, jit_inline

ROWS_NAN = 1
"""A row or its right-hand side holds NaN."""
ROWS_ZERO = 2
"""A row is all zeros."""

STRIP = 6
"""Number of common columns of `WideRows` that are read together."""

STRETCH_ROWS = 64
"""Number of rows of which the largest violation is computed at a time."""


class ProgramRows(NamedTuple):
    """Rows a_i · x >= b_i of a program; no row is in two groups."""

    n_common: int  # number of columns that all rows share: 6, or 0 where each has three of its own
    common: Array  # (>= n_common, capacity)
    block: Array  # the rows' own three columns, (3, capacity)
    rhs: Array  # b, (capacity,)
    group_start: Indices  # first row of each group, (groups,)
    group_stop: Indices  # row after the last of each group, (groups,)
    group_block: Indices  # first variable of each group's block, -1 for none, (groups,)


class WideRows(NamedTuple):
    """Rows as those of `ProgramRows`, which share many columns and lie in many groups of a few rows.

    Dense rows have all columns behind the common ones; no group gives them a block.
    """

    n_common: int  # a positive multiple of STRIP
    common: Array
    block: Array
    rhs: Array
    group_start: Indices
    group_stop: Indices
    group_block: Indices
    dense: Array = np.zeros((1, 1))  # columns of dense rows behind the common ones, (>= dense_rows, >= dense_columns)
    dense_start: int = 0  # first dense row
    dense_rows: int = 0  # number of them, which follow each other
    dense_columns: int = 0  # number of columns behind the common ones


Rows: TypeAlias = ProgramRows | WideRows


# Plain loops over slices, few arrays in each and no name used for two of them: the compiler gives up the vector unit
# for an index that might be negative, and for more arrays than a few comparisons can tell apart.


@jit_inline
def _add_squares(start: int, stop: int, columns: Array, first: int, square_out: Array) -> None:
    square = square_out[start:stop]
    a, b, c = columns[first, start:stop], columns[first + 1, start:stop], columns[first + 2, start:stop]
    for i in range(stop - start):
        square[i] += product(a[i], b[i], c[i], a[i], b[i], c[i])


@jit_inline
def _nine_squares(start: int, stop: int, common: Array, block: Array, square_out: Array) -> None:
    square = square_out[start:stop]
    p, q, r = block[0, start:stop], block[1, start:stop], block[2, start:stop]
    a, b, c = common[0, start:stop], common[1, start:stop], common[2, start:stop]
    for i in range(stop - start):
        square[i] = product(p[i], q[i], r[i], p[i], q[i], r[i]) + product(a[i], b[i], c[i], a[i], b[i], c[i])
    d, e, f = common[3, start:stop], common[4, start:stop], common[5, start:stop]
    for i in range(stop - start):
        total = square[i] + product(d[i], e[i], f[i], d[i], e[i], f[i])
        square[i] = 1.0 / math.sqrt(total) if total > 0.0 else 0.0


@jit_inline
def _fill(start: int, stop: int, value: float, out: Array) -> None:
    part = out[start:stop]
    for i in range(stop - start):
        part[i] = value


@jit_inline
def _invert_root(start: int, stop: int, square_out: Array) -> None:
    square = square_out[start:stop]
    for i in range(stop - start):
        square[i] = 1.0 / math.sqrt(square[i]) if square[i] > 0.0 else 0.0


@jit_inline
def _row_range(rows: WideRows) -> tuple[int, int]:
    """Return the first row of any group, and the row after the last."""
    first, last = as_int64(0), as_int64(0)
    for g in range(rows.group_start.shape[0]):
        if rows.group_start[g] < rows.group_stop[g]:
            first = rows.group_start[g] if last == 0 else min(first, rows.group_start[g])
            last = max(last, rows.group_stop[g])
    return first, last


@generic
def row_lengths(rows: Rows, inverse_norm_out: Array) -> None:
    """Compute 1 / |a| of every row, 0 for a zero row, shape (capacity,)."""


@row_lengths.of(WideRows)
@jit_inline
def _wide_lengths(rows: WideRows, inverse_norm_out: Array) -> None:
    first, last = _row_range(rows)
    _fill(first, last, 0.0, inverse_norm_out)
    for g in range(rows.group_block.shape[0]):
        start, stop = rows.group_start[g], rows.group_stop[g]
        if rows.group_block[g] >= 0 and start < stop:
            _add_squares(start, stop, rows.block, as_int64(0), inverse_norm_out)
    for i in range(rows.dense_rows):
        for j in range(rows.dense_columns):
            inverse_norm_out[rows.dense_start + i] += rows.dense[i, j] ** 2
    for j in range(0, rows.n_common, 3):
        _add_squares(first, last, rows.common, j, inverse_norm_out)
    _invert_root(first, last, inverse_norm_out)


@row_lengths.of(ProgramRows)
@jit_inline
def _lengths(rows: ProgramRows, inverse_norm_out: Array) -> None:
    n_common, common, block = rows.n_common, rows.common, rows.block
    group_start, group_stop, group_block = rows.group_start, rows.group_stop, rows.group_block
    for g in range(group_block.shape[0]):
        start, stop = group_start[g], group_stop[g]
        if start == stop:
            continue
        if group_block[g] >= 0 and n_common == 6:
            _nine_squares(start, stop, common, block, inverse_norm_out)
            continue
        _fill(start, stop, 0.0, inverse_norm_out)
        if group_block[g] >= 0:
            _add_squares(start, stop, block, as_int64(0), inverse_norm_out)
        for j in range(0, n_common, 3):
            _add_squares(start, stop, common, j, inverse_norm_out)
        _invert_root(start, stop, inverse_norm_out)


@jit_inline
def _take_three(
    start: int, stop: int, columns: Array, first: int, x: Array, offset: int, source: Array, out: Array
) -> None:
    # out = source - three columns · x, where source may be out.
    left, right = out[start:stop], source[start:stop]
    a, b, c = columns[first, start:stop], columns[first + 1, start:stop], columns[first + 2, start:stop]
    x0, x1, x2 = x[offset], x[offset + 1], x[offset + 2]
    for i in range(stop - start):
        left[i] = right[i] - product(a[i], b[i], c[i], x0, x1, x2)


@jit_inline
def _take_three_and_scale(
    start: int, stop: int, columns: Array, x: Array, offset: int, source: Array, factor: Array, out: Array
) -> None:
    left, right, scale = out[start:stop], source[start:stop], factor[start:stop]
    a, b, c = columns[0, start:stop], columns[1, start:stop], columns[2, start:stop]
    x0, x1, x2 = x[offset], x[offset + 1], x[offset + 2]
    for i in range(stop - start):
        left[i] = (right[i] - product(a[i], b[i], c[i], x0, x1, x2)) * scale[i]


@jit_inline
def _take_six_and_scale(
    start: int, stop: int, columns: Array, first: int, x: Array, source: Array, factor: Array, out: Array
) -> None:
    left, right, scale = out[start:stop], source[start:stop], factor[start:stop]
    a, b, c = columns[first, start:stop], columns[first + 1, start:stop], columns[first + 2, start:stop]
    d, e, f = columns[first + 3, start:stop], columns[first + 4, start:stop], columns[first + 5, start:stop]
    x0, x1, x2, x3, x4, x5 = x[first], x[first + 1], x[first + 2], x[first + 3], x[first + 4], x[first + 5]
    for i in range(stop - start):
        rest = right[i] - product(a[i], b[i], c[i], x0, x1, x2)
        left[i] = (rest - product(d[i], e[i], f[i], x3, x4, x5)) * scale[i]


@jit_inline
def _take_six(start: int, stop: int, columns: Array, first: int, x: Array, out: Array) -> None:
    left = out[start:stop]
    a, b, c = columns[first, start:stop], columns[first + 1, start:stop], columns[first + 2, start:stop]
    d, e, f = columns[first + 3, start:stop], columns[first + 4, start:stop], columns[first + 5, start:stop]
    x0, x1, x2, x3, x4, x5 = x[first], x[first + 1], x[first + 2], x[first + 3], x[first + 4], x[first + 5]
    for i in range(stop - start):
        rest = left[i] - product(a[i], b[i], c[i], x0, x1, x2)
        left[i] = rest - product(d[i], e[i], f[i], x3, x4, x5)


@jit_inline
def _take_nine_and_scale(
    start: int, stop: int, common: Array, block: Array, x: Array, offset: int, source: Array, factor: Array, out: Array
) -> None:
    count = stop - start
    left, right, scale = out[start:stop], source[start:stop], factor[start:stop]
    p, q, r = block[0, start:stop], block[1, start:stop], block[2, start:stop]
    x6, x7, x8 = x[offset], x[offset + 1], x[offset + 2]
    for i in range(count):
        left[i] = right[i] - product(p[i], q[i], r[i], x6, x7, x8)
    a, b, c = common[0, start:stop], common[1, start:stop], common[2, start:stop]
    d, e, f = common[3, start:stop], common[4, start:stop], common[5, start:stop]
    x0, x1, x2, x3, x4, x5 = x[0], x[1], x[2], x[3], x[4], x[5]
    for i in range(count):
        rest = left[i] - product(a[i], b[i], c[i], x0, x1, x2)
        left[i] = (rest - product(d[i], e[i], f[i], x3, x4, x5)) * scale[i]


@jit_inline
def _copy(start: int, stop: int, source: Array, out: Array) -> None:
    left, right = out[start:stop], source[start:stop]
    for i in range(stop - start):
        left[i] = right[i]


@generic
def row_violations(rows: Rows, x: Array, inverse_norm: Array, violation: Array) -> None:
    """Compute the normalised violation (b - a · x) / |a| of every row, shape (capacity,)."""


@row_violations.of(WideRows)
@jit_inline
def _wide_violations(rows: WideRows, x: Array, inverse_norm: Array, violation: Array) -> None:
    n_common, common = rows.n_common, rows.common
    first, last = _row_range(rows)
    _copy(first, last, rows.rhs, violation)
    for g in range(rows.group_block.shape[0]):
        start, stop, offset = rows.group_start[g], rows.group_stop[g], rows.group_block[g]
        if offset >= 0 and start < stop:
            _take_three(start, stop, rows.block, as_int64(0), x, offset, violation, violation)
    for i in range(rows.dense_rows):
        rest = violation[rows.dense_start + i]
        for j in range(rows.dense_columns):
            rest -= rows.dense[i, j] * x[n_common + j]
        violation[rows.dense_start + i] = rest
    for j in range(0, n_common - STRIP, STRIP):
        _take_six(first, last, common, j, x, violation)
    _take_six_and_scale(first, last, common, n_common - STRIP, x, violation, inverse_norm, violation)


@row_violations.of(ProgramRows)
@jit_inline
def _violations(rows: ProgramRows, x: Array, inverse_norm: Array, violation: Array) -> None:
    n_common, common, block, rhs = rows.n_common, rows.common, rows.block, rows.rhs
    group_start, group_stop, group_block = rows.group_start, rows.group_stop, rows.group_block
    for g in range(group_block.shape[0]):
        start, stop, offset = group_start[g], group_stop[g], group_block[g]
        if start == stop:
            continue
        if n_common == 0:
            _take_three_and_scale(start, stop, block, x, offset, rhs, inverse_norm, violation)
        elif offset < 0:
            _take_six_and_scale(start, stop, common, as_int64(0), x, rhs, inverse_norm, violation)
        else:
            _take_nine_and_scale(start, stop, common, block, x, offset, rhs, inverse_norm, violation)


@generic
def load_dense(rows: Rows, row: int, scale: float, normal_out: Array) -> bool:
    """Write a row of which all columns are given, scaled, and return True; False for another row."""


@load_dense.of(WideRows)
@jit_inline
def _load_wide(rows: WideRows, row: int, scale: float, normal_out: Array) -> bool:
    i = row - rows.dense_start
    if i < 0 or i >= rows.dense_rows:
        return False
    for j in range(rows.n_common):
        normal_out[j] = rows.common[j, row] * scale
    for j in range(rows.dense_columns):
        normal_out[rows.n_common + j] = rows.dense[i, j] * scale
    return True


@load_dense.of(ProgramRows)
@jit_inline
def _no_dense(rows: Rows, row: int, scale: float, normal_out: Array) -> bool:
    return False


@jit_inline
def _unsound(start: int, stop: int, inverse_norm: Array, violation: Array) -> tuple[int, int]:
    values, lengths = violation[start:stop], inverse_norm[start:stop]
    nan, zero = 0, 0
    for i in range(stop - start):
        nan += values[i] != values[i]
        zero += lengths[i] == 0.0
    return nan, zero


@jit
def unsound_rows(rows: Rows, inverse_norm: Array, violation: Array) -> int:
    """Return the ROWS_NAN and ROWS_ZERO bits of the results of `row_lengths` and `row_violations`."""
    nans, zeros = 0, 0
    for g in range(rows.group_start.shape[0]):
        nan, zero = _unsound(rows.group_start[g], rows.group_stop[g], inverse_norm, violation)
        nans += nan
        zeros += zero
    return (ROWS_NAN if nans > 0 else 0) | (ROWS_ZERO if zeros > 0 else 0)


@jit
def _largest(values: Array, start: int, stop: int) -> float:
    # Eight chains at a time, where one would wait for its own last comparison; NaN never wins.
    part = values[start:stop]
    b0 = b1 = b2 = b3 = b4 = b5 = b6 = b7 = -np.inf
    whole = (stop - start) // 8
    for c in range(whole):
        v = part[8 * c : 8 * c + 8]
        b0 = v[0] if v[0] > b0 else b0
        b1 = v[1] if v[1] > b1 else b1
        b2 = v[2] if v[2] > b2 else b2
        b3 = v[3] if v[3] > b3 else b3
        b4 = v[4] if v[4] > b4 else b4
        b5 = v[5] if v[5] > b5 else b5
        b6 = v[6] if v[6] > b6 else b6
        b7 = v[7] if v[7] > b7 else b7
    rest = part[8 * whole :]
    for i in range(rest.shape[0]):
        b0 = rest[i] if rest[i] > b0 else b0
    b0 = b0 if b0 > b1 else b1
    b2 = b2 if b2 > b3 else b3
    b4 = b4 if b4 > b5 else b5
    b6 = b6 if b6 > b7 else b7
    b0 = b0 if b0 > b2 else b2
    b4 = b4 if b4 > b6 else b6
    return b0 if b0 > b4 else b4


@jit
def most_violated(violation: Array, rows: Rows) -> int:
    """Return the first row with the largest violation; -1 if there is no row, or NaN only."""
    best, place = -np.inf, as_int64(-1)
    for g in range(rows.group_start.shape[0]):
        start, stop = rows.group_start[g], rows.group_stop[g]
        while start < stop:
            end = min(start + STRETCH_ROWS, stop)
            largest = _largest(violation, start, end)
            if largest > best:
                best, place = largest, start
            start = end
    if place >= 0:
        while violation[place] != best:
            place += 1
    return place
