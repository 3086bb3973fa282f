"""What a suite of `hhsim bench` is, and the one way in which all are run.

A suite is a class of settings in a module of `hhsim.bench.suites`, and a plan in the TOML file beside it: what the
command says, the values of the settings, and the figures with their units.
"""

import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self, TypeAlias

from hhsim import __version__
from hhsim.bench.plan import Plan, read_plan
from hhsim.errors import HhsimError
from hhsim.metrics.run.registry import run_metrics
from hhsim.sweep.engines import Task, TaskEnd, TaskFolder, run_to_end
from hhsim.sweep.input_files import file_digest, source_digest
from hhsim.sweep.plan import DIGITS
from hhsim.system.atomic_write import write_atomically
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import check_fields
from hhsim.table.table import Column, Table

Row: TypeAlias = dict[str, Any]

MARK, FORMAT = "bench.json", "hhsim-bench-cells"
"""File that tells a folder of cells from others, and its format."""


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Settings of a suite: cells, each run alone, and the table of their figures.

    Settings with a field `repetitions` have every cell run so often, in turns: `run` gets the figures of the times
    before. Rows are those of the table, by the names of its columns.
    """

    # True if the figures of a cell are a list of rows of plain values: it can be run anywhere, and kept.
    is_portable = False
    # True if it draws a picture beside the table, or a folder of pictures where one is named.
    draws_picture, draws_folder = False, False

    def __post_init__(self) -> None:
        """Raise InputError for unknown names, empty lists and numbers out of range."""
        check_fields(self)
        self.check()

    @classmethod
    def plan(cls) -> Plan:
        """Return the plan beside the module."""
        return read_plan(Path(str(sys.modules[cls.__module__].__file__)).with_suffix(".toml"))

    @classmethod
    def planned(cls, is_preset: bool = False, **given: Any) -> Self:
        """Return the settings of the plan, with the values of its preset if asked for, and with those that are given.

        Raises InputError for a value that cannot be.
        """
        plan = cls.plan()
        values = {name: option.default for name, option in plan.options.items()}
        values |= {**(plan.preset.values if plan.preset and is_preset else {}), **given}
        return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})

    @classmethod
    def columns(cls) -> Sequence[Column]:
        """Return the columns of the table."""
        known, found = run_metrics(), []
        for name, figure in cls.plan().columns.items():
            metric = None if figure.says else known[name]
            found.append(Column(name, metric.label, metric.unit) if metric else Column(name, figure.says, figure.unit))
        return found

    def check(self) -> None:
        """Raise InputError for what the types of the fields cannot express."""

    def cells(self, progress: Progress) -> Sequence[Any]:
        """Return what is run."""
        raise NotImplementedError

    def run(self, cell: Any, before: Any) -> Any:
        """Return the figures of a cell; `before` are those of the time before, None at first."""
        raise NotImplementedError

    def rows(self, figures: Sequence[Any]) -> list[Row]:
        """Return the rows of the figures of all cells; by default the figures of a cell are a list of rows."""
        return list(chain.from_iterable(figures))

    def is_shown(self, rows: Sequence[Row], row: Row) -> bool:
        """Return True for a row that people read."""
        return True

    def title(self) -> str:
        """Return the title of the tables that people read."""
        return ""

    def tables(self, rows: Sequence[Row], figures: Sequence[Any]) -> Sequence[Table]:
        """Return what people read of the rows."""
        plan, chosen = self.plan(), [row for row in rows if self.is_shown(rows, row)]
        if plan.sort:
            chosen.sort(key=lambda row: float(row[plan.sort]))
        groups = dict[str, list[Row]]()
        for row in chosen:
            groups.setdefault(row[plan.by] if plan.by else "", []).append(row)
        names = {value: ": ".join(filter(None, (value, self.title()))) for value in groups}
        return [Table.of_records(self.columns(), group, plan.shown, names[value]) for value, group in groups.items()]

    def missed(self, rows: Sequence[Row]) -> list[str]:
        """Return missed bars, a few words each: exit code 1."""
        return []

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Return what people read below the tables."""
        return []

    def notes(self, figures: Sequence[Any]) -> list[str]:
        """Return remarks on the figures."""
        return []

    def named(self, cell: Any) -> str:
        """Return the name of a cell in the progress."""
        return "cells"

    def draw(
        self, path: Path, rows: Sequence[Row], figures: Sequence[Any], progress: Progress, note: str
    ) -> list[Path]:
        """Draw pictures, with a note on the run, and return their paths; of suites that draw."""
        return []

    def listed(self) -> Table | None:
        """Return the table of what there is, for --list; None for a suite without it."""
        return None


