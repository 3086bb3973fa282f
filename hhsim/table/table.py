"""Table of figures: columns that know their unit and digits, rows, and text as CSV and Markdown."""

import csv
import io
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from operator import attrgetter
from typing import Any

MISSING = "—"
UNITS = {
    "": ("1", 1.0), "units": ("1", 1.0), "% of hold": ("%", 1.0), "µJ": ("J", 1e-6), "g": ("kg", 1e-3),
    "MB": ("B", 1e6), "ms": ("s", 1e-3), "µs": ("s", 1e-6), "ns": ("s", 1e-9), "mm": ("m", 1e-3), "µm": ("m", 1e-6),
    "µm/s": ("m/s", 1e-6), "mm/tick": ("m/tick", 1e-3), "cm": ("m", 1e-2), "cm³": ("m³", 1e-6),
}  # fmt: skip
"""Units that people read: the unit of files for such a value, and the size of the one in the other."""
BARE = ("", "1")
"""Units that no heading names."""
FORMULAS = tuple("=+-@\t\r")
"""Letters that begin a formula in a spreadsheet."""
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\udc80-\udc9f]")
"""Letters that command a terminal or turn the order of others; a tab and a line's end are none."""


def plain_text(text: str) -> str:
    """Return text from anywhere as a terminal may show it: what commands it is spelled, such as \\x1b."""
    return CONTROL.sub(lambda found: ascii(found[0])[1:-1], text)


def stored_unit(unit: str) -> str:
    """Return the unit in which files hold what is shown in `unit`: SI, "%", or "1" for counts and ratios."""
    return UNITS.get(unit, (unit, 1.0))[0]


def unit_size(unit: str) -> float:
    """Return the size of a shown unit in the stored one."""
    return UNITS.get(unit, (unit, 1.0))[1]


