"""`hhsim sweep`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hhsim.system.counted import counted
from hhsim.table.table import Table

from .arguments.command import OptionGroup, argument, make_command, option
from .arguments.options import SCHEDULER, Jobs, OutPath, Part, Printing
from .console import end_on_sigterm, print_notes, progress

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hhsim.sweep.plan import Cell
    from hhsim.sweep.sweep import CellRow, SweepSummary

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
    scheduler: str = SCHEDULER
    dry_run: bool = option("Count the cells, and those that are left to run; write nothing.")
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
      hhsim sweep plan.toml --scheduler tcp://10.0.0.1:8786 --out /shared/first
    """
    from hhsim.sweep.plan import load_plan
    from hhsim.sweep.sweep import COLUMNS, TABLE, SweepFolder, cell_rows, run_sweep
    from hhsim.system.atomic_write import write_atomically
    from hhsim.system.output_path import RESULTS

    end_on_sigterm()
    with progress(quiet=printing.quiet) as report:
        report("reading the plan", 0, 1)
        read = load_plan(plan)
        folder = SweepFolder(settings.out or RESULTS / read.name)
        if printing.for_people:
            print_notes(read.notes)
        if not settings.dry_run:
            how: dict[str, Any] = {"scheduler": settings.scheduler, "keep_results": not settings.summary_only}
            ended = run_sweep(read, folder, jobs=settings.jobs or 0, **how, progress=report)
            rows = cell_rows(read, folder, ended.failed)
            write_atomically(folder.path / TABLE, Table(COLUMNS, rows).csv().encode())
    if settings.dry_run:
        left = [cell for digest, cell in read.cells.items() if not folder.done(digest, cell)]
        cells, done = len(read.cells), len(read.cells) - len(left)
        ticks = sum(cell.length * cell.repeat for cell in left)
        printing.show(
            {"cells": cells, "done": done, "ticks": ticks},
            f"{counted(cells, 'cell')}: {done:,} done, {len(left):,} to run, {counted(ticks, 'tick')}",
        )
        return 0
    failed = [(cell, ended.failed[digest]) for digest, cell in read.cells.items() if digest in ended.failed]
    printing.show(
        {
            "folder": str(folder.path),
            "cells": ended.cells,
            "done_now": ended.run,
            "done_before": ended.done_before,
            "failed": [{"cell": cell.label, "options": dict(cell.options), "reason": why} for cell, why in failed],
            "ticks": ended.ticks,
            "seconds": ended.seconds,
            "rows": rows,
            "notes": list(read.notes),
        },
        *_figures(ended, failed, rows, folder.path),
    )
    if printing.quiet and failed:
        shown = [f"{cell.label}: {why}" for cell, why in failed[:MOST_FAILURES]]
        print_notes([f"{counted(len(failed), 'cell')} failed", *shown], prefix="missed")
    return 1 if failed else 0


def _figures(
    ended: "SweepSummary", failed: "Sequence[tuple[Cell, str]]", rows: "Sequence[CellRow]", folder: Path
) -> "Iterator[Part]":
    """Yield the table of the cells, their numbers, and those that failed."""
    from hhsim.sweep.sweep import FAILED, TABLE, shown_table

    done = [row for row in rows if row["verdict"] != FAILED]
    if done:
        table = shown_table(done[:MOST_ROWS])
        yield table
        yield from (*table.notes, "")
    before = f", {ended.done_before:,} before" if ended.done_before else ""
    yield f"{counted(ended.cells, 'cell')}: {ended.run:,} done now{before}, {len(ended.failed):,} failed"
    if ended.run:
        speed = f", {ended.ticks / ended.seconds:,.0f} a second" if ended.seconds else ""
        yield f"{ended.ticks:,} ticks in {ended.seconds:,.0f} s{speed}"
    if failed:
        shown = [(cell.label, cell.stated, why) for cell, why in failed[:MOST_FAILURES]]
        yield from ("", Table.of_cells(("cell", "options", "failed since"), shown))
        more = len(failed) - MOST_FAILURES
        yield f"{f'{more:,} more failed; ' if more > 0 else ''}the same command runs them again"
    others = f"{len(done) - MOST_ROWS:,} more rows, and " if len(done) > MOST_ROWS else ""
    yield f"{others}all figures of each cell are in {folder / TABLE}"