def run_cells(suite: Suite, progress: Progress = silent) -> Iterator[Any]:
    """Yield the figures of the cells in their order, as soon as they are known; Ctrl-C is heard between two.

    Repetitions take turns, each in the opposite order of the one before, so that other load of the machine falls on all
    cells.
    """
    cells = suite.cells(progress)
    rounds = getattr(suite, "repetitions", 1)
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
class SuiteTask(Task):
    """Cell of a portable suite by its place."""

    suite: Suite
    place: int

    def work(self) -> TaskEnd:
        """Run the cell and write its rows in one step."""
        rows = self.suite.run(_cells(self.suite)[self.place], None)
        text = json.dumps(rows, default=lambda value: value.item())
        write_atomically(Path(self.folder) / f"{self.digest}.json", text.encode())
        return TaskEnd(self.digest)


# A process runs several cells of a suite.
@lru_cache(1)
def _cells(suite: Suite) -> Sequence[Any]:
    return suite.cells(silent)


def run_tasks_of(
    suite: Suite, progress: Progress = silent, *, jobs: int = 1, scheduler: str = "", folder: Path | None = None
) -> list[list[Row]]:
    """Return the rows of all cells of a portable suite, in their order; those that are kept are not run again.

    Args:
        jobs: Processes of this machine; 1 for this process.
        scheduler: Address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`.
        folder: Where cells that are done are kept, so that the same command goes on.

    Raises HhsimError for a cell that could not be run, OutputError for a folder that is not writable, or is another's.
    """
    name, settings = type(suite).__module__, asdict(suite)
    values = (value if isinstance(value, tuple) else (value,) for value in settings.values())
    named = (Path(word) for words in values for word in words if isinstance(word, str))
    inputs = [file_digest(path) for path in named if path.is_file()]
    stated, digests = [name, settings, inputs, __version__, source_digest()], []
    for place in range(len(_cells(suite))):
        text = json.dumps([*stated, place], sort_keys=True)
        digests.append(hashlib.sha256(text.encode()).hexdigest()[:DIGITS])
    with TemporaryDirectory() as scratch, ExitStack() as stack:
        if folder is not None:
            stack.enter_context(TaskFolder(folder, "bench", MARK, FORMAT).locked(suite=name))
        folder = folder or Path(scratch)
        files = [folder / f"{digest}.json" for digest in digests]
        left = [place for place, file in enumerate(files) if not file.is_file()]
        about: dict[str, Any] = {"folder": str(folder.resolve()), "sources": source_digest()}
        tasks = [SuiteTask(suite=suite, place=place, digest=digests[place], **about) for place in left]

        def on_end(end: TaskEnd) -> None:
            if end.reason:
                raise HhsimError(end.reason)

        if scheduler or jobs > 1:
            run_to_end(tasks, "cells", on_end, progress, scheduler=scheduler, jobs=jobs, done=len(files) - len(left))
            tasks = []
        with interruptible_between() as check_interrupt:
            for done, task in enumerate(tasks, len(files) - len(left)):
                progress("cells", done, len(files))
                on_end(task.run())
                check_interrupt()
        return [json.loads(file.read_text(encoding="utf-8")) for file in files]
