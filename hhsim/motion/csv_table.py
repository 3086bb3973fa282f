"""Tables as CSV text of any maker, with their header.

Delimiters are commas, semicolons, tabs or blanks; lines that begin with # before the header are remarks. Where the
delimiter is no comma, numbers may have a decimal comma, as a German Excel writes them. A strict reader refuses a line
or a cell that it cannot read; a lenient one leaves the line out or the cell missing, and says so. `edited` replaces
numbers in a text; whatever is not replaced stays as it is, sign for sign.
"""

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, check_known
from hhsim.system.counted import counted

DELIMITERS = (",", ";", "\t")
"""Delimiters in the order of preference; a header without any is delimited by blanks."""
COMMA_NUMBER = re.compile(r"[-+]?[0-9]*,[0-9]+(?:[eE][-+]?[0-9]+)?|[-+]?[0-9]+,")
"""Number with a decimal comma."""
DECIMAL_POINT = " with a decimal point"
"""Expectation for a number with a comma."""
MISSING = {"", "na", "n/a", "null", "none", "-"}
"""Words for a missing number, beside those for NaN and infinity."""
MOST_BROKEN = 0.25
"""Largest share of lines, or of a column's cells, that may be unreadable."""
MOST_LINES = 10_000_000
"""Largest number of lines: three hours at 1 kHz."""
MOST_DECIMALS = 17
"""Largest number of decimals of a number that is written in the place of another."""


