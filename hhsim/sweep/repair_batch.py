"""Repairs of a manifest: runs the rows that are not done yet, and writes the table and the page of all of them."""

import json
import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from hhsim.repair.request import Illustrate, Pictures, Repair
from hhsim.sweep.engines import TaskEnd, require_dask, run_to_end
from hhsim.sweep.folder import check_own, has_format, locked
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.repair_manifest import (
    RowOutcome,
    RowTask,
    finished,
    is_done,
    keep_lost,
    load_manifest,
    read_outcome,
    row_digest,
)
from hhsim.sweep.repair_page import RepairedRow, repair_page, repair_table, worst_rows
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
    illustrate: Illustrate,
    *,
    workers: int = 0,
    scheduler: str = "",
    pictures: Pictures = "worst",
    progress: Progress = silent,
) -> BatchOutcome:
    """Repair the recordings of a manifest that are not done yet, each in a folder of `out` with its name.

    Rows that failed by accident (a crash, the time limit, a full disk) are run again; those that were refused are not.

    Args:
        repair: Function that the workers can import.
        illustrate: Function that makes the pictures of a row that is repaired; the workers can import it, too.
        workers: Processes of this machine; 0 for one per physical core.
        scheduler: Address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`; "" for processes.
        pictures: Rows that have a page and pictures of their own: the `worst` ten, `all` or `none`.

    Raises:
        InputError: A fault of the manifest, no Dask, or no scheduler.
        OutputError: The folder holds other files or cannot be written, or another repair works in it.
    """
    if scheduler:
        require_dask()
    check_own(out, has_format(out / MARK, FORMAT), "repairs")
    text, rows = load_manifest(path, out)
    attempt, undrawn = uuid.uuid4().hex, dict[str, str]()
    planned = {row_digest(row): row for row in rows}

    def run(stage: str, digests: Iterable[str], pictured: bool) -> list[RepairedRow]:
        """Run the rows of these digests that are not done yet, and return all rows with their outcomes."""
        tasks = {
            digest: RowTask(
                row=planned[digest].pictured(pictured),
                digest=digest,
                folder=str(out.resolve()),
                repair=repair,
                illustrate=illustrate,
                attempt=attempt,
                sources=source_digest(),
            )
            for digest in digests
        }
        left = [task for digest, task in tasks.items() if not is_done(task.row, digest)]

        def on_end(end: TaskEnd) -> str:
            if end.reason and finished(planned[end.digest], end.digest):
                undrawn[end.digest] = f"without its pictures: {end.reason}"
            elif end.reason:
                keep_lost(tasks[end.digest], end.reason)
            return ""

        jobs = workers or max(1, len(physical_cores()))
        run_to_end(left, stage, on_end, progress, scheduler=scheduler, jobs=jobs, done=len(tasks) - len(left))
        lost = "its worker left no outcome in the folder"
        found = {digest: read_outcome(row, digest) for digest, row in planned.items()}
        return [
            RepairedRow(row, found[digest] or RowOutcome(digest=digest, state="failed", reason=lost))
            for digest, row in planned.items()
        ]

    with locked(out, out, "repair"):
        content = {"format": FORMAT, "version": 1, "manifest": text}
        write_atomically(out / MARK, f"{json.dumps(content, indent=1)}\n".encode())
        ended = run("recordings", planned, pictures == "all")
        worst = [(row.planned.pictured(True), row.outcome.digest) for row in worst_rows(ended) if pictures == "worst"]
        if left := [digest for row, digest in worst if not is_done(row, digest)]:
            ended = run("pictures", left, True)
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
    reasons = {row.name: row.outcome.reason or undrawn.get(row.outcome.digest, "") for row in ended}
    failed = tuple((name, reason) for name, reason in reasons.items() if reason)
    return BatchOutcome(table, failed, out / "report.html")