def shown(value: Any, digits: int | None = None, missing: str = MISSING) -> str:
    """Return a value as people read it, `missing` for None and NaN; text is returned as it is.

    `digits` are those behind the point; None for four significant ones, and all of a whole number.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or math.isnan(value):
        return missing
    if digits is not None:
        # Rounded first: what rounds to nothing has no sign.
        return f"{round(float(value), digits) + 0.0:,.{digits}f}"
    if isinstance(value, int) or (math.isfinite(value) and value == round(value) and abs(value) < 1e12):
        return f"{round(value):,}"
    return f"{value:.4g}"


class Marked(str):
    """A cell with a mood, "good", "bad" or "note", and words that a page shows below it; elsewhere it is its text."""

    mood: str
    below: str

    def __new__(cls, text: str, mood: str = "", below: str = "") -> "Marked":
        """Return the cell."""
        cell = super().__new__(cls, text)
        cell.mood, cell.below = mood, below
        return cell


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str  # name of the figure; with the unit it is the heading. Key or attribute of a row where `of` is not given.
    says: str = ""  # meaning of the column, for people
    unit: str = ""  # unit of what is shown; the values of rows are in its `stored_unit`
    # A row's value: a key, a position, an attribute or its path with dots, or a function of the row.
    of: str | int | Callable[[Any], Any] = ""
    digits: int | None = None  # digits behind the point; None as for `shown`
    missing: str = MISSING  # stands for a missing value
    is_number: bool = True  # True if its cells are aligned right and never broken

    @property
    def heading(self) -> str:
        """Name and unit of what is shown."""
        return self.name if self.unit in BARE else f"{self.name} [{self.unit}]"

    @property
    def stored_heading(self) -> str:
        """Name and unit of the values."""
        unit = stored_unit(self.unit)
        return self.name if unit in BARE else f"{self.name} [{unit}]"

    def value(self, row: Any) -> Any:
        """Return the value of a row, in the stored unit."""
        key = self.name if self.of == "" else self.of
        if callable(key):
            return key(row)
        return row[key] if isinstance(key, int) or isinstance(row, Mapping) else attrgetter(key)(row)

    def shown(self, row: Any) -> str:
        """Return the cell of a row as people read it."""
        value, size = self.value(row), unit_size(self.unit)
        if size != 1.0 and isinstance(value, Real):
            value = float(value) / size
        return shown(value, self.digits, self.missing)


def words(name: str, of: str | int | Callable[[Any], Any] = "") -> Column:
    """Return a column of text."""
    return Column(name, of=of, is_number=False)


def number(
    name: str, of: str | int | Callable[[Any], Any] = "", unit: str = "", digits: int = 0, missing: str = MISSING
) -> Column:
    """Return a column of numbers with so many digits behind the point; text in it stays as it is."""
    return Column(name, unit=unit, of=of, digits=digits, missing=missing)


@dataclass(frozen=True)
class Table:
    """Columns, rows that they take their values of, a title above it, and notes, a sentence each.

    `optional` are headings of columns that a narrow terminal leaves out, the first to go first.
    """

    columns: Sequence[Column]
    rows: Sequence[Any]
    title: str = ""
    notes: Sequence[str] = ()
    optional: Sequence[str] = ()

    @classmethod
    def of_cells(
        cls, headings: Sequence[str], rows: Sequence[Sequence[Any]], title: str = "", *, numbers: Collection[str] = ()
    ) -> "Table":
        """Return the table of rows of cells; `numbers` are the headings of the columns of numbers."""
        columns = [Column(heading, of=i, is_number=heading in numbers) for i, heading in enumerate(headings)]
        return cls(columns, rows, title)

    @classmethod
    def of_records(cls, columns: Sequence[Column], rows: Sequence[Any], names: str = "", title: str = "") -> "Table":
        """Return the table of `records` of these columns as people read it: all of them, or those named, with spaces.

        A name may be followed by the heading to show, as in `tick_cpu_p50=p50`.
        """
        known = {column.name: column for column in columns}
        shown_columns = []
        for word in names.split() or known:
            name, _, heading = word.partition("=")
            is_number = not any(isinstance(row[name], str | bool) for row in rows)
            heading = (heading or name).replace("_", " ")
            shown_columns.append(replace(known[name], name=heading, of=name, is_number=is_number))
        return cls(shown_columns, rows, title)

    @property
    def headings(self) -> list[str]:
        """Heading of each column."""
        return [column.heading for column in self.columns]

    @property
    def cells(self) -> list[list[str]]:
        """Rows as people read them."""
        return [[column.shown(row) for column in self.columns] for row in self.rows]

    @property
    def records(self) -> list[dict[str, Any]]:
        """Values of each row by the names of the columns."""
        return [{column.name: column.value(row) for column in self.columns} for row in self.rows]

    def csv(self) -> str:
        """Return it as CSV: stored units in the headings, missing values empty, numbers that come back bit for bit."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([csv_text(column.stored_heading) for column in self.columns])
        writer.writerows([_spelled(column.value(row)) for column in self.columns] for row in self.rows)
        return text.getvalue()

    def markdown(self) -> str:
        """Return it as a table of Markdown, without title and notes."""
        rule = "|".join("---:" if column.is_number else "---" for column in self.columns)
        rows = [f"| {' | '.join(map(markdown_text, row))} |" for row in (self.headings, *self.cells)]
        return "\n".join([rows[0], f"|{rule}|", *rows[1:]])


def markdown_text(text: str) -> str:
    """Return text that Markdown shows as it is."""
    kept = plain_text(text).replace("&", "&amp;").replace("\\", "&#92;").replace("<", "&lt;").replace("|", "\\|")
    kept = kept.replace("\n", " ")
    kept = kept.replace("_", "\\_").replace("*", "\\*").replace("`", "'")
    # Brackets before a parenthesis are a link; those of a unit stay as they are.
    return re.sub(r"\[(?=[^]]*\]\()", r"\\[", kept)


def _spelled(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else csv_text(str(value))


def csv_text(text: str) -> str:
    """Return a cell of CSV that a spreadsheet shows as it is: one that would be a formula begins with an apostrophe."""
    try:
        float(text)
    except ValueError:
        return f"'{text}" if text[:1] in FORMULAS and len(text) > 1 else text
    return text
