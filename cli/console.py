"""Output of a command: tables for people, one JSON document for machines, progress for a terminal."""

import io
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from hhsim.system.plain_json import plain_json
from hhsim.system.progress import Progress, silent
from hhsim.table.table import plain_text

if TYPE_CHECKING:
    from hhsim.table.table import Table

SILENCE = 10.0
"""Time between two lines of progress where there is no bar [s]."""


def prepare_streams() -> None:
    """Make the standard streams fit to print to, whatever the shell, encoding or parent process.

    A closed one (`>&-`) leads to the null device, so that no file opened later gets its number. A letter that the
    encoding lacks is shown as "?", and the bytes of a file name that is no UTF-8 as they are.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            nothing = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(nothing, "r" if name == "stdin" else "w", encoding="utf-8"))
    if isinstance(sys.stdout, io.TextIOWrapper):
        unicode = sys.stdout.encoding.lower().replace("-", "") == "utf8"
        sys.stdout.reconfigure(errors="surrogateescape" if unicode else "replace")


def print_table(table: "Table") -> None:
    """Print a table to stdout, as wide as the terminal allows."""
    from hhsim.table.terminal import terminal_text

    print(terminal_text(table, in_terminal=sys.stdout.isatty()))


def print_line(text: str) -> None:
    """Print a sentence to stdout; in a terminal it is folded at words.

    It and its like are what prints words of users' files: whatever commands a terminal is spelled.
    """
    text = plain_text(text)
    if not sys.stdout.isatty():
        print(text)
        return
    import shutil
    import textwrap

    width = shutil.get_terminal_size().columns
    print(textwrap.fill(text, width, break_long_words=False, break_on_hyphens=False))


def print_json(document: Mapping[str, Any]) -> None:
    """Print a document to stdout, in ASCII for every encoding; what JSON cannot hold (NaN, infinities) becomes null."""
    print(json.dumps(plain_json(document), indent=2, allow_nan=False))


def end_on_sigterm() -> None:
    """Have SIGTERM end the command as an interrupt does: with its processes, and without half-written files."""
    import click

    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    click.get_current_context().call_on_close(lambda: signal.signal(signal.SIGTERM, before))


def announce_compilation(*, quiet: bool) -> None:
    """Print on stderr, once, when the command has to compile a kernel, so that nobody takes the wait for a fault.

    Kernels from the cache are loaded without a word.
    """
    if quiet:
        return
    import click

    from hhsim.system.compile_notice import COMPILING, tell_of_compilation

    click.get_current_context().call_on_close(tell_of_compilation(lambda: print(COMPILING, file=sys.stderr)))


def print_notes(notes: Sequence[str], *, prefix: str = "note") -> None:
    """Print remarks to stderr, a line each."""
    for note in notes:
        print_error(f"hhsim: {prefix}: {note}")


def print_error(text: str) -> None:
    """Print a line to stderr."""
    print(plain_text(" ".join(text.splitlines())), file=sys.stderr, flush=True)


@contextmanager
def progress(*, quiet: bool) -> Iterator[Progress]:
    """Show a bar on stderr while work reports, unless quiet; where that is no terminal, a line every ten seconds."""
    if quiet:
        yield silent
        return
    if not sys.stderr.isatty():
        with _line_by_line() as report:
            yield report
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    # What is being done, the seconds that it has taken, the share of it that is done, and the time left.
    texts = map(TextColumn, ("{task.description}", "{task.elapsed:,.0f} s", "{task.fields[amount]}"))
    columns = (*texts, BarColumn(), TimeRemainingColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        now = "getting ready"
        task = bar.add_task(now, total=None, amount="")

        def report(what: str, done: int, total: int) -> None:
            nonlocal now
            what = plain_text(what).replace("[", "\\[")
            # Text in brackets changes as the work goes on; the clock begins anew where other text does.
            if (stage := what.partition(" (")[0]) != now:
                now = stage
                bar.reset(task, total=None, description=what, amount="")
            bar.update(task, description=what, completed=done, total=total, amount=f"{done:,} of {total:,}")

        yield report


@contextmanager
def _line_by_line() -> Iterator[Progress]:
    """Print what is being done, how much of it is, and the seconds so far, as often as `SILENCE` says."""
    now, begin, ended = "getting ready", time.monotonic(), threading.Event()

    def report(what: str, done: int, total: int) -> None:
        nonlocal now
        now = f"{what}: {done:,} of {total:,}"

    def tell() -> None:
        # Work reports when it likes, and kernels of minutes not at all: a thread has the clock.
        with suppress(OSError, ValueError):
            while not ended.wait(SILENCE):
                print_error(f"hhsim: {now}, {time.monotonic() - begin:,.0f} s")

    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    try:
        yield report
    finally:
        ended.set()
        thread.join()
