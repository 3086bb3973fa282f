"""Passes over the rows of a program a_i · x >= b_i: lengths, violations and the most violated row.

Rows are stored as a structure of arrays in groups: all rows share `common` columns 0 … n_common - 1; the rows of group
g have three more in `block`, which stand for the variables group_block[g] … + 2 (none where it is negative). A contact
of the coupled problem thus takes 9 numbers, not 21. A program of several bodies has many groups of a few rows, and
starting a group takes as long as reading it: the common columns are read over all groups at once, and over the rows
between them, in strips.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import product
from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_inline

ROWS_NAN = 1
"""A row or its right-hand side holds NaN."""
ROWS_ZERO = 2
"""A row is all zeros."""

STRIP = 6
"""Number of common columns that are read together."""

STRETCH_ROWS = 64
"""Number of rows of which the largest violation is computed at a time."""


class Rows(NamedTuple):
    """Rows a_i · x >= b_i of a program; no row is in two groups.

    Dense rows have all columns behind the common ones; no group gives them a block.
    """

    n_common: int  # number of columns that all rows share, a multiple of STRIP; 0 where each has three of its own
    common: Array  # (>= n_common, capacity)
    block: Array  # the rows' own three columns, (3, capacity)
    rhs: Array  # b, (capacity,)
    group_start: Indices  # first row of each group, (groups,)
    group_stop: Indices  # row after the last of each group, (groups,)
    group_block: Indices  # first variable of each group's block, -1 for none, (groups,)
    dense: Array = np.zeros((1, 1))  # columns of dense rows behind the common ones, (>= dense_rows, >= dense_columns)
    dense_start: int = 0  # first dense row
    dense_rows: int = 0  # number of them, which follow each other
    dense_columns: int = 0  # number of columns behind the common ones


# Plain loops over slices, few arrays in each and no name used for two of them: the compiler gives up the vector unit
# for an index that might be negative, and for more arrays than a few comparisons can tell apart.


@jit_inline
def _add_squares(start: int, stop: int, columns: Array, first: int, square_out: Array) -> None:
    square = square_out[start:stop]
    a, b, c = columns[first, start:stop], columns[first + 1, start:stop], columns[first + 2, start:stop]
    for i in range(stop - start):
        square[i] += product(a[i], b[i], c[i], a[i], b[i], c[i])


@jit_inline
def _row_range(rows: Rows) -> tuple[int, int]:
    """Return the first row of any group, and the row after the last."""
    first, last = as_int64(0), as_int64(0)
    for g in range(rows.group_start.shape[0]):
        if rows.group_start[g] < rows.group_stop[g]:
            first = rows.group_start[g] if last == 0 else min(first, rows.group_start[g])
            last = max(last, rows.group_stop[g])
    return first, last


@jit_inline
def row_lengths(rows: Rows, inverse_norm_out: Array) -> None:
    """Compute 1 / |a| of every row, 0 for a zero row, shape (capacity,)."""
    first, last = _row_range(rows)
    square = inverse_norm_out[first:last]
    for i in range(last - first):
        square[i] = 0.0
    for g in range(rows.group_block.shape[0]):
        start, stop = rows.group_start[g], rows.group_stop[g]
        if rows.group_block[g] >= 0 and start < stop:
            _add_squares(start, stop, rows.block, as_int64(0), inverse_norm_out)
    for i in range(rows.dense_rows):
        for j in range(rows.dense_columns):
            inverse_norm_out[rows.dense_start + i] += rows.dense[i, j] ** 2
    for j in range(0, rows.n_common, 3):
        _add_squares(first, last, rows.common, j, inverse_norm_out)
    for i in range(last - first):
        square[i] = 1.0 / math.sqrt(square[i]) if square[i] > 0.0 else 0.0


@jit_inline
def _take_three(start: int, stop: int, columns: Array, x: Array, offset: int, out: Array) -> None:
    left = out[start:stop]
    a, b, c = columns[0, start:stop], columns[1, start:stop], columns[2, start:stop]
    x0, x1, x2 = x[offset], x[offset + 1], x[offset + 2]
    for i in range(stop - start):
        left[i] -= product(a[i], b[i], c[i], x0, x1, x2)


@jit_inline
def _take_six_and_scale(start: int, stop: int, columns: Array, first: int, x: Array, factor: Array, out: Array) -> None:
    left, scale = out[start:stop], factor[start:stop]
    a, b, c = columns[first, start:stop], columns[first + 1, start:stop], columns[first + 2, start:stop]
    d, e, f = columns[first + 3, start:stop], columns[first + 4, start:stop], columns[first + 5, start:stop]
    x0, x1, x2, x3, x4, x5 = x[first], x[first + 1], x[first + 2], x[first + 3], x[first + 4], x[first + 5]
    for i in range(stop - start):
        rest = left[i] - product(a[i], b[i], c[i], x0, x1, x2)
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
def _copy(start: int, stop: int, source: Array, out: Array) -> None:
    left, right = out[start:stop], source[start:stop]
    for i in range(stop - start):
        left[i] = right[i]


@jit_inline
def _scale(start: int, stop: int, factor: Array, out: Array) -> None:
    left, scale = out[start:stop], factor[start:stop]
    for i in range(stop - start):
        left[i] *= scale[i]


@jit_inline
def row_violations(rows: Rows, x: Array, inverse_norm: Array, violation: Array) -> None:
    """Compute the normalised violation (b - a · x) / |a| of every row, shape (capacity,)."""
    n_common, common = rows.n_common, rows.common
    first, last = _row_range(rows)
    _copy(first, last, rows.rhs, violation)
    for g in range(rows.group_block.shape[0]):
        start, stop, offset = rows.group_start[g], rows.group_stop[g], rows.group_block[g]
        if offset >= 0 and start < stop:
            _take_three(start, stop, rows.block, x, offset, violation)
    for i in range(rows.dense_rows):
        rest = violation[rows.dense_start + i]
        for j in range(rows.dense_columns):
            rest -= rows.dense[i, j] * x[n_common + j]
        violation[rows.dense_start + i] = rest
    if n_common == 0:
        _scale(first, last, inverse_norm, violation)
        return
    for j in range(0, n_common - STRIP, STRIP):
        _take_six(first, last, common, j, x, violation)
    _take_six_and_scale(first, last, common, n_common - STRIP, x, inverse_norm, violation)


@jit_inline
def load_dense(rows: Rows, row: int, scale: float, normal_out: Array) -> bool:
    """Write a row of which all columns are given, scaled, and return True; False for another row."""
    i = row - rows.dense_start
    if i < 0 or i >= rows.dense_rows:
        return False
    for j in range(rows.n_common):
        normal_out[j] = rows.common[j, row] * scale
    for j in range(rows.dense_columns):
        normal_out[rows.n_common + j] = rows.dense[i, j] * scale
    return True


@jit
def unsound_rows(rows: Rows, inverse_norm: Array, violation: Array) -> int:
    """Return the ROWS_NAN and ROWS_ZERO bits of the results of `row_lengths` and `row_violations`."""
    nans, zeros = 0, 0
    for g in range(rows.group_start.shape[0]):
        values = violation[rows.group_start[g] : rows.group_stop[g]]
        lengths = inverse_norm[rows.group_start[g] : rows.group_stop[g]]
        for i in range(values.shape[0]):
            nans += values[i] != values[i]
            zeros += lengths[i] == 0.0
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
