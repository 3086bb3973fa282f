"""What a command prints: tables for people, one JSON document for machines, progress for a terminal."""

import io
import json
import math
import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

Report: TypeAlias = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


def prepare_streams() -> None:
    """Make the standard streams fit to print to, whatever shell, encoding or parent process they come from.

    One that is closed (`>&-`) leads to the null device, so that no file opened later gets its number. A letter that the
    encoding lacks is shown as "?", and the bytes of a file name that is no UTF-8 as they are.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            nothing = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(nothing, "r" if name == "stdin" else "w", encoding="utf-8"))
    if isinstance(sys.stdout, io.TextIOWrapper):
        unicode = sys.stdout.encoding.lower().replace("-", "") == "utf8"
        sys.stdout.reconfigure(errors="surrogateescape" if unicode else "replace")


def print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "", numbers: Collection[str] = ()
) -> None:
    """Print a table to stdout.

    Args:
        columns: Headings, with the unit where there is one.
        rows: Cells as they are to be shown.
        title: A line above the table.
        numbers: Headings of the columns that are aligned right.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.title, table.title_justify, table.title_style = Text(title) if title else None, "left", "bold"
    for heading in columns:
        # As Text: a unit in square brackets is not markup.
        table.add_column(Text(heading), justify="right" if heading in numbers else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    # A pipe has no width: nothing is folded there, so that lines can be searched.
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 1_000)
    with console.capture() as captured:
        console.print(table)
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def print_rows(
    cells: Mapping[str, Callable[[Any], str]], rows: Iterable[object], *, words: Collection[str], title: str = ""
) -> None:
    """Print a table to stdout, a line for each row.

    Args:
        cells: Heading of each column, and what it shows of a row.
        rows: What the table is of.
        words: Headings of the columns that are aligned left.
        title: A line above the table.
    """
    shown = [[cell(row) for cell in cells.values()] for row in rows]
    print_table(list(cells), shown, title=title, numbers=cells.keys() - set(words))


def number(value: float | None, digits: int, scale: float = 1.0, missing: str = "—") -> str:
    """A figure as a table shows it, times a scale; what is None or NaN is missing."""
    if value is None or math.isnan(value):
        return missing
    # Rounded first: what rounds to nothing has no sign.
    return f"{round(scale * float(value), digits) + 0.0:,.{digits}f}"


def print_json(document: Mapping[str, Any]) -> None:
    """Print a document to stdout, in ASCII for every encoding; what JSON cannot hold (NaN, infinities) becomes null."""
    print(json.dumps(_plain(document), indent=2, allow_nan=False))


def announce_compilation(*, quiet: bool) -> None:
    """From here to the end of the command, say on stderr when a kernel has to be compiled, once.

    So that nobody takes the wait for a fault. Kernels that lie in the cache are loaded without a word.
    """
    if quiet:
        return
    import click
    from numba.core import event

    announced = False

    def announce(listener: object, details: object) -> None:
        nonlocal announced
        if not announced:
            announced = True
            print("hhsim: compiling the kernels: this happens once, and again after an upgrade", file=sys.stderr)

    listener = type("FirstCompilation", (event.Listener,), {"on_start": announce, "on_end": lambda *_: None})()
    event.register("numba:compile", listener)
    click.get_current_context().call_on_close(lambda: event.unregister("numba:compile", listener))


def print_notes(notes: Sequence[str], *, prefix: str = "note") -> None:
    """Print remarks to stderr, a line each."""
    for note in notes:
        print(f"hhsim: {prefix}: {note}", file=sys.stderr)


@contextmanager
def progress(*, quiet: bool) -> Iterator[Report | None]:
    """Show a bar on stderr while the work reports; nothing where stderr is no terminal, or where it should be quiet."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:,.0f} of {task.total:,.0f}"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1)

        def report(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total)

        yield report


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
