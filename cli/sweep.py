"""`hhsim sweep`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hhsim.system.counted import counted
from hhsim.table.table import Table

from .arguments.command import OptionGroup, argument, make_command, option
from .arguments.options import Jobs, OutPath, Printing
from .console import end_on_sigterm, print_line, print_notes, print_table, progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hhsim.sweep.cell_table import CellRow
    from hhsim.sweep.sweep import SweepSummary

MOST_FAILURES = 20
MOST_ROWS = 60


class SweepSettings(OptionGroup):
    """Folder of a sweep, and how its cells are run."""

    out: OutPath | None = option(
        "Folder of the results; cells that are done there are not run again. Default: results/ and the plan's name.",
        "FOLDER",
    )
    jobs: Jobs | None = option(
        "Cells at a time, in processes of this machine. Default: one for each physical core.", "N"
    )
    scheduler: str = option(
        "Run the cells on a Dask cluster: tcp://host:8786, or local for one of --jobs processes.", "ADDRESS", default=""
    )
    dry_run: bool = option("Count the cells, estimate how long the others take by those that ran; write nothing.")
    retry_failed: bool = option("Run failed cells again; without it their reasons are shown.")
    summary_only: bool = option("Keep a row of figures for each cell, and not its ticks.")


@make_command
def command(*, plan: Path = argument("PLAN"), settings: SweepSettings, printing: Printing) -> int:
    """Replay all that a plan names, each with each, and resume.

    PLAN is a TOML file of objects, motions, methods, surfaces and sets of options (docs/results.md). Each cell is what
    hhsim replay makes of the same words, in a file of its own that appears in one step: whatever ends a sweep, the same
    command goes on with what is not done yet. What a cell depends on is in its name, so that one whose inputs, options
    or hhsim change is run anew. At the end a table has a row for each cell, and FOLDER/table.csv has all figures of
    each. The exit code is 1 where cells failed.

    \b
    Examples:
      hhsim sweep plan.toml --dry-run
      hhsim sweep plan.toml --jobs 2
      hhsim sweep plan.toml --retry-failed
      hhsim sweep plan.toml --scheduler tcp://10.0.0.1:8786 --out /shared/first
    """
    from hhsim.sweep.cell_table import COLUMNS, TABLE, cell_rows
    from hhsim.sweep.folder import SweepFolder, lasting
    from hhsim.sweep.plan import load_plan
    from hhsim.sweep.sweep import estimate, run_sweep
    from hhsim.system.atomic_write import write_atomically
    from hhsim.system.output_path import RESULTS
    from hhsim.system.thread_pool import physical_cores

    end_on_sigterm()
    jobs = settings.jobs or 0
    with progress(quiet=printing.quiet) as report:
        report("reading the plan", 0, 1)
        read = load_plan(plan)
        folder = SweepFolder(settings.out or RESULTS / read.name)
        if printing.for_people:
            print_notes(read.notes)
        if settings.dry_run:
            found = estimate(read, folder)
        else:
            how: dict[str, Any] = {"retry_failed": settings.retry_failed, "keep_results": not settings.summary_only}
            ended = run_sweep(read, folder, jobs=jobs, scheduler=settings.scheduler, **how, progress=report)
            rows = cell_rows(read, folder)
            write_atomically(folder.path / TABLE, Table(COLUMNS, rows).csv().encode())
    if settings.dry_run:
        workers = jobs or max(1, len(physical_cores()))
        seconds = found.elapsed(workers)
        counts = {"cells": found.cells, "done": found.done, "failed": found.failed, "ticks": found.ticks}
        where = f"{workers} process{'es' * (workers > 1)}, by the cells that ran on this machine"
        printing.show(
            {**counts, "processes": workers, "seconds": seconds},
            f"{counted(found.cells, 'cell')}: {found.done:,} done, {found.failed:,} failed, {found.left:,} to run",
            *([f"{found.ticks:,} ticks: {lasting(seconds)} in {where}"] if found.left else []),
        )
        return 0
    if printing.for_people:
        _print(ended, rows, folder.path)
    printing.show(
        {
            "folder": str(folder.path),
            "cells": ended.cells,
            "done_now": ended.run,
            "done_before": ended.done_before,
            "failed": [
                {"cell": cell.label, "options": dict(cell.options), "reason": why} for cell, why in ended.failed
            ],
            "ticks": ended.ticks,
            "seconds": ended.seconds,
            "rows": rows,
            "notes": list(read.notes),
        }
    )
    if printing.quiet and ended.failed:
        shown = [f"{cell.label}: {why}" for cell, why in ended.failed[:MOST_FAILURES]]
        print_notes([f"{counted(len(ended.failed), 'cell')} failed", *shown], prefix="missed")
    return 1 if ended.failed else 0


def _print(ended: "SweepSummary", rows: "Sequence[CellRow]", folder: Path) -> None:
    from hhsim.sweep.cell_table import FAILED, TABLE, shown_table
    from hhsim.sweep.folder import lasting

    done = [row for row in rows if row["verdict"] != FAILED]
    if done:
        table = shown_table(done[:MOST_ROWS])
        print_table(table, optional=("stuck", "over optimum [%]", "force [N]", "p99 [µs]", "surface"))
        for note in table.notes:
            print_line(note)
        print()
    before = f", {ended.done_before:,} before" if ended.done_before else ""
    print_line(f"{counted(ended.cells, 'cell')}: {ended.run:,} done now{before}, {len(ended.failed):,} failed")
    if ended.run:
        speed = f", {ended.ticks / ended.seconds:,.0f} a second" if ended.seconds else ""
        print_line(f"{ended.ticks:,} ticks in {lasting(ended.seconds)}{speed}")
    if ended.failed:
        print()
        shown = [(cell.label, cell.stated, why) for cell, why in ended.failed[:MOST_FAILURES]]
        print_table(Table.of_cells(("cell", "options", "failed since"), shown))
        more = len(ended.failed) - MOST_FAILURES
        print_line(f"{f'{more:,} more failed; ' if more > 0 else ''}--retry-failed runs them again")
    others = f"{len(done) - MOST_ROWS:,} more rows, and " if len(done) > MOST_ROWS else ""
    print_line(f"{others}all figures of each cell are in {folder / TABLE}")
