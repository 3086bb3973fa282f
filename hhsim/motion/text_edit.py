"""Replacement of numbers in a text: whatever is not replaced stays as it is, sign for sign."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

from hhsim.arrays import FloatArray
from hhsim.motion.csv_table import Table

MOST_DECIMALS = 17
"""Largest number of decimals that is written."""


class NumberEdit(NamedTuple):
    """New value of the number at text[start:end], with at least so many decimals; NaN leaves it."""

    start: int
    end: int
    value: float
    decimals: int


class NewColumn(NamedTuple):
    """New values of a table's column, NaN where it stays, shape (N,), and the least number of their decimals."""

    values: FloatArray
    decimals: int


def edited(text: str, edits: Iterable[NumberEdit], decimal: str = ".") -> str:
    """Return the text with numbers replaced, each with as many decimals as it had, or more if the edit says so.

    A number of the same value is left as it is written.
    """
    parts, place = [], 0
    for edit in sorted(edits):
        old = text[edit.start : edit.end].replace(decimal, ".")
        try:
            same = float(old) == edit.value
        except ValueError:
            continue
        if same or edit.value != edit.value:
            continue
        digits, _, exponent = old.lower().partition("e")
        had = len(digits.partition(".")[2]) - int(exponent or 0)
        new = f"{edit.value:.{min(max(edit.decimals, had), MOST_DECIMALS)}f}"
        parts += [text[place : edit.start], new.replace(".", decimal)]
        place = edit.end
    return "".join([*parts, text[place:]])


def cell_edits(text: str, table: Table, rows: Sequence[int], columns: Mapping[str, NewColumn]) -> Iterator[NumberEdit]:
    """Yield the edits of a table's text for new values of some columns in some of its rows."""
    lines, starts = text.splitlines(), [0, *accumulate(map(len, text.splitlines(keepends=True)))]
    cells = [(table.header.index(column), new) for column, new in columns.items()]
    for k, row in enumerate(rows):
        number = table.lines[row] - 1
        spans = _cell_spans(lines[number], table.delimiter)
        for place, new in cells:
            first, last = spans[place]
            yield NumberEdit(starts[number] + first, starts[number] + last, float(new.values[k]), new.decimals)


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