@dataclass(frozen=True)
class Table:
    """Table of text cells."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]  # cells, as many a row as there are names in the header
    lines: Sequence[int]  # number of each row's line in the text, from 1 on
    remarks: dict[str, str]  # the `# key: value` lines before the header
    decimal: str = "."  # decimal sign
    strict: bool = False  # True if every cell of a column has to be a number, or marked as missing
    notes: tuple[str, ...] = ()  # sentences about lines that were left out, and a decimal sign that was found
    delimiter: str = ","  # sign between cells; a blank stands for any number of them

    def numbers(self, columns: Sequence[str]) -> tuple[FloatArray, int]:
        """Return the numbers of some columns, shape (T, C), NaN for missing ones, and the count of unreadable cells.

        Raises TrajectoryError for a column without numbers, or a strict table's cell without one; UnknownNameError,
        with similar names, for a column that the table has not.
        """
        check_known("column", columns, self.header)
        values = np.full((len(self.rows), len(columns)), np.nan)
        broken = 0
        places = {name: index for index, name in reversed([*enumerate(self.header)])}
        for place, column in enumerate(columns):
            index = places[column]
            numbers = [_number(cells[index], self.decimal) for cells in self.rows]
            bad = [row for row, number in enumerate(numbers) if number is None]
            if len(bad) > (0.0 if self.strict else MOST_BROKEN) * len(self.rows):
                cell = self.rows[bad[0]][index].strip()[:40]
                point = DECIMAL_POINT if "," in cell else ""
                raise TrajectoryError(f"line {self.lines[bad[0]]}: {column} is '{cell}'; expected a number{point}")
            values[:, place] = [math.nan if number is None else number for number in numbers]
            broken += len(bad)
        return values, broken

    def text(self, column: str) -> list[str]:
        """Return the cells of a column as text."""
        index = self.header.index(column)
        return [cells[index].strip() for cells in self.rows]


def read_table(text: str, *, names: Sequence[str] | None = None, strict: bool = False) -> Table:
    """Read a table; `names` are the columns of one without a header line.

    The delimiter is detected in the header, the decimal sign in the numbers; `strict` refuses every line with more or
    fewer cells than the header.
    Raises TrajectoryError for no header, no line below it, two columns of one name, or many lines of another length.
    """
    lines = text.splitlines()
    remarks, first, sign, header = _header(lines)
    if len(lines) > MOST_LINES:
        raise TrajectoryError(f"{len(lines):,} lines; expected at most {MOST_LINES:,}")
    below = first + 1
    if names is not None:
        header, below = tuple(names), first
    elif lacks_names(header):
        shown = ", ".join(cell[:12] for cell in header[:3])
        raise TrajectoryError(f"no header line, the first one holds {shown}, …; expected the names of the columns")
    if twice := next((name for name, count in Counter(header).items() if name and count > 1), ""):
        raise TrajectoryError(f"the header has column {twice[:40]} twice")
    notes = []
    if not strict and len(lines) > below + 1 and not text.endswith(("\n", "\r")):
        # A number that was cut in the middle is a wrong number that looks like a right one.
        notes.append(f"line {len(lines)}, the last one, has no line end: left out, it may have been cut")
        lines.pop()
    rows: dict[int, tuple[str, ...]] = {}
    broken: dict[int, int] = {}
    for number, line in enumerate(lines[below:], start=below + 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = _cells(line, sign)
        if len(cells) == len(header):
            rows[number] = tuple(cells)
        else:
            broken[number] = len(cells)
    if len(broken) > (0.0 if strict else MOST_BROKEN) * (len(rows) + len(broken)):
        number, size = next(iter(broken.items()))
        count = f"{len(broken)} of {counted(len(rows) + len(broken), 'line')} of another length than the header's"
        raise TrajectoryError(f"line {number} has {counted(size, 'value')}; expected {len(header)} ({count})")
    if not rows:
        raise TrajectoryError("no line below the header; expected one a sample")
    if broken:
        left = counted(len(broken), "line")
        notes.append(f"{left} with another number of cells than the header left out, first line {next(iter(broken))}")
    decimal = "," if sign != "," and _has_decimal_commas(rows.values()) else "."
    if decimal == ",":
        notes.append("decimal commas, which part no cells here: read as decimal points")
    return Table(header, tuple(rows.values()), tuple(rows), remarks, decimal, strict, tuple(notes), sign)


def _has_decimal_commas(rows: Collection[Sequence[str]]) -> bool:
    """Return True if cells are numbers with a comma; with decimal points elsewhere, commas may part thousands."""
    commas = any(COMMA_NUMBER.fullmatch(cell.strip(' "')) for cells in rows for cell in cells if "," in cell)
    return commas and not any("." in cell and _number(cell, ".") is not None for cells in rows for cell in cells)


def format_table(remarks: Mapping[str, str], header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return the CSV text of a table with commas, and `# key: value` lines before it."""
    text = io.StringIO()
    for key, value in remarks.items():
        # A line break in a value would end the remark.
        text.write(f"# {key}: {' '.join(value.split())}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def read_header(text: str) -> tuple[str, ...]:
    """Return the names of a table's columns; raise TrajectoryError if there is no header."""
    return _header(text.splitlines())[3]


def read_remarks(text: str) -> dict[str, str]:
    """Return the `# key: value` lines before a table's header; raise TrajectoryError if there is no header."""
    return _header(text.splitlines())[0]


def lacks_names(header: Sequence[str]) -> bool:
    """Return True if a header is a sample: all numbers, and not all whole as the names 0, 1, 2 are."""
    return _all_numbers(header) and not all(cell.isdecimal() for cell in header)


def _all_numbers(cells: Iterable[str]) -> bool:
    return all(_number(cell, ",") is not None for cell in cells)


def _header(lines: Sequence[str]) -> tuple[dict[str, str], int, str, tuple[str, ...]]:
    """Return the remarks, the index of the header line, its delimiter, and the names in it."""
    remarks = {}
    for index, line in enumerate(lines):
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            if colon:
                remarks[key.strip()] = value.strip()
        elif line.strip():
            # Of numbers with decimal commas the commas are more than the delimiters.
            bare = (sign for sign in DELIMITERS[1:] if sign in line and _all_numbers(line.split(sign)))
            sign = next(bare, max(DELIMITERS, key=line.count))
            sign = sign if sign in line else " "
            return remarks, index, sign, tuple(cell.strip() for cell in _cells(line, sign))
    raise TrajectoryError("no header line; expected the names of the columns")


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        # Line by line, so that a stray quotation mark spoils one line and not the rest of the file.
        return next(csv.reader([line.replace("\0", "?")], delimiter=delimiter), [])
    except csv.Error:
        return []


def _number(cell: str, decimal: str) -> float | None:
    """Return the number in a cell, NaN for one that is missing or not finite, None for other text."""
    word = cell.strip().strip('"')
    if "_" in word:
        return None
    try:
        value = float(word if decimal == "." else word.replace(decimal, "."))
    except ValueError:
        return math.nan if word.lower() in MISSING else None
    return value if math.isfinite(value) else math.nan


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
