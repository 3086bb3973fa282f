"""Replacement of numbers in the text of a table: whatever is not replaced stays as it is, sign for sign."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hhsim.arrays import FloatArray
from hhsim.motion.csv_table import Table

MOST_DECIMALS = 17
"""Largest number of decimals that is written."""


class NewColumn(NamedTuple):
    """New values of a table's column, NaN where it stays, shape (N,), and the least number of their decimals."""

    values: FloatArray
    decimals: int


def edited(text: str, table: Table, rows: Sequence[int], columns: Mapping[str, NewColumn]) -> str:
    """Return a table's text with new values of some columns in some of its rows.

    Each has as many decimals as the number had, or more if its column says so; one of the same value stays as written.
    """
    lines = text.splitlines(keepends=True)
    cells = sorted((table.header.index(column), new) for column, new in columns.items())
    for k, row in enumerate(rows):
        number = table.lines[row] - 1
        line = lines[number]
        spans = _cell_spans(line.splitlines()[0], table.delimiter)
        # From the last cell on, so that the places of those before stay.
        for place, new in reversed(cells):
            first, last = spans[place]
            cell = _new_number(line[first:last], float(new.values[k]), new.decimals, table.decimal)
            line = line[:first] + cell + line[last:]
        lines[number] = line
    return "".join(lines)


def _new_number(given: str, value: float, decimals: int, decimal: str) -> str:
    old = given.replace(decimal, ".")
    try:
        if float(old) == value or value != value:
            return given
    except ValueError:
        return given
    digits, _, exponent = old.lower().partition("e")
    had = len(digits.partition(".")[2]) - int(exponent or 0)
    return f"{value:.{min(max(decimals, had), MOST_DECIMALS)}f}".replace(".", decimal)


def _cell_spans(line: str, delimiter: str) -> list[tuple[int, int]]:
    """Return the places of the cells, without blanks and quotation marks around them."""
    if delimiter == " ":
        return [found.span() for found in re.finditer(r"\S+", line)]
    sign = re.escape(delimiter)
    spans = []
    for found in re.finditer(rf'(?:^|(?<={sign}))(?:"(?:[^"]|"")*"[^{sign}]*|[^{sign}]*)', line):
        bare = found[0].strip(' \t"\ufeff')
        first = found.start() + (found[0].index(bare) if bare else 0)
        spans.append((first, first + len(bare)))
    return spans
