"""How long a sweep is going to take, from cells that were run on this machine: those in its folder, or some tried."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from hhsim.sweep.cell import source_digest
from hhsim.sweep.cell_run import CellEnd, CellTask, run_cell
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.pace import kind, pace_of
from hhsim.sweep.plan import PlannedCell, SweepPlan
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
        seconds: That these take one after the other; NaN where nothing could be tried.
        by: What that is estimated from.
    """

    cells: int
    done: int
    failed: int
    ticks: int
    seconds: float
    by: str


def estimate(plan: SweepPlan, folder: SweepFolder, progress: Progress = silent) -> Estimate:
    """Count the cells, and estimate what those that are left take: each as the cells most like it that were run.

    Args:
        plan: What is to be run.
        folder: Where; it need not exist.
    """
    done = [planned for planned in plan.cells if folder.done(planned)]
    finished = {planned.digest for planned in done}
    failed = [planned for planned in plan.cells if planned.digest not in finished and folder.failure(planned)]
    failing = {planned.digest for planned in failed}
    left = [planned for planned in plan.cells if planned.digest not in finished | failing]
    pace = pace_of(done, folder)
    before, began = pace.cells, perf_counter()
    trials = _trials([planned for planned in left if not pace.knows(planned.cell)])
    prepare(plan, trials, progress)
    in_parts = 0
    for number, planned in enumerate(trials):
        progress("trial cells", number, len(trials))
        if perf_counter() - began > PATIENCE and pace.knows(planned.cell):
            continue
        end, is_whole = _tried(planned, plan.folder)
        if not end.reason:
            pace.add(planned.cell, end.ticks, end.seconds)
            in_parts += not is_whole
    whole = pace.cells - before - in_parts
    counts = {"done": before, "tried whole": whole, f"tried by {SOME} ticks in large steps": in_parts}
    by = ", ".join(f"{count:,} {how}" for how, count in counts.items() if count) or "none could be tried"
    ticks = sum(planned.run_ticks for planned in left)
    return Estimate(len(plan.cells), len(done), len(failed), ticks, pace.left(left), by)


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


def _tried(planned: PlannedCell, plan_folder: Path) -> tuple[CellEnd, bool]:
    """What a run of a cell takes, measured or, where it is long, estimated; and whether it was measured.

    The beginning of a motion says nothing of the rest: there the hand touches nothing yet, and ticks are cheap.
    """
    rate = float(planned.cell.options.get("rate", 1000.0))
    every = max(1.0, min(planned.ticks / SOME, rate / LEAST_RATE))
    with tempfile.TemporaryDirectory() as scratch:

        def run(ticks: int, every: float = 1.0) -> CellEnd:
            options = {**planned.cell.options, **({"rate": rate / every} if every > 1.0 else {})}
            cell = replace(planned.cell, ticks=min(planned.ticks, ticks), options=options, repeat=1)
            where = (str(plan_folder.resolve()), scratch)
            return run_cell(
                CellTask(cell, planned.digest, *where, keeps_result=False, wants_core=False, sources=source_digest())
            )

        # The first run loads what is loaded but once.
        bare = [run(FEW), run(FEW)][-1]
        some = run(SOME, every)
        each = max(0.0, some.seconds - bare.seconds) / max(1, some.ticks - bare.ticks)
        seconds = bare.seconds + each * planned.ticks
        if every == 1.0 or seconds < WHOLE or bare.reason or some.reason:
            return run(planned.ticks), True
    return CellEnd(planned.digest, ticks=planned.ticks, seconds=seconds), False
