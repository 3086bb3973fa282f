"""Sweep: runs the cells of a plan that are not done yet, and keeps each outcome as soon as it ends.

A cell is run in whatever process: what `hhsim replay` makes of the same words, in the sweep's folder.
"""

import json
import time
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any

from msgspec import structs

from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import names_a_file
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary, repeated_document
from hhsim.result.writer import add_document
from hhsim.scene.described_scene import LoadedWords, described_scene, load_words
from hhsim.scene.motion_catalogue import trajectory_names
from hhsim.scene.scene import Scene
from hhsim.solver.hand_solver import warm_up
from hhsim.sweep.engines import Task, TaskEnd, require_dask, run_to_end
from hhsim.sweep.folder import PARTIAL, SweepFolder, content_digest, write_row
from hhsim.sweep.input_files import CHANGED, LostFileError, ReadFile, read_files, source_digest
from hhsim.sweep.plan import OF_THE_SCENE, Cell, PlannedCell, SweepPlan
from hhsim.system import environment as info
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import on_own_core, physical_cores

OF_THE_ROW = (
    *("object", "object_mesh", "level", "max_error", "trajectory", "samples", "place_object", "hand_file"),
    *("tremor_mm_deg", "seed", "ticks"),
)
"""Statements of a result about its scene that a row repeats."""


@dataclass(frozen=True, kw_only=True)
class CellTask(Task):
    """Cell of a sweep, in its folder."""

    cell: Cell
    plan_folder: str  # absolute folder that the plan's files are relative to
    keeps_result: bool = True  # True if the result is kept, not the row alone
    wants_core: bool = True  # True if it waits for a core of its own

    def work(self) -> TaskEnd:
        """Run the cell and write its files, the row last: a cell is done when its row is there."""
        began = time.perf_counter()
        cell, folder, plan_folder = self.cell, Path(self.folder), Path(self.plan_folder)
        partial = folder / f".{self.digest}-{uuid.uuid4().hex[:8]}{PARTIAL}"
        files = cell_files(cell, plan_folder)
        if cell.digest(plan_folder) != self.digest:
            raise LostFileError(CHANGED)
        of_scene = {name: value for name, value in cell.options.items() if name in (*OF_THE_SCENE, "fingers")}
        what = [cell.object, cell.motion, cell.surface == "mesh", of_scene, cell.seed, cell.ticks]
        scene = _scene(_SceneKey(repr(what), files, cell), plan_folder)

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
        write_row(folder / f"{self.digest}.json", cell, self.digest, row)
        return TaskEnd(self.digest, ticks=sum(summary.ticks for summary in runs))


@dataclass(frozen=True)
class _SceneKey:
    """Parts that a scene depends on, and a cell with it."""

    says: str
    files: tuple[ReadFile, ...]
    cell: Cell = field(compare=False)


# To place an object for a recording takes longer than most replays: the methods of a scene share it.
@lru_cache(2)
def _scene(key: _SceneKey, plan_folder: Path) -> Scene:
    cell = key.cell
    try:
        loaded = load_cell(cell, plan_folder)
        bodies, _ = loaded.grown()
        return described_scene(cell.words(), bodies, loaded.hands, loaded.motions, cell.solver_options().fingers).scene
    finally:
        # What is raised here is not kept as the scene of these files.
        if cell_files(cell, plan_folder) != key.files:
            raise LostFileError(CHANGED)


def cell_files(cell: Cell, plan_folder: Path) -> tuple[ReadFile, ...]:
    """Return the files that a cell reads, as they are now; InputError if one cannot be read."""
    return tuple(read for word in cell.files for read in read_files(plan_folder / word))


def load_cell(cell: Cell, plan_folder: Path) -> LoadedWords:
    """Load the motion and the bodies of a cell; HhsimError as `hhsim.scene.described_scene.load_words`."""
    words = cell.words()
    files = {"object": names_a_file(words.object), "trajectory": words.trajectory not in trajectory_names()}
    files["hand_file"] = words.hand_file is not None
    own = {name: str(plan_folder / getattr(words, name)) for name, is_file in files.items() if is_file}
    return load_words(structs.replace(words, **own), surface=cell.surface)


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
        waiting = {planned.digest: planned for planned in plan.cells if not folder.done(planned, keep_results)}
        began, ticks, failed = perf_counter(), 0, dict[str, str]()
        before = len(plan.cells) - len(waiting)
        if waiting:
            prepare(plan, list(waiting.values()), progress)
            about: dict[str, Any] = {
                "plan_folder": str(plan.folder.resolve()),
                "folder": str(folder.cells.resolve()),
                "keeps_result": keep_results,
                # More processes than cores cannot have one each; a cluster's workers wait for one.
                "wants_core": bool(scheduler) or workers <= cores,
                "sources": source_digest(),
            }
            tasks = [CellTask(cell=planned.cell, digest=digest, **about) for digest, planned in waiting.items()]

            def on_end(end: TaskEnd) -> None:
                nonlocal ticks
                ticks += end.ticks
                failed.update({end.digest: end.reason} if end.reason else {})

            run_to_end(tasks, "cells", on_end, progress, scheduler=scheduler, jobs=workers, done=before)
    return SweepSummary(len(plan.cells), len(waiting) - len(failed), before, failed, ticks, perf_counter() - began)


def prepare(plan: SweepPlan, cells: Sequence[PlannedCell], progress: Progress = silent) -> None:
    """Compile kernels and build trees before several processes would do so at once; errors are left to the cells."""
    kinds = {(planned.cell.method, planned.cell.surface): planned.cell for planned in cells}
    shapes = {
        (c.object, c.surface == "mesh", c.options.get("level"), c.options.get("max_error")): c
        for c in (planned.cell for planned in cells)
    }
    total = len(kinds) + len(shapes)
    for number, cell in enumerate([*kinds.values(), *shapes.values()]):
        progress("getting ready", number, total)
        try:
            loaded = load_cell(cell, plan.folder)
            if number < len(kinds):
                warm_up(loaded.hands[0], cell.solver_options())
            else:
                loaded.grown()
        except HhsimError:
            continue
