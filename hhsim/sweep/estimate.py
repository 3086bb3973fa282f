"""How long a sweep is going to take, from cells that were run on this machine: those in its folder, or some tried."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from hhsim.sweep.cell import source_digest
from hhsim.sweep.cell_run import CellEnd, CellTask, run_cell
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.pace import kind, pace_of
from hhsim.sweep.plan import PlannedCell, SweepPlan
from hhsim.sweep.process_engine import run_in_processes
from hhsim.sweep.sweep import prepare
from hhsim.system.progress import Progress, silent

TRIALS = 12
"""Cells that are tried, about; at least one of each method, surface and options of which none is done."""
PATIENCE = 60.0
"""So long are more cells of a kind tried of which one was [s]."""
WHOLE = 15.0
"""A cell that seems to take less is tried as it is [s], any other one by some ticks from all of its motion."""
FEW, SOME = 5, 50
"""Ticks of a run for what a cell takes without its ticks, and of one that goes through its motion in large steps."""
MANY, ROUNDS = 500, 3
"""Ticks of a cell, and how often each process runs it, for what cells take that run beside each other."""
LEAST_RATE = 10.0
"""Of that [Hz]: of a motion of more than 5 s it is the beginning."""


@dataclass(frozen=True)
class Estimate:
    """What a sweep comes to.

    Attributes:
        cells: All of the plan.
        done: Finished before.
        failed: Failed before.
        ticks: Of the cells that are still to run, in all their runs.
        seconds: That these take one after the other, scenes opened and results written; NaN where nothing could be
            tried.
        start_up: That a process takes besides: until its code is imported and its kernels are loaded [s].
        beside: How many times as long a cell takes where as many run at once as are going to.
        by: What that is estimated from.
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
        """What a user waits for [s]: kernels and trees first, then processes that start, then their cells.

        At least, as if no cell hindered another, and as the trials hindered each other.
        """
        left = self.cells - self.done - self.failed
        start, cells = 2.0 * self.start_up, self.seconds / max(1, min(workers, left))
        return (start + cells, start + cells * self.beside) if left else (0.0, 0.0)


def estimate(plan: SweepPlan, folder: SweepFolder, workers: int = 1, progress: Progress = silent) -> Estimate:
    """Count the cells, and estimate what those that are left take: each as the cells most like it that were run.

    Args:
        plan: What is to be run.
        folder: Where; it need not exist.
        workers: Processes, each of which opens a scene for all its cells of that.
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
    """Some cells of each kind, spread over its list: objects and motions differ in what a tick takes."""
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
    """What the cells of a scene have in common, but for options that need another tree."""
    return planned.cell.object.name, planned.cell.motion.name, planned.cell.surface


def _task(planned: PlannedCell, plan_folder: Path, scratch: str, **changes: Any) -> CellTask:
    cell = replace(planned.cell, repeat=1, **changes)
    where = (str(plan_folder.resolve()), scratch)
    return CellTask(cell, planned.digest, *where, keeps_result=False, wants_core=False, sources=source_digest())


def _beside(planned: PlannedCell, plan_folder: Path, workers: int) -> tuple[float, float]:
    """What new processes take to start [s], and how many times as long as here a cell takes in them side by side."""
    with tempfile.TemporaryDirectory() as scratch:
        task = _task(planned, plan_folder, scratch, ticks=min(planned.ticks, MANY))
        alone = min(run_cell(task).seconds for _ in range(ROUNDS))
        began = perf_counter()
        ends = list(run_in_processes([replace(task, wants_core=True)] * (ROUNDS * workers), workers))
        took = perf_counter() - began
    each = sum(end.seconds for end in ends[workers:]) / max(1, len(ends[workers:]))
    return max(0.0, took - ROUNDS * each), max(1.0, each / alone if alone and workers > 1 else 1.0)


def _tried(planned: PlannedCell, plan_folder: Path, opens: float) -> tuple[CellEnd, bool]:
    """What all runs of a cell take, measured or, where it is long, estimated; and whether it was measured.

    `opens` is the share of the cells that open their scene, which those after them in the same process need not.

    The beginning of a motion says nothing of the rest: there the hand touches nothing yet, and ticks are cheap.
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
        # Of so few ticks, what else the machine does in between would be taken for a thousand times as much.
        some = undisturbed(SOME, every)
        each = max(0.0, some.seconds - bare.seconds) / max(1, some.ticks - bare.ticks)
        seconds = bare.seconds + each * planned.ticks
        whole = every == 1.0 or seconds < WHOLE or bool(bare.reason or some.reason)
        end = run(planned.ticks) if whole else replace(some, seconds=seconds)
    seconds = opening + planned.cell.repeat * end.seconds
    return replace(end, ticks=planned.run_ticks, seconds=seconds), whole
