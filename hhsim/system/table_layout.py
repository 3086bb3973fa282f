"""How a table gets into the width of a terminal: columns go, text is folded at words, or rows turn into cards."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text

GAP = 3
"""Between two columns."""
LONGEST_WORD = 28
"""Of a longer word, such as a path, no column is kept as wide."""
MOST_LINES = 4
"""Rows of more lines than this are cards."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        heading: Its head.
        cells: One a row, as they are shown.
        number: Whether its cells are never broken.
    """

    heading: str
    cells: Sequence[str]
    number: bool = False

    @property
    def width(self) -> int:
        """Without any folding."""
        return max(1, *(len(text) for text in (self.heading, *self.cells)))

    @property
    def least(self) -> int:
        """The narrowest that breaks no number and no usual word."""
        if self.number:
            return max(1, _longest_word([self.heading]), *(len(cell) for cell in self.cells))
        return max(1, min(LONGEST_WORD, _longest_word([self.heading, *self.cells])))


def fitting_columns(columns: Sequence[Column], width: int, optional: Sequence[str]) -> list[Column]:
    """The columns, without as many of the `optional` ones, the first one first, as keep them from fitting `width`."""
    shown = list(columns)
    for heading in optional:
        if fits(shown, width):
            break
        shown = [column for column in shown if column.heading != heading]
    return shown


def fits(columns: Sequence[Column], width: int) -> bool:
    """Whether a table of a terminal's width breaks no word and no number, and makes no row many lines high."""
    gaps = GAP * (len(columns) - 1)
    if gaps + sum(column.least for column in columns) > width:
        return False
    room = width - gaps - sum(column.least for column in columns if column.number)
    words = [column for column in columns if not column.number]
    return sum(column.width for column in words) <= MOST_LINES * room


def widths(columns: Sequence[Column], width: int) -> list[int]:
    """Width of each column: whole where there is room, else text gives way, the widest first."""
    found = [column.least for column in columns]
    room = width - GAP * (len(columns) - 1) - sum(found)
    whole = [column.width for column in columns]
    for i, column in enumerate(columns):
        if column.number:
            more = min(max(room, 0), whole[i] - found[i])
            found[i], room = found[i] + more, room - more
    while room > 0 and found != whole:
        i = max(range(len(columns)), key=lambda i: (whole[i] - found[i]) / found[i])
        found[i], room = found[i] + 1, room - 1
    return found


def cards(columns: Sequence[Column], width: int) -> "list[Text]":
    """The rows as cards: the first cell in bold, under it a line for each other cell that says something."""
    from rich.text import Text

    first, *others = columns
    room = max((len(column.heading) for column in others), default=0) + 2
    lines: list[Text] = []
    for i, name in enumerate(first.cells):
        if i:
            lines.append(Text())
        lines += [Text(part, style="bold") for part in textwrap.wrap(name, max(width, 16))]
        for column in others:
            if not column.cells[i]:
                continue
            inside = max(width - room - 2, 16)
            # A number stays whole, whatever the width.
            parts = [column.cells[i]] if column.number else textwrap.wrap(column.cells[i], inside)
            for k, part in enumerate(parts):
                lines.append(Text(f"  {'' if k else column.heading:<{room}}{part}"))
    return lines


def _longest_word(texts: Sequence[str]) -> int:
    return max((len(word) for text in texts for word in text.split()), default=0)
