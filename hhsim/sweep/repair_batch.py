"""Repairs of a manifest: runs the rows that are not done yet, and writes the table and the page of all of them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hhsim.repair.request import Repair
from hhsim.sweep.engines import TaskEnd, require_dask, run_to_end
from hhsim.sweep.folder import check_own, has_format, locked
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.repair_manifest import (
    RowOutcome,
    RowTask,
    finished,
    keep_lost,
    load_manifest,
    read_outcome,
    row_digest,
)
from hhsim.sweep.repair_page import RepairedRow, repair_page, repair_table
from hhsim.system.atomic_write import write_atomically, write_together
from hhsim.system.plain_json import plain_json
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import physical_cores
from hhsim.table.table import Table, stored_unit

MARK = "repairs.json"
FORMAT = "hhsim-repairs"


@dataclass(frozen=True)
class BatchOutcome:
    """Table of all rows, names and reasons of those that missed a limit or failed, and the path of the page."""

    table: Table
    failed: tuple[tuple[str, str], ...]
    page: Path


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

    def on_end(end: TaskEnd) -> str:
        if end.reason:
            keep_lost(tasks[end.digest], end.reason)
        return ""

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
                out / "report.html": repair_page(ended, table, path.name).encode(),
            }
        )
    failed = tuple((row.name, row.outcome.reason) for row in ended if row.outcome.reason)
    return BatchOutcome(table, failed, out / "report.html")
