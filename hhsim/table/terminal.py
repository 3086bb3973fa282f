"""Text of a table for the width of a terminal: columns go, text is folded at words, or rows turn into cards."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hhsim.table.table import Table, plain_text

if TYPE_CHECKING:
    from rich.text import Text

GAP = 3
LONGEST_WORD = 28
"""Most letters of a word, such as a path, that keep a column as wide."""
MOST_LINES = 4
"""Most lines of a row; longer rows are cards."""
PIPE_WIDTH = 1_000
"""Letters of a line without a terminal: nothing is folded, so that lines can be searched."""


@dataclass(frozen=True)
class LaidColumn:
    """A column as it is laid out; cells of a `number` are never broken."""

    heading: str
    cells: Sequence[str]
    number: bool = False

    @property
    def width(self) -> int:
        """Width without folding."""
        return max(1, *(len(text) for text in (self.heading, *self.cells)))

    @property
    def least(self) -> int:
        """Least width that breaks no number and no usual word."""
        if self.number:
            return self.width
        words = (word for text in (self.heading, *self.cells) for word in text.split())
        return max(1, min(LONGEST_WORD, max(map(len, words), default=0)))


def terminal_text(table: Table, *, in_terminal: bool) -> str:
    """Return a table as a terminal shows it; without any heading it has no rule either.

    Its title is a line above it; its notes are left out. Where it is too wide, optional columns go; then text is folded
    at words; where a row would have many lines, each row becomes a card. Lines are as wide as the terminal allows, or
    as long as they need to be outside of one.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console(highlight=False, width=None if in_terminal else PIPE_WIDTH)
    title = Text(plain_text(table.title), style="bold") if table.title else None
    rows = [[plain_text(cell) for cell in cells] for cells in table.cells]
    columns = [
        LaidColumn(plain_text(column.heading), [row[i] for row in rows], column.is_number)
        for i, column in enumerate(table.columns)
    ]
    for thin in table.optional if in_terminal else ():
        if not fits(columns, console.width):
            columns = [column for column in columns if column.heading != thin]
    with console.capture() as captured:
        if in_terminal and not fits(columns, console.width):
            for line in ([title, Text()] if title else []) + cards(columns, console.width):
                console.print(line, soft_wrap=True)
        else:
            laid = RichTable(
                box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, show_header=any(table.headings),
                title=title, title_justify="left", title_style="bold",
            )  # fmt: skip
            for column in columns:
                # As Text: a unit in square brackets is not markup.
                how: Any = {"justify": "right"} if column.number else {"overflow": "fold"}
                laid.add_column(Text(column.heading), min_width=column.least, no_wrap=column.number, **how)
            for cells in zip(*(column.cells for column in columns)):
                laid.add_row(*map(Text, cells))
            console.print(laid)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())


def fits(columns: Sequence[LaidColumn], width: int) -> bool:
    """Return whether a table of this width breaks no word and no number, and makes no row many lines high."""
    gaps = GAP * (len(columns) - 1)
    if gaps + sum(column.least for column in columns) > width:
        return False
    free = width - gaps - sum(column.least for column in columns if column.number)
    words = [column for column in columns if not column.number]
    return sum(column.width for column in words) <= MOST_LINES * free


def cards(columns: Sequence[LaidColumn], width: int) -> "list[Text]":
    """Return the rows as cards: the first cell in bold, under it a line for each other cell that is not empty."""
    from rich.text import Text

    first, *others = columns
    indent = max((len(column.heading) for column in others), default=0) + 2
    lines: list[Text] = []
    for i, name in enumerate(first.cells):
        if i:
            lines.append(Text())
        lines += [Text(part, style="bold") for part in textwrap.wrap(name, max(width, 16))]
        for column in others:
            if not column.cells[i]:
                continue
            inside = max(width - indent - 2, 16)
            # A number stays whole, whatever the width.
            parts = [column.cells[i]] if column.number else textwrap.wrap(column.cells[i], inside)
            for k, part in enumerate(parts):
                lines.append(Text(f"  {'' if k else column.heading:<{indent}}{part}"))
    return lines
