"""Repairs of a manifest: runs the rows that are not done yet, and writes the table of all of them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hhsim.metrics.field.field_table import field_metrics
from hhsim.repair.request import Repair
from hhsim.sweep.engines import TaskEnd, check_own, has_format, locked, require_dask, run_to_end
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.repair_manifest import (
    PlannedRepair,
    RowOutcome,
    RowTask,
    finished,
    keep_lost,
    load_manifest,
    read_outcome,
    row_digest,
)
from hhsim.system.atomic_write import write_atomically, write_together
from hhsim.system.plain_json import plain_json
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import physical_cores
from hhsim.table.table import Column, Table, number, stored_unit, words

MARK = "repairs.json"
FORMAT = "hhsim-repairs"
BRIEF = {
    "PD before": ("depth_skin_max_before", "depth_cones_max_before"),
    "PD after": ("depth_skin_max_after", "depth_cones_max_after"),
    "kept, 5 mm": ("contacts_kept_5mm_after",),
    "ACC ratio": ("acceleration_ratio_after",),
    "MPJPE": ("mpjpe_after",),
    "correction": ("correction_max_after",),
    "a frame": ("time_per_frame",),
}
"""Columns of the table in a terminal: each has the first of these figures that a row has."""
LOOKS = {"time_per_frame": Column("CPU time a frame", unit="ms", digits=1)}
"""Columns of figures that are none of the field (`field_metrics`); any other has its own name, and no unit."""


@dataclass(frozen=True)
class RepairedRow:
    """Row of the manifest with its outcome."""

    planned: PlannedRepair
    outcome: RowOutcome


def repair_table(rows: Sequence[RepairedRow]) -> Table:
    """Return the table of all rows in their order; its figures are all that any row has, by their names."""
    figures = dict.fromkeys(name for row in rows for name in row.outcome.figures)
    return Table(
        [
            words("name", "planned.name"),
            words("state", "outcome.state"),
            words("recording", lambda row: row.planned.request.recording.name),
            words("object", lambda row: row.planned.request.object.replace("\\", "/").rpartition("/")[2]),
            number("frames", "outcome.frames"),
            number("marked", lambda row: len(row.outcome.marked)),
            words("doubt", lambda row: "; ".join(row.outcome.doubts)),
            *map(_figure_column, figures),
            words("reason", "outcome.reason"),
        ],
        rows,
        "All recordings",
    )


def _figure_column(name: str) -> Column:
    """Return the column of a figure, by its name with or without _before or _after."""
    base, _, when = name.rpartition("_")
    metric = field_metrics().get(base if when in ("before", "after") else name)
    look = LOOKS.get(name, Column(name)) if metric is None else Column(name, unit=metric.unit, digits=metric.digits)
    return replace(look, name=name, of=lambda row: row.outcome.figures.get(name))


def brief_table(table: Table) -> Table:
    """Return the columns of the table of all rows that a terminal has room for."""
    columns = {column.name: column for column in table.columns}

    def column(heading: str, names: Sequence[str]) -> Column:
        def first(row: RepairedRow) -> float | None:
            return next((found for name in names if (found := columns[name].value(row)) is not None), None)

        return replace(columns[names[0]], name=heading, of=first)

    known = {heading: [name for name in names if name in columns] for heading, names in BRIEF.items()}
    figures = [column(heading, names) for heading, names in known.items() if names]
    about = [columns[name] for name in ("name", "state", "frames", "marked")]
    return Table([*about, *figures, columns["reason"]], table.rows, table.title)


@dataclass(frozen=True)
class BatchOutcome:
    """Table of all rows, names and reasons of those that missed a limit or failed, and the path of the table."""

    table: Table
    failed: tuple[tuple[str, str], ...]
    path: Path


def run_manifest(
    path: Path,
    out: Path,
    repair: Repair,
    *,
    workers: int = 0,
    scheduler: str = "",
    pictures: bool = True,
    progress: Progress = silent,
) -> BatchOutcome:
    """Repair the recordings of a manifest that are not done yet, each in a folder of `out` with its name.

    Rows that failed by accident (a crash, the time limit, a full disk) are run again; those that were refused are not.

    Args:
        repair: Function that the workers can import.
        workers: Processes of this machine; 0 for one per physical core.
        scheduler: Address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`; "" for processes.
        pictures: Write a page and pictures for each row.

    Raises:
        InputError: A fault of the manifest, no Dask, or no scheduler.
        OutputError: The folder holds other files or cannot be written, or another repair works in it.
    """
    if scheduler:
        require_dask()
    check_own(out, has_format(out / MARK, FORMAT), "repairs")
    text, rows = load_manifest(path, out, pictures=pictures)
    about: dict[str, Any] = {"folder": str(out.resolve()), "repair": repair, "sources": source_digest()}
    planned = {row_digest(row): row for row in rows}
    tasks = {d: RowTask(row=row, digest=d, **about) for d, row in planned.items()}

    def on_end(end: TaskEnd) -> None:
        if end.reason:
            keep_lost(tasks[end.digest], end.reason)

    with locked(out, out, "repair"):
        content = {"format": FORMAT, "version": 1, "manifest": text}
        write_atomically(out / MARK, f"{json.dumps(content, indent=1)}\n".encode())
        left = [task for digest, task in tasks.items() if not finished(task.row, digest)]
        jobs = workers or max(1, len(physical_cores()))
        run_to_end(left, "recordings", on_end, progress, scheduler=scheduler, jobs=jobs, done=len(tasks) - len(left))
        lost = "its worker left no outcome in the folder"
        ended = [
            RepairedRow(row, read_outcome(row, digest) or RowOutcome(digest=digest, state="failed", reason=lost))
            for digest, row in planned.items()
        ]
        table = repair_table(ended)
        document = {
            "columns": {one.name: stored_unit(one.unit) for one in table.columns},
            "rows": plain_json(table.records),
        }
        write_together(
            {
                out / "table.csv": table.csv().encode(),
                out / "table.json": f"{json.dumps(document, indent=1, allow_nan=False)}\n".encode(),
            }
        )
    failed = tuple((row.planned.name, row.outcome.reason) for row in ended if row.outcome.reason)
    return BatchOutcome(table, failed, out / "table.csv")
