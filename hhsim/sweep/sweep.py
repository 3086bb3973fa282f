"""Sweep: runs the cells of a plan that are not done yet, and keeps each outcome as soon as it ends."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from hhsim.errors import HhsimError
from hhsim.solver.hand_solver import warm_up
from hhsim.sweep.cell_run import CellTask, load_cell
from hhsim.sweep.engines import TaskEnd, require_dask, run_to_end
from hhsim.sweep.folder import SweepFolder, lasting
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.plan import Cell, PlannedCell, SweepPlan
from hhsim.system import environment as info
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import physical_cores


@dataclass(frozen=True)
class SweepSummary:
    """Outcome of a sweep: numbers of cells of the plan, run by it and done before; those that failed, now or before.

    Each of these has the reason. Ticks are of all runs; the duration [s] is with kernels and trees.
    """

    cells: int
    run: int
    done_before: int
    failed: tuple[tuple[Cell, str], ...]
    ticks: int
    seconds: float


def run_sweep(
    plan: SweepPlan,
    folder: SweepFolder,
    *,
    jobs: int = 0,
    scheduler: str = "",
    retry_failed: bool = False,
    keep_results: bool = True,
    progress: Progress = silent,
) -> SweepSummary:
    """Run the cells that are not done yet.

    Args:
        jobs: Processes of this machine; 0 for one per physical core.
        scheduler: Address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`; "" for processes.
        retry_failed: Run cells again that failed before.
        keep_results: Keep the result of each cell, not its row alone.

    Raises InputError without Dask or a scheduler, OutputError for a folder that is not writable or another sweep's.
    """
    if scheduler:
        require_dask()
    cores = len(physical_cores())
    workers = jobs or max(1, cores)
    with folder.taken(plan):
        before = {planned.digest for planned in plan.cells if folder.done(planned, keep_results)}
        missing = [planned for planned in plan.cells if planned.digest not in before]
        waiting = {planned.digest: planned for planned in missing if retry_failed or not folder.failure(planned)}
        began, done, ticks, lost = perf_counter(), 0, 0, dict[str, str]()
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
            cells_began = perf_counter()

            def on_end(end: TaskEnd) -> str:
                nonlocal done, ticks
                planned = waiting.pop(end.digest)
                if end.reason and not end.is_final:
                    lost[end.digest] = end.reason
                elif end.reason:
                    folder.keep_failure(planned, end.reason)
                else:
                    folder.forget_failure(planned)
                    done, ticks = done + 1, ticks + end.ticks
                left = sum(each.run_ticks for each in waiting.values())
                still = (perf_counter() - cells_began) * left / max(1, ticks)
                return f" (about {lasting(still)} left)" if left and ticks else ""

            run_to_end(tasks, "cells", on_end, progress, scheduler=scheduler, jobs=workers, done=len(before))
        reasons = [(cell.cell, lost.get(cell.digest) or folder.failure(cell)) for cell in missing]
        failed = tuple((cell, reason) for cell, reason in reasons if reason)
    return SweepSummary(len(plan.cells), done, len(before), failed, ticks, perf_counter() - began)


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


@dataclass(frozen=True)
class Estimate:
    """Size and duration of a sweep."""

    cells: int  # number of cells of the plan
    done: int  # number of those that finished before
    failed: int  # number of those that failed before
    ticks: int  # ticks of the cells that are left, in all their runs
    seconds: float  # duration of these one after the other, by those done on this machine; NaN without any

    @property
    def left(self) -> int:
        """Number of cells to run."""
        return self.cells - self.done - self.failed

    def elapsed(self, workers: int) -> float:
        """Return the duration [s] in so many processes, as if none slowed another."""
        return self.seconds / max(1, min(workers, self.left))


def estimate(plan: SweepPlan, folder: SweepFolder) -> Estimate:
    """Count the cells, and estimate the time of those left by the most similar that ran; the folder need not exist."""
    done = {planned.digest for planned in plan.cells if folder.done(planned)}
    failed = {planned.digest for planned in plan.cells if planned.digest not in done and folder.failure(planned)}
    left = [planned for planned in plan.cells if planned.digest not in done | failed]
    spent, here = dict[tuple[Any, ...], tuple[int, float]](), info.machine()
    for planned in plan.cells:
        row = folder.row(planned)
        if row.get("machine") == here:
            runs = planned.ticks * row.get("repeated", {}).get("runs", 1)
            for likeness in _likenesses(planned.cell):
                ticks, seconds = spent.get(likeness, (0, 0.0))
                spent[likeness] = ticks + runs, seconds + float(row["seconds"])
    total = 0.0
    for planned in left:
        known = (spent[likeness] for likeness in _likenesses(planned.cell) if likeness in spent)
        ticks, seconds = next(known, (0, math.nan))
        total += planned.run_ticks * seconds / max(1, ticks)
    return Estimate(len(plan.cells), len(done), len(failed), sum(planned.run_ticks for planned in left), total)


def _likenesses(cell: Cell) -> tuple[tuple[Any, ...], ...]:
    """Return keys that similar cells share, the most specific first."""
    # Method, surface and options decide most of a tick's time.
    same, shape, motion = (cell.method, cell.surface, cell.options_name), cell.object.name, cell.motion.name
    return (*same, shape, motion), (*same, shape), (*same, None, motion), same, ()
