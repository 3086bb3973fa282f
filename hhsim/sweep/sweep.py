"""Sweep: runs the cells of a plan that are not done yet, and keeps each outcome as soon as it ends.

A cell is run in whatever process: what `hhsim replay` makes of the same words, in the folder of the sweep. `sweep.json`
identifies that folder, and `cells/` has each cell's result (DIGEST.h5) and row (DIGEST.json). Each appears in one step,
so that an interrupted sweep leaves only complete files.
"""

import contextlib
import hashlib
import json
import math
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, TypeAlias

from hhsim.errors import HhsimError, InputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary, digits_with, repeated_document
from hhsim.result.writer import add_document
from hhsim.scene.described_scene import described_scene
from hhsim.scene.scene import Scene
from hhsim.solver.solver import warm_up
from hhsim.sweep.engines import Task, TaskEnd, TaskFolder, require_dask, run_to_end
from hhsim.sweep.input_files import CHANGED, LostFileError, ReadFile, source_digest
from hhsim.sweep.plan import OF_THE_SCENE, Cell, SweepPlan
from hhsim.system import environment as info
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.plain_json import plain_json
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import on_own_core, physical_cores
from hhsim.table.table import Column, Table, number, shown, words

MARK = "sweep.json"
CELLS = "cells"
FORMAT, ROW_FORMAT, VERSION = "hhsim-sweep", "hhsim-cell", 1
PARTIAL = ".partial.h5"
"""Suffix of a result that is being written, in a name that begins with a point."""


