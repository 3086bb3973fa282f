"""Repairs of a manifest: runs the rows that are not done yet, and writes the table of all of them.

A row is repaired in whatever process; outcome.json, written last, is what its folder keeps of it.
"""

import faulthandler
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from msgspec import field, structs

from hhsim import __version__
from hhsim.errors import InputError, TrajectoryError
from hhsim.mesh.catalogue import names_a_file
from hhsim.metrics.field.field_table import field_metrics
from hhsim.repair.request import Repair
from hhsim.sweep.engines import Task, TaskEnd, TaskFolder, error_line, require_dask, run_to_end
from hhsim.sweep.input_files import CHANGED, LostFileError, ReadFile, file_digest, read_files, source_digest
from hhsim.sweep.plan import DIGITS
from hhsim.sweep.repair_manifest import OUTCOME, PlannedRepair, load_manifest
from hhsim.system.atomic_write import write_atomically, write_together
from hhsim.system.input_file import read_input_text
from hhsim.system.plain_json import plain_json
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Settings, Version, typed
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
State = Literal["repaired", "missed", "refused", "failed"]


class RowOutcome(Settings, frozen=True, kw_only=True):
    """Outcome of a row."""

    format: Literal["hhsim-repair"] = "hhsim-repair"
    version: Version = 1
    digest: str  # digest of what it depends on
    # "repaired" within all limits; "missed", repaired but a limit is missed; "refused", a recording that cannot be read
    # or used; "failed" for any other reason.
    state: State
    reason: str = ""  # reason of a state other than "repaired"
    is_final: bool = True  # False if the same row may come to another end next time, as after a crash
    # As in `hhsim.repair.request.RepairOutcome`; null for NaN.
    figures: dict[str, float | None] = field(default_factory=dict)
    frames: int = 0
    marked: tuple[int, ...] = ()
    verdict: str = ""
    doubts: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    paths: dict[str, str] = field(default_factory=dict)  # names of files in the row's folder, by what they hold


@dataclass(frozen=True, kw_only=True)
class RowTask(Task):
    """Row of a manifest, in the folder of all of them: the end has a reason if it left no outcome in its own folder."""

    row: PlannedRepair
    repair: Repair  # function of a module that the process can import

    def work(self) -> TaskEnd:
        """Repair the recording."""
        folder = self.row.request.out.parent
        # A cluster runs again what a worker had done when it was lost.
        if not finished(self.row, self.digest):
            _empty(folder)
            write_outcome(folder, self._outcome(folder))
        return TaskEnd(self.digest)

    def _outcome(self, folder: Path) -> RowOutcome:
        try:
            with _within(self.row.time_limit):
                files = row_files(self.row)
                if row_digest(self.row) != self.digest:
                    raise LostFileError(CHANGED)
                try:
                    done = self.repair(self.row.request)
                finally:
                    if row_files(self.row) != files:
                        raise LostFileError(CHANGED)
            if not self.row.request.out.is_file():
                raise InputError(f"it wrote no {self.row.request.out.name}")
            return RowOutcome(
                digest=self.digest,
                state="repaired" if done.ok else "missed",
                reason="" if done.ok else done.verdict,
                figures={name: float(value) for name, value in done.figures.items()},
                frames=int(done.frames),
                marked=tuple(map(int, done.marked)),
                verdict=done.verdict,
                doubts=tuple(done.doubts),
                findings=tuple(done.findings),
                paths={name: Path(os.path.relpath(path, folder)).as_posix() for name, path in done.paths.items()},
            )
        except Exception as error:
            is_final = isinstance(error, InputError | TrajectoryError) and not isinstance(error, LostFileError)
            state: State = "refused" if isinstance(error, TrajectoryError) else "failed"
            _empty(folder)
            return RowOutcome(digest=self.digest, state=state, reason=error_line(error), is_final=is_final)


@contextmanager
def _within(seconds: float) -> Iterator[None]:
    """End the process where this takes longer [s]."""
    with Path(os.devnull).open("w") as nowhere:
        # Its thread waits for no lock of Python, which compiled code may hold.
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def row_files(row: PlannedRepair) -> tuple[ReadFile, ...]:
    """Return the files that a row reads, as they are now; InputError if one cannot be read."""
    request = row.request
    shape = [Path(request.object)] if names_a_file(request.object) else []
    given = [value for name, value in (*vars(request).items(), *vars(request.read).items()) if name != "out"]
    return tuple(read for value in (*given, *shape) if isinstance(value, Path) for read in read_files(value))


def row_digest(row: PlannedRepair) -> str:
    """Return a digest of a row: the content of its files, its options, its name, and hhsim's sources."""
    request = row.request
    stated = {name: value for name, value in vars(request).items() if name != "out"}
    stated["read"] = vars(request.read)
    stated["object"] = Path(request.object) if names_a_file(request.object) else request.object
    stated |= {"name": row.name, "file": request.out.name, "hhsim": [__version__, source_digest()]}
    text = json.dumps(stated, sort_keys=True, default=_content)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def read_outcome(row: PlannedRepair, digest: str) -> RowOutcome | None:
    """Return the outcome of a row with this digest; None if there is none, or it lacks its recording."""
    path = row.request.out.parent / OUTCOME
    try:
        found = typed(json.loads(read_input_text(path)), RowOutcome, str(path))
    except (OSError, ValueError, InputError):
        return None
    if found.state in ("repaired", "missed") and not row.request.out.is_file():
        return None
    return found if found.digest == digest else None


def finished(row: PlannedRepair, digest: str) -> RowOutcome | None:
    """Return the outcome of a row that has come to an end for good."""
    found = read_outcome(row, digest)
    return found if found is not None and found.is_final else None


def write_outcome(folder: Path, outcome: RowOutcome) -> None:
    """Write the outcome of a row in one step; OutputError if that fails."""
    text = json.dumps(plain_json(structs.asdict(outcome)), indent=1, allow_nan=False)
    write_atomically(folder / OUTCOME, f"{text}\n".encode())


def _empty(folder: Path) -> None:
    """Make a folder, and remove what is in it."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _content(value: Any) -> str:
    try:
        return file_digest(value) if isinstance(value, Path) else repr(value)
    except InputError as error:
        # The repair of this row will say so; the others go on.
        return str(error)


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
    folder = TaskFolder(out, "repair", MARK, FORMAT)
    text, rows = load_manifest(path, out, pictures=pictures)
    about: dict[str, Any] = {"folder": str(out.resolve()), "repair": repair, "sources": source_digest()}
    planned = {row_digest(row): row for row in rows}
    tasks = {d: RowTask(row=row, digest=d, **about) for d, row in planned.items()}

    def on_end(end: TaskEnd) -> None:
        if end.reason:
            # The worker left no outcome.
            row = tasks[end.digest].row
            reason = f"{end.reason}; its time_limit is {row.time_limit:,g} s"
            _empty(row.request.out.parent)
            lost = RowOutcome(digest=end.digest, state="failed", reason=reason, is_final=False)
            write_outcome(row.request.out.parent, lost)

    with folder.locked(version=1, manifest=text):
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
