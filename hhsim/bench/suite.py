"""What a suite of `hhsim bench` declares, and the one way in which all are run."""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

from hhsim import __version__
from hhsim.bench.registry import SUITES
from hhsim.errors import HhsimError
from hhsim.sweep.engines import FolderTask, TaskEnd, run_to_end
from hhsim.sweep.folder import check_own, has_format, locked
from hhsim.sweep.input_files import file_digest, source_digest
from hhsim.sweep.plan import DIGITS
from hhsim.system.atomic_write import write_atomically
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column, Table

Row: TypeAlias = dict[str, Any]

MARK, FORMAT = "bench.json", "hhsim-bench-cells"
"""File that tells a folder of cells from others, and its format."""


def setting(default: Any, help: str = "", flag: str = "", metavar: str = "", *, is_argument: bool = False) -> Any:
    """Return a field of a suite's settings that is an option of its command.

    Without a help it is the option of that name that other commands have. `flag` is as of the field by default.
    """
    return field(default=default, metadata={"help": help, "flag": flag, "metavar": metavar, "argument": is_argument})


@dataclass(frozen=True)
class Preset:
    """Values of the settings that a flag stands for; those that are given count more."""

    flag: str
    help: str
    values: Mapping[str, Any]


def no_lines(settings: Any, found: Any) -> list[str]:
    """Say nothing."""
    return []


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Suite: cells, each run alone, and the table of their figures.

    Settings with a field `repetitions` have every cell run so often, in turns: `run` gets the figures of the times
    before. Functions of `rows` get the rows of the table, by the names of its columns.
    """

    help: str  # of its command, after the one line: paragraphs and examples
    settings: type  # frozen dataclass, its fields made by `setting`; it raises InputError for what cannot be
    columns: Sequence[Column]
    cells: Callable[[Any, Progress], Sequence[Any]]  # of the settings
    run: Callable[[Any, Any], Any]  # figures of a cell; None before the first time
    # Of the settings and the figures of all cells; without it, the figures of a cell are a list of rows.
    rows: Callable[[Any, Sequence[Any]], list[Row]] = lambda settings, figures: list(chain.from_iterable(figures))
    # What people read: columns as of `Table.of_records`, which rows, the column that they are sorted by, that of which
    # each value has a table of its own, and the title. Or tables, of the settings, the rows and the figures.
    shown: str = ""
    is_shown: Callable[[Sequence[Row], Row], bool] = lambda rows, row: True
    sort: str = ""
    by: str = ""
    title: Callable[[Any], str] = lambda settings: ""
    tables: Callable[[Any, Sequence[Row], Sequence[Any]], Sequence[Table]] | None = None
    missed: Callable[[Any, Sequence[Row]], list[str]] = no_lines  # missed bars, a few words each: exit code 1
    lines: Callable[[Any, Sequence[Row]], list[str]] = no_lines  # what people read below the tables
    notes: Callable[[Any, Sequence[Any]], list[str]] = no_lines  # remarks on the figures
    named: Callable[[Any], str] = lambda cell: "cells"  # name of a cell in the progress
    optional: Sequence[str] = ()  # headings of columns that a narrow terminal leaves out
    preset: Preset | None = None
    # True if the figures of a cell are a list of rows of plain values: it can be run anywhere, and kept.
    is_portable: bool = False
    key: Callable[[Any], str] = lambda cell: ""  # digest of what a cell depends on besides the settings
    # Draws its pictures, of path, settings, rows, figures, progress and a note on the run; returns their paths.
    draw: Callable[[Path, Any, Sequence[Row], Sequence[Any], Progress, str], list[Path]] | None = None
    # Checks the folder of its pictures, before the work; without it there is one, a file beside the table.
    check_folder: Callable[[Path], None] | None = None
    listed: Callable[[Any], Table] | None = None  # table of what there is, for --list


def tables_of(suite: Suite, settings: Any, rows: Sequence[Row], figures: Sequence[Any]) -> Sequence[Table]:
    """Return what people read of the rows."""
    if suite.tables is not None:
        return suite.tables(settings, rows, figures)
    chosen = [row for row in rows if suite.is_shown(rows, row)]
    if suite.sort:
        chosen.sort(key=lambda row: float(row[suite.sort]))
    title, groups = suite.title(settings), dict[str, list[Row]]()
    for row in chosen:
        groups.setdefault(row[suite.by] if suite.by else "", []).append(row)
    names = {value: ": ".join(filter(None, (value, title))) for value in groups}
    return [Table.of_records(suite.columns, group, suite.shown, names[value]) for value, group in groups.items()]


def run_cells(suite: Suite, settings: Any, progress: Progress = silent) -> Iterator[Any]:
    """Yield the figures of the cells in their order, as soon as they are known; Ctrl-C is heard between two.

    Repetitions take turns, each in the opposite order of the one before, so that other load of the machine falls on all
    cells.
    """
    cells = suite.cells(settings, progress)
    rounds = getattr(settings, "repetitions", 1)
    figures: list[Any] = [None] * len(cells)
    with interruptible_between() as check_interrupt:
        for number in range(rounds):
            turn = f", repetition {number + 1} of {rounds}" if rounds > 1 else ""
            places = range(len(cells)) if number % 2 == 0 else reversed(range(len(cells)))
            for done, place in enumerate(places):
                progress(f"{suite.named(cells[place])}{turn}", number * len(cells) + done, rounds * len(cells))
                figures[place] = suite.run(cells[place], figures[place])
                if rounds == 1:
                    yield figures[place]
                check_interrupt()
    if rounds > 1:
        yield from figures


@dataclass(frozen=True, kw_only=True)
class SuiteTask(FolderTask):
    """Cell of a portable suite by its place."""

    suite: str
    settings: Any
    place: int

    def work(self) -> TaskEnd:
        """Run the cell and write its rows in one step."""
        rows = SUITES[self.suite].run(_cells(self.suite, self.settings)[self.place], None)
        text = json.dumps(rows, default=lambda value: value.item())
        write_atomically(Path(self.folder) / f"{self.digest}.json", text.encode())
        return TaskEnd(self.digest)


# A process runs several cells of a suite.
@lru_cache(1)
def _cells(suite: str, settings: Any) -> Sequence[Any]:
    return SUITES[suite].cells(settings, silent)


def _digests(settings: Any) -> list[str]:
    """Return the digests of the files that settings name."""
    values = (value if isinstance(value, tuple) else (value,) for value in vars(settings).values())
    named = (Path(word) for words in values for word in words if isinstance(word, str))
    return [file_digest(path) for path in named if path.is_file()]


def run_tasks_of(
    name: str,
    settings: Any,
    progress: Progress = silent,
    *,
    jobs: int = 1,
    scheduler: str = "",
    folder: Path | None = None,
) -> list[list[Row]]:
    """Return the rows of all cells of a portable suite, in their order; those that are kept are not run again.

    Args:
        jobs: Processes of this machine; 1 for this process.
        scheduler: Address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`.
        folder: Where cells that are done are kept, so that the same command goes on.

    Raises HhsimError for a cell that could not be run, OutputError for a folder that is not writable, or is another's.
    """
    suite, cells = SUITES[name], _cells(name, settings)
    stated = [name, asdict(settings), _digests(settings), __version__, source_digest()]
    digests = []
    for place, cell in enumerate(cells):
        text = json.dumps([*stated, suite.key(cell) or place], sort_keys=True)
        digests.append(hashlib.sha256(text.encode()).hexdigest()[:DIGITS])
    with TemporaryDirectory() as scratch, ExitStack() as stack:
        is_kept, folder = folder is not None, folder or Path(scratch)
        if is_kept:
            check_own(folder, has_format(folder / MARK, FORMAT), "bench")
            stack.enter_context(locked(folder, folder, "bench"))
            write_atomically(folder / MARK, json.dumps({"format": FORMAT, "suite": name}).encode())
        files = [folder / f"{digest}.json" for digest in digests]
        left = [place for place, file in enumerate(files) if not file.is_file()]
        about: dict[str, Any] = {"folder": str(folder.resolve()), "sources": source_digest()}
        tasks = [SuiteTask(suite=name, settings=settings, place=i, digest=digests[i], **about) for i in left]

        def on_end(end: TaskEnd) -> str:
            if end.reason:
                raise HhsimError(end.reason)
            return ""

        workers = jobs if jobs > 1 else 0
        run_to_end(tasks, "cells", on_end, progress, scheduler=scheduler, jobs=workers, kept=is_kept)
        return [json.loads(file.read_text(encoding="utf-8")) for file in files]
