"""Estimate of a sweep's duration from cells that ran on this machine: those in its folder, or trials."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from hhsim.sweep.cell import source_digest
from hhsim.sweep.cell_run import CellEnd, CellTask, run_cell
from hhsim.sweep.engines import run_in_processes
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.pace import kind, pace_of
from hhsim.sweep.plan import PlannedCell, SweepPlan
from hhsim.sweep.sweep import prepare
from hhsim.system.progress import Progress, silent

TRIALS = 12
"""Number of trial cells, at least one of each method, surface and options of which none is done."""
PATIENCE = 60.0
"""Time after which only kinds of cells without a trial are tried [s]."""
WHOLE = 15.0
"""Estimated duration below which a trial runs the whole cell [s]; else some ticks from all of its motion."""
FEW, SOME = 5, 50
"""Ticks of a run for the time besides ticks, and of one that samples the motion in large steps."""
MANY, ROUNDS = 500, 3
"""Ticks and repetitions of a cell for the slowdown of cells side by side."""
LEAST_RATE = 10.0
"""Lowest rate of the sampled motion [Hz]; of a motion of more than 5 s only the beginning is tried."""


@dataclass(frozen=True)
class Estimate:
    """Size and duration of a sweep.

    Attributes:
        cells, done, failed: Numbers of cells of the plan, and of those that finished or failed before.
        ticks: Ticks of the cells that are left, in all their runs.
        seconds: Duration of these one after the other, with scenes and files; NaN if none could be tried.
        start_up: Time until a process has loaded code and kernels [s].
        beside: Slowdown of cells that run side by side.
        by: Basis of the estimate.
    """

    cells: int
    done: int
    failed: int
    ticks: int
    seconds: float
    start_up: float
    by: str
    beside: float = 1.0

    def elapsed(self, workers: int) -> tuple[float, float]:
        """Return the least and the likely duration [s]: kernels and trees, start of processes, their cells."""
        left = self.cells - self.done - self.failed
        start, cells = 2.0 * self.start_up, self.seconds / max(1, min(workers, left))
        return (start + cells, start + cells * self.beside) if left else (0.0, 0.0)


def estimate(plan: SweepPlan, folder: SweepFolder, workers: int = 1, progress: Progress = silent) -> Estimate:
    """Count the cells, and estimate the duration of those left from the most similar ones that were run.

    Args:
        folder: Folder of the sweep; it need not exist.
        workers: Processes, each of which opens a scene once for all its cells.
    """
    done = [planned for planned in plan.cells if folder.done(planned)]
    finished = {planned.digest for planned in done}
    failed = [planned for planned in plan.cells if planned.digest not in finished and folder.failure(planned)]
    failing = {planned.digest for planned in failed}
    left = [planned for planned in plan.cells if planned.digest not in finished | failing]
    pace = pace_of(plan.cells, folder)
    before, began = pace.cells, perf_counter()
    trials = _trials([planned for planned in left if not pace.knows(planned.cell)])
    prepare(plan, trials, progress)
    in_parts, start_up, beside = 0, 0.0, 1.0
    sharing = Counter(_scene_of(planned) for planned in left)
    for number, planned in enumerate(trials):
        progress("trial cells", number, len(trials))
        if perf_counter() - began > PATIENCE and pace.knows(planned.cell):
            continue
        end, is_whole = _tried(planned, plan.folder, min(1.0, workers / sharing[_scene_of(planned)]))
        if not end.reason:
            pace.add(planned.cell, end.ticks, end.seconds)
            in_parts += not is_whole
    if left:
        progress("starting processes", len(trials), len(trials))
        start_up, beside = _beside(left[0], plan.folder, max(1, min(workers, len(left))))
    whole = pace.cells - before - in_parts
    counts = {"done": before, "tried whole": whole, f"tried by {SOME} ticks in large steps": in_parts}
    by = ", ".join(f"{count:,} {how}" for how, count in counts.items() if count) or "none could be tried"
    ticks = sum(planned.run_ticks for planned in left)
    return Estimate(len(plan.cells), len(done), len(failed), ticks, pace.left(left), start_up, by, beside)


def _trials(cells: Sequence[PlannedCell]) -> list[PlannedCell]:
    """Return some cells of each kind, spread over its list: ticks differ between objects and motions."""
    kinds: dict[tuple[str, ...], list[PlannedCell]] = {}
    for planned in cells:
        kinds.setdefault(kind(planned.cell), []).append(planned)
    each = max(1, TRIALS // max(1, len(kinds)))
    found = []
    for i in range(each):
        for number, mine in enumerate(kinds.values()):
            count = min(len(mine), each)
            if i < count:
                # Each kind begins elsewhere, so that between them they have more objects and motions.
                found.append(mine[int((i + (number + 0.5) / len(kinds)) * len(mine) / count)])
    return found


def _scene_of(planned: PlannedCell) -> tuple[str, str, str]:
    """Return the names that cells of one scene share, but for options that need another tree."""
    return planned.cell.object.name, planned.cell.motion.name, planned.cell.surface


def _task(planned: PlannedCell, plan_folder: Path, scratch: str, **changes: Any) -> CellTask:
    cell = replace(planned.cell, repeat=1, **changes)
    where = (str(plan_folder.resolve()), scratch)
    return CellTask(cell, planned.digest, *where, keeps_result=False, wants_core=False, sources=source_digest())


def _beside(planned: PlannedCell, plan_folder: Path, workers: int) -> tuple[float, float]:
    """Return the start-up time of new processes [s], and the slowdown of cells in them."""
    with tempfile.TemporaryDirectory() as scratch:
        task = _task(planned, plan_folder, scratch, ticks=min(planned.ticks, MANY))
        alone = min(run_cell(task).seconds for _ in range(ROUNDS))
        began = perf_counter()
        ends = list(run_in_processes([replace(task, wants_core=True)] * (ROUNDS * workers), workers))
        took = perf_counter() - began
    each = sum(end.seconds for end in ends[workers:]) / max(1, len(ends[workers:]))
    return max(0.0, took - ROUNDS * each), max(1.0, each / alone if alone and workers > 1 else 1.0)


def _tried(planned: PlannedCell, plan_folder: Path, opens: float) -> tuple[CellEnd, bool]:
    """Return the measured or extrapolated end of all runs of a cell, and True if it was measured.

    `opens` is the share of the cells that open their scene. Ticks are sampled from the whole motion, because its
    beginning has no contacts, and its ticks are fast.
    """
    rate = float(planned.cell.options.get("rate", 1000.0))
    every = max(1.0, min(planned.ticks / SOME, rate / LEAST_RATE))
    with tempfile.TemporaryDirectory() as scratch:

        def run(ticks: int, every: float = 1.0) -> CellEnd:
            options = {**planned.cell.options, **({"rate": rate / every} if every > 1.0 else {})}
            return run_cell(_task(planned, plan_folder, scratch, ticks=min(planned.ticks, ticks), options=options))

        def undisturbed(ticks: int, every: float = 1.0) -> CellEnd:
            return min(run(ticks, every), run(ticks, every), key=lambda end: end.seconds)

        first, bare = run(FEW), undisturbed(FEW)
        opening = opens * max(0.0, first.seconds - bare.seconds)
        # The lesser of two runs: a disturbance of so few ticks would be extrapolated.
        some = undisturbed(SOME, every)
        each = max(0.0, some.seconds - bare.seconds) / max(1, some.ticks - bare.ticks)
        seconds = bare.seconds + each * planned.ticks
        whole = every == 1.0 or seconds < WHOLE or bool(bare.reason or some.reason)
        end = run(planned.ticks) if whole else replace(some, seconds=seconds)
    seconds = opening + planned.cell.repeat * end.seconds
    return replace(end, ticks=planned.run_ticks, seconds=seconds), whole
