"""Estimate of a sweep's duration from cells that ran on this machine: those in its folder, or trials."""

import tempfile
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

from hhsim.sweep.cell_run import CellTask, run_cell
from hhsim.sweep.engines import TaskEnd
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.pace import kind, pace_of
from hhsim.sweep.plan import PlannedCell, SweepPlan, source_digest
from hhsim.sweep.sweep import prepare
from hhsim.system.progress import Progress, silent

TRIALS = 12
"""Number of trial cells, at least one of each method, surface and options of which none is done."""
FEW, SOME = 5, 50
"""Ticks of a run for the time besides ticks, and of one that samples the motion in large steps."""
LEAST_RATE = 10.0
"""Lowest rate of the sampled motion [Hz]; of a motion of more than 5 s only the beginning is tried."""


@dataclass(frozen=True)
class Estimate:
    """Size and duration of a sweep."""

    cells: int  # number of cells of the plan
    done: int  # number of those that finished before
    failed: int  # number of those that failed before
    ticks: int  # ticks of the cells that are left, in all their runs
    seconds: float  # duration of these one after the other, with scenes and files; NaN if none could be tried
    by: str  # basis of the estimate

    @property
    def left(self) -> int:
        """Number of cells to run."""
        return self.cells - self.done - self.failed

    def elapsed(self, workers: int) -> float:
        """Return the duration [s] in so many processes, as if none slowed another."""
        return self.seconds / max(1, min(workers, self.left))


def estimate(plan: SweepPlan, folder: SweepFolder, progress: Progress = silent) -> Estimate:
    """Count the cells, and estimate the time of those left by the most similar that ran; the folder need not exist."""
    done = {planned.digest for planned in plan.cells if folder.done(planned)}
    failed = {planned.digest for planned in plan.cells if planned.digest not in done and folder.failure(planned)}
    left = [planned for planned in plan.cells if planned.digest not in done | failed]
    pace = pace_of(plan.cells, folder)
    before = pace.cells
    trials = _trials([planned for planned in left if not pace.knows(planned.cell)])
    prepare(plan, trials, progress)
    sharing = Counter(_scene_of(planned) for planned in left)
    for number, planned in enumerate(trials):
        progress("trial cells", number, len(trials))
        end = _tried(planned, plan.folder, sharing[_scene_of(planned)])
        if not end.reason:
            pace.add(planned.cell, end.ticks, end.seconds)
    counts = {"done": before, "tried": pace.cells - before}
    by = ", ".join(f"{count:,} {how}" for how, count in counts.items() if count) or "none could be tried"
    ticks = sum(planned.run_ticks for planned in left)
    return Estimate(len(plan.cells), len(done), len(failed), ticks, pace.left(left), by)


def _trials(cells: list[PlannedCell]) -> list[PlannedCell]:
    """Return some cells of each kind, spread over its list: ticks differ between objects and motions."""
    kinds: dict[tuple[str, ...], list[PlannedCell]] = defaultdict(list)
    for planned in cells:
        kinds[kind(planned.cell)].append(planned)
    each = max(1, TRIALS // max(1, len(kinds)))
    return [planned for mine in kinds.values() for planned in mine[:: -(-len(mine) // each)]]


def _scene_of(planned: PlannedCell) -> tuple[str, str, str]:
    """Return the names that cells of one scene share, but for options that need another tree."""
    return planned.cell.object.name, planned.cell.motion.name, planned.cell.surface


def _tried(planned: PlannedCell, plan_folder: Path, sharing: int) -> TaskEnd:
    """Return the extrapolated end of all runs of a cell; so many cells share its scene, which one of them opens.

    Ticks are sampled from the whole motion, because its beginning has no contacts, and its ticks are fast.
    """
    cell = planned.cell
    rate = float(cell.options.get("rate", 1000.0))
    large = max(1.0, min(planned.ticks / SOME, rate / LEAST_RATE))
    with tempfile.TemporaryDirectory() as scratch:

        def run(ticks: int, step: float = 1.0) -> TaskEnd:
            options = {**cell.options, "rate": rate / step}
            tried = replace(cell, repeat=1, ticks=min(planned.ticks, ticks), options=options)
            where = str(plan_folder.resolve()), scratch
            return run_cell(CellTask(tried, planned.digest, *where, False, False, source_digest()))

        first = run(FEW)
        # The lesser of two runs: a disturbance of so few ticks would be extrapolated.
        bare, some = (
            min((run(ticks, step) for _ in range(2)), key=lambda end: end.seconds)
            for ticks, step in ((FEW, 1.0), (SOME, large))
        )
    opening = max(0.0, first.seconds - bare.seconds) / sharing
    each = max(0.0, some.seconds - bare.seconds) / max(1, some.ticks - bare.ticks)
    seconds = opening + cell.repeat * (bare.seconds + each * planned.ticks)
    return replace(some, ticks=planned.run_ticks, seconds=seconds)