class SweepFolder(TaskFolder):
    """Folder of a sweep."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "sweep", MARK, FORMAT)
        self.cells = path / CELLS

    @contextlib.contextmanager
    def taken(self, plan: SweepPlan) -> Iterator[None]:
        """Make and lock the folder and remove unfinished files; OutputError if it is not writable, or locked."""
        with self.locked(CELLS, version=VERSION, name=plan.name, plan=plan.text):
            try:
                self._clean()
                yield
            finally:
                with contextlib.suppress(OSError):
                    self._clean()

    def done(self, digest: str, cell: Cell, with_result: bool = False) -> bool:
        """Return True if a cell is done as often as planned, with its result if wanted; rename it in its row."""
        row = self.row(digest)
        result = row.get("result")
        if not row or (with_result and not result):
            return False
        if result and content_digest(self.cells / result) != row.get("result_sha256"):
            return False
        if row.get("repeated", {}).get("runs", 1) < cell.repeat:
            return False
        if row["cell"] != _named(cell):
            write_row(self.cells, cell, digest, row)
        return True

    def row(self, digest: str) -> dict[str, Any]:
        """Return the row of a cell that was run, however often; {} for any other, and one not as it was written."""
        try:
            found = json.loads(read_input_text(self.cells / f"{digest}.json"))
        except (OSError, ValueError, InputError):
            return {}
        wanted = {"format": ROW_FORMAT, "version": VERSION, "digest": digest}
        is_whole = (
            isinstance(found, dict) and wanted.items() <= found.items() and found.get("sha256") == _row_digest(found)
        )
        return found if is_whole else {}

    def _clean(self) -> None:
        for pattern in (f".*{PARTIAL}", ".*.tmp"):
            for left in self.cells.glob(pattern):
                left.unlink(missing_ok=True)


def content_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal; "" if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def write_row(folder: Path, cell: Cell, digest: str, content: Mapping[str, Any]) -> None:
    """Write the row of a cell in a folder in one step, null for NaN and infinity; OutputError if it cannot be."""
    row = plain_json({**content, "format": ROW_FORMAT, "version": VERSION, "digest": digest, "cell": _named(cell)})
    text = json.dumps({**row, "sha256": _row_digest(row)}, indent=1, sort_keys=True, allow_nan=False)
    write_atomically(folder / f"{digest}.json", f"{text}\n".encode())


def _row_digest(row: Mapping[str, Any]) -> str:
    """Return the SHA-256 of what a row holds beside it, hexadecimal."""
    content = {name: value for name, value in row.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _named(cell: Cell) -> dict[str, Any]:
    """Return the names that a plan gives a cell."""
    names = {"object": cell.object.name, "motion": cell.motion.name, "method": cell.method}
    return {**names, "surface": cell.surface, "options": cell.options_name, "seed": cell.seed}


OF_THE_ROW = (
    *("object", "object_mesh", "level", "max_error", "trajectory", "samples", "place_object", "hand_file"),
    *("tremor_mm_deg", "seed", "ticks"),
)
"""Statements of a result about its scene that a row repeats."""


@dataclass(frozen=True, kw_only=True)
class CellTask(Task):
    """Cell of a sweep, in its folder."""

    cell: Cell
    keeps_result: bool = True  # True if the result is kept, not the row alone
    wants_core: bool = True  # True if it waits for a core of its own

    def work(self) -> TaskEnd:
        """Run the cell and write its files, the row last: a cell is done when its row is there."""
        began = time.perf_counter()
        cell, folder = self.cell, Path(self.folder)
        partial = folder / f".{self.digest}-{uuid.uuid4().hex[:8]}{PARTIAL}"
        files = cell.read_files()
        if cell.digest() != self.digest:
            raise LostFileError(CHANGED)
        of_scene = {name: value for name, value in cell.options.items() if name in (*OF_THE_SCENE, "fingers")}
        what = [cell.object, cell.motion, cell.surface == "mesh", of_scene, cell.seed, cell.ticks]
        scene = _scene(_SceneKey(repr(what), files, cell))

        def run() -> list[ReplaySummary]:
            return [replay_scene(scene, cell.solver_options(), partial) for _ in range(cell.repeat)]

        try:
            # The threads of a tick want a core each.
            pinned = self.wants_core and cell.solver_options().threads == 1
            runs, own_core = on_own_core(run) if pinned else (run(), False)
            repeated = repeated_document(runs) if cell.repeat > 1 else {}
            result = f"{self.digest}.h5" if self.keeps_result else None
            kept: dict[str, str] = {}
            if result is not None:
                if repeated:
                    add_document(partial, "repeated", repeated)
                kept = {"result_sha256": content_digest(partial)}
                partial.replace(folder / result)
        finally:
            partial.unlink(missing_ok=True)
        seconds = time.perf_counter() - began
        summary, options, origin = runs[-1], cell.solver_options().at_rate(scene.ticks.rate), info.file_attributes()
        stated = {name: scene.description.get(name) for name in OF_THE_ROW}
        row = {
            **origin,
            **{name: json.loads(str(origin[name])) for name in ("machine", "packages")},
            **({"repeated": repeated} if repeated else {}),
            "result": result,
            **kept,
            "own_core": own_core,
            "seconds": seconds,
            "scene": {**stated, "rate": 1.0 / options.period, "solver": options.to_json()},
            "verdict": summary.verdict.word,
            "missed": list(summary.verdict.missed),
            "summary": summary.attributes(),
            "notes": list(summary.notes),
        }
        write_row(folder, cell, self.digest, row)
        return TaskEnd(self.digest, ticks=sum(summary.ticks for summary in runs))


@dataclass(frozen=True)
class _SceneKey:
    """Parts that a scene depends on, and a cell with it."""

    says: str
    files: tuple[ReadFile, ...]
    cell: Cell = field(compare=False)


# To place an object for a recording takes longer than most replays: the methods of a scene share it.
@lru_cache(2)
def _scene(key: _SceneKey) -> Scene:
    cell = key.cell
    try:
        loaded = cell.load()
        bodies, _ = loaded.with_trees()
        return described_scene(cell.words(), bodies, loaded.hands, loaded.motions, cell.solver_options().fingers).scene
    finally:
        # What is raised here is not kept as the scene of these files.
        if cell.read_files() != key.files:
            raise LostFileError(CHANGED)


@dataclass(frozen=True)
class SweepSummary:
    """Outcome of a sweep: numbers of cells of the plan, run by it and done before, and why others failed.

    Reasons are by the digests of the cells. Ticks are of all runs; the duration [s] is with kernels and trees.
    """

    cells: int
    run: int
    done_before: int
    failed: Mapping[str, str]
    ticks: int
    seconds: float


def run_sweep(
    plan: SweepPlan,
    folder: SweepFolder,
    *,
    jobs: int = 0,
    scheduler: str = "",
    keep_results: bool = True,
    progress: Progress = silent,
) -> SweepSummary:
    """Run the cells that are not done yet, those that failed before too.

    Args:
        jobs: Processes of this machine; 0 for one per physical core.
        scheduler: Address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`; "" for processes.
        keep_results: Keep the result of each cell, not its row alone.

    Raises InputError without Dask or a scheduler, OutputError for a folder that is not writable or another sweep's.
    """
    if scheduler:
        require_dask()
    cores = len(physical_cores())
    workers = jobs or max(1, cores)
    with folder.taken(plan):
        waiting = {of: cell for of, cell in plan.cells.items() if not folder.done(of, cell, keep_results)}
        began, ticks, failed = perf_counter(), 0, dict[str, str]()
        before = len(plan.cells) - len(waiting)
        if waiting:
            prepare(list(waiting.values()), progress)
            about: dict[str, Any] = {
                "folder": str(folder.cells.resolve()),
                "keeps_result": keep_results,
                # More processes than cores cannot have one each; a cluster's workers wait for one.
                "wants_core": bool(scheduler) or workers <= cores,
                "sources": source_digest(),
            }
            root = plan.folder.resolve()
            tasks = [CellTask(cell=replace(cell, folder=root), digest=of, **about) for of, cell in waiting.items()]

            def on_end(end: TaskEnd) -> None:
                nonlocal ticks
                ticks += end.ticks
                failed.update({end.digest: end.reason} if end.reason else {})

            run_to_end(tasks, "cells", on_end, progress, scheduler=scheduler, jobs=workers, done=before)
    return SweepSummary(len(plan.cells), len(waiting) - len(failed), before, failed, ticks, perf_counter() - began)


def prepare(cells: Sequence[Cell], progress: Progress = silent) -> None:
    """Compile kernels and build trees before several processes would do so at once; errors are left to the cells."""
    kinds = {(cell.method, cell.surface): cell for cell in cells}
    shapes = {
        (cell.object, cell.surface == "mesh", cell.options.get("level"), cell.options.get("max_error")): cell
        for cell in cells
    }
    total = len(kinds) + len(shapes)
    for place, cell in enumerate([*kinds.values(), *shapes.values()]):
        progress("getting ready", place, total)
        try:
            loaded = cell.load()
            if place < len(kinds):
                warm_up(loaded.hands[0], cell.solver_options())
            else:
                loaded.with_trees()
        except HhsimError:
            continue


TABLE = "table.csv"
"""File of the table in the folder of a sweep."""
FAILED = "failed"
NOTE = "~ before a time: its cell had no core of its own, so that it compares with no other time"
CellRow: TypeAlias = dict[str, Any]
"""Values of a cell by the names of `COLUMNS`."""
NAMES = tuple(map(words, ("object", "motion", "method", "surface", "options")))
COLUMNS: tuple[Column, ...] = (
    *NAMES,
    Column("seed"),
    words("machine"),
    words("verdict"),
    Column("times_comparable", "whether its ticks had a core of their own: else its times say little"),
    Column("runs"),
    # Times are means over the runs.
    *(Column(name, metric.label, metric.unit) for name, metric in run_metrics().items()),
    *(Column(f"{name}_std", unit=metric.stored_unit) for name, metric in run_metrics().items() if metric.noise),
    words("reason"),
)
"""Every figure, SI or %: for programs."""


def cell_rows(plan: SweepPlan, folder: SweepFolder, failed: Mapping[str, str]) -> list[CellRow]:
    """Return the rows of the cells that are done or have `failed` (reasons by digest), in the order of the plan."""
    rows = []
    for digest, cell in plan.cells.items():
        if reason := failed.get(digest):
            rows.append(failed_row(cell, reason))
        elif row := folder.row(digest):
            rows.append(done_row(cell, row))
    return rows


def failed_row(cell: Cell, reason: str) -> CellRow:
    """Return the row of a cell without a result."""
    options = f"{cell.options_name}: {cell.stated}" if cell.stated else cell.options_name
    about = {"options": options, "machine": "", "verdict": FAILED, "runs": 1, "reason": reason}
    return {**dict.fromkeys(column.name for column in COLUMNS), **_named(cell), **about, "times_comparable": False}


def done_row(cell: Cell, row: Mapping[str, Any]) -> CellRow:
    """Return the row of a cell that was run, from its file."""
    repeated = row.get("repeated", {})
    times = repeated.get("times", {})
    found = {**row["summary"], **{name: time["mean"] for name, time in times.items()}}
    return {
        **failed_row(cell, ", ".join(row["missed"])),
        **{name: found.get(name) for name in run_metrics()},
        **{f"{name}_std": time["std"] for name, time in times.items()},
        "verdict": row["verdict"],
        "machine": str(row["machine"].get("cpu", "")),
        "times_comparable": bool(row["own_core"]),
        "runs": repeated.get("runs", 1),
    }


def shown_table(rows: Sequence[CellRow]) -> Table:
    """Return the table as people read it."""
    columns = (
        *NAMES,
        words("verdict", lambda row: f"{row['verdict']}: {row['reason']}" if row["reason"] else row["verdict"]),
        number("depth", "penetration_max", "µm", 3),
        number("off the mesh", "contact_error_max", "mm", 3),
        number("over optimum", "tracking_excess", "%", 2),
        number("force", "force_contact_mean", "N", 2),
        number("stuck", "stuck_ticks"),
        number("p50", lambda row: _time(row, "tick_cpu_p50"), "µs"),
        number("p99", lambda row: _time(row, "tick_cpu_p99"), "µs"),
    )
    alone = all(row["times_comparable"] for row in rows if row["verdict"] != FAILED)
    optional = "stuck", "over optimum [%]", "force [N]", "p99 [µs]", "surface"
    return Table(columns, rows, notes=() if alone else (NOTE,), optional=optional)


def _time(row: CellRow, name: str) -> str:
    """Return a time in µs, with ± standard deviation where there is one."""
    seconds, deviation = (math.nan if row[key] is None else row[key] for key in (name, f"{name}_std"))
    digits = digits_with(1e6 * deviation, 1)
    text = shown(1e6 * seconds, digits)
    text += f" ± {shown(1e6 * deviation, digits)}" if deviation == deviation else ""
    return text if row["times_comparable"] or seconds != seconds else f"~{text}"
