"""Sweep: runs the cells of a plan that are not done yet, and keeps each outcome as soon as it ends.

Its duration is estimated from the cells in its folder that ran on this machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from hhsim.errors import HhsimError
from hhsim.solver.hand_solver import warm_up
from hhsim.sweep.cell_run import CellTask, load_cell
from hhsim.sweep.engines import LOCAL, TaskEnd, require_dask, run_to_end
from hhsim.sweep.folder import SweepFolder, lasting, pace_of
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.plan import Cell, PlannedCell, SweepPlan
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import physical_cores


@dataclass(frozen=True)
class SweepOptions:
    """Options of a sweep."""

    jobs: int = 0  # processes of this machine; 0 for one per physical core
    scheduler: str = ""  # address of a Dask cluster, or `hhsim.sweep.engines.LOCAL`; "" for processes
    retry_failed: bool = False  # run cells again that failed before
    keep_results: bool = True  # keep the result of each cell, not its row alone

    @property
    def workers(self) -> int:
        """Number of processes of this machine."""
        return self.jobs or max(1, len(physical_cores()))


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


def run_sweep(plan: SweepPlan, folder: SweepFolder, options: SweepOptions, progress: Progress = silent) -> SweepSummary:
    """Run the cells that are not done yet.

    Raises InputError without Dask or a scheduler, OutputError for a folder that is not writable or another sweep's.
    """
    if options.scheduler:
        require_dask()
    with folder.taken(plan):
        before = {planned.digest for planned in plan.cells if folder.done(planned, options.keep_results)}
        left = [planned for planned in plan.cells if planned.digest not in before]
        if not options.retry_failed:
            left = [planned for planned in left if not folder.failure(planned)]
        began = perf_counter()
        done, ticks, lost = 0, 0, dict[str, str]()
        if left:
            prepare(plan, left, progress)
            # More processes than cores cannot have one each; a cluster's workers wait for one.
            wants_core = bool(options.scheduler) or options.workers <= len(physical_cores())
            tasks = [
                CellTask(
                    cell=planned.cell,
                    digest=planned.digest,
                    plan_folder=str(plan.folder.resolve()),
                    folder=str(folder.cells.resolve()),
                    keeps_result=options.keep_results,
                    wants_core=wants_core,
                    sources=source_digest(),
                )
                for planned in left
            ]
            waiting = {planned.digest: planned for planned in left}
            pace, spent, cells_began = pace_of(plan.cells, folder), 0.0, perf_counter()

            def on_end(end: TaskEnd) -> str:
                nonlocal done, ticks, spent
                planned = waiting.pop(end.digest)
                if end.reason and not end.is_final:
                    lost[end.digest] = end.reason
                elif end.reason:
                    folder.keep_failure(planned, end.reason)
                else:
                    folder.forget_failure(planned)
                    done, ticks, spent = done + 1, ticks + end.ticks, spent + end.seconds
                    pace.add(planned.cell, end.ticks, end.seconds)
                # How many work on a cluster shows in what they have done.
                at_once = options.workers
                if options.scheduler not in ("", LOCAL):
                    at_once = max(1, round(spent / (perf_counter() - cells_began)))
                still = pace.left(waiting.values())
                return f" (about {lasting(still / min(at_once, len(waiting)))} left)" if still > 0.0 else ""

            how: dict[str, Any] = {"scheduler": options.scheduler, "jobs": options.workers, "done": len(before)}
            run_to_end(tasks, "cells", on_end, progress, **how)
        seconds = perf_counter() - began
        missing = [cell for cell in plan.cells if cell.digest not in before]
        reasons = [(cell.cell, lost.get(cell.digest) or folder.failure(cell)) for cell in missing]
        failed = tuple((cell, reason) for cell, reason in reasons if reason)
    return SweepSummary(len(plan.cells), done, len(before), failed, ticks, seconds)


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
    ticks = sum(planned.run_ticks for planned in left)
    return Estimate(len(plan.cells), len(done), len(failed), ticks, pace_of(plan.cells, folder).left(left))
