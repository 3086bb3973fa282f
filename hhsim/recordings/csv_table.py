"""Reader of CSV tables of any maker, which reports what it cannot read as missing instead of refusing it.

Delimiters are commas, semicolons, tabs or blanks; lines that begin with # before the header are remarks.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.motion.csv_file import DECIMAL_POINT, SEPARATORS, read_remarks, separator_of
from hhsim.recordings.recording import MOST_SAMPLES, Finding, note
from hhsim.system.counted import counted

DELIMITERS = (*SEPARATORS, " ")
MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "inf", "-inf", "+inf", "infinity", "-infinity"}
MOST_BROKEN = 0.25
"""Largest share of lines, or of a column's cells, that may be unreadable."""


@dataclass(frozen=True)
class Table:
    """Table of text cells.

    Attributes:
        rows: Cells, as many a row as there are names in the header.
        remarks: The `# key: value` lines before the header.
        findings: Notes about lines that were left out.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    remarks: dict[str, str]
    decimal: str
    findings: tuple[Finding, ...]

    def numbers(self, columns: Sequence[str]) -> tuple[FloatArray, int]:
        """Return the numbers of some columns, shape (T, C), NaN for missing ones, and the count of unreadable cells.

        Raises:
            TrajectoryError: A column holds no numbers.
            UnknownNameError: The table has no such column; the message lists similar names.
        """
        values = np.full((len(self.rows), len(columns)), np.nan)
        broken = 0
        for place, column in enumerate(columns):
            if column not in self.header:
                raise UnknownNameError("column", column, self.header)
            index = self.header.index(column)
            numbers = [_number(cells[index], self.decimal) for cells in self.rows]
            bad = [cells[index] for cells, number in zip(self.rows, numbers) if number is None]
            if len(bad) > MOST_BROKEN * max(len(self.rows), 1):
                point = DECIMAL_POINT if "," in bad[0] else ""
                raise TrajectoryError(f"column '{column}' holds '{bad[0][:40]}'; expected numbers{point}")
            values[:, place] = [math.nan if number is None else number for number in numbers]
            broken += len(bad)
        return values, broken

    def text(self, column: str) -> list[str]:
        """Return the cells of a column as text."""
        index = self.header.index(column)
        return [cells[index].strip() for cells in self.rows]


def read_table(
    text: str, *, delimiter: str | None = None, decimal: str = ".", names: Sequence[str] | None = None
) -> Table:
    """Read a table.

    Args:
        delimiter: Separator of cells; None detects it in the header.
        names: Column names of a table without a header line.

    Raises:
        TrajectoryError: No header, no line below it, two columns of the same name, or many lines of another length.
    """
    lines = text.splitlines()
    remarks, first, sign, header = _header(lines, delimiter)
    if len(lines) > MOST_SAMPLES:
        raise TrajectoryError(f"{len(lines):,} lines; expected at most {MOST_SAMPLES:,}")
    below = first + 1
    if names is not None:
        header, below = tuple(names), first
    elif lacks_names(header):
        shown = ", ".join(cell[:12] for cell in header[:3])
        raise TrajectoryError(f"no header line, the first one holds {shown}, …; expected the names of the columns")
    if twice := next((name for name in header if name and header.count(name) > 1), ""):
        raise TrajectoryError(f"the header has column '{twice[:40]}' twice")
    findings = []
    if len(lines) > below + 1 and not text.endswith(("\n", "\r")):
        # A number that was cut in the middle is a wrong number that looks like a right one.
        findings.append(note(f"line {len(lines)}, the last one, has no line end: left out, it may have been cut"))
        lines.pop()
    rows: list[tuple[str, ...]] = []
    broken: list[int] = []
    for number, line in enumerate(lines[below:], start=below + 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = _cells(line, sign)
        if len(cells) == len(header):
            rows.append(tuple(cells))
        else:
            broken.append(number)
    if len(broken) > MOST_BROKEN * (len(rows) + len(broken)):
        count = f"{len(broken)} of {len(rows) + len(broken)} lines have another number of cells than the header's"
        raise TrajectoryError(f"{count} {len(header)}, first line {broken[0]}; expected a table")
    if not rows:
        raise TrajectoryError("no line below the header; expected one a sample")
    if broken:
        left = counted(len(broken), "line")
        findings.append(note(f"{left} with another number of cells than the header left out, first line {broken[0]}"))
    return Table(header, tuple(rows), remarks, decimal, tuple(findings))


def read_header(text: str) -> tuple[str, ...]:
    """Return the names of a table's columns; raise TrajectoryError if there is no header."""
    return _header(text.splitlines(), None)[3]


def lacks_names(header: Sequence[str]) -> bool:
    """Return True if a header is a sample: all numbers, and not all whole as the names 0, 1, 2 are."""
    return all(_number(cell, ".") is not None for cell in header) and not all(cell.isdecimal() for cell in header)


def _header(lines: Sequence[str], delimiter: str | None) -> tuple[dict[str, str], int, str, tuple[str, ...]]:
    """Return the remarks, the index of the header line, its delimiter, and the names in it."""
    remarks, first = read_remarks(lines)
    if first == len(lines):
        raise TrajectoryError("no header line; expected the names of the columns")
    sign = delimiter or separator_of(lines[first].strip(), DELIMITERS)
    return remarks, first, sign, tuple(cell.strip() for cell in _cells(lines[first], sign))


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        # Line by line, so that a stray quotation mark spoils one line and not the rest of the file.
        return next(csv.reader([line.replace("\0", "?")], delimiter=delimiter), [])
    except csv.Error:
        return []


def _number(cell: str, decimal: str) -> float | None:
    """Return the number in a cell, NaN for one that is marked as missing, None for other text."""
    word = cell.strip().strip('"').lower()
    if word in MISSING:
        return math.nan
    if "_" in word:
        return None
    try:
        return float(word.replace(decimal, ".") if decimal != "." else word)
    except ValueError:
        return None
