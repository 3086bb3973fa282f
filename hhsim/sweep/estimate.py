"""How long a sweep is going to take, from cells that were run: those in its folder, or a few that are tried."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from hhsim.errors import HhsimError
from hhsim.replay.replay import replay
from hhsim.sweep.cell_run import open_cell
from hhsim.sweep.folder import SweepFolder
from hhsim.sweep.plan import PlannedCell, SweepPlan
from hhsim.system.progress import Progress, silent

TRIAL_TICKS = 1000
"""Of a cell that is tried, at most."""
TRIALS = 3
"""Cells of each method and surface that are tried."""


@dataclass(frozen=True)
class Estimate:
    """What a sweep comes to.

    Attributes:
        cells: All of the plan.
        done: Finished before.
        failed: Failed before.
        ticks: Of the cells that are still to run.
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
    """Count the cells, and estimate what those that are left take: by method and surface, in proportion to the ticks.

    Args:
        plan: What is to be run.
        folder: Where; it need not exist.
    """
    done = [planned for planned in plan.cells if folder.done(planned)]
    finished = {planned.digest for planned in done}
    failed = [planned for planned in plan.cells if planned.digest not in finished and folder.failure(planned)]
    failing = {planned.digest for planned in failed}
    left = [planned for planned in plan.cells if planned.digest not in finished | failing]
    kinds = {_kind(planned) for planned in left}
    known = {kind: [planned for planned in done if _kind(planned) == kind] for kind in kinds}
    seconds, tried = 0.0, 0
    for number, kind in enumerate(sorted(kinds)):
        progress("trial cells", number, len(kinds))
        mine = [planned for planned in left if _kind(planned) == kind]
        if known[kind]:
            spent = sum(float(folder.row(planned)["seconds"]) for planned in known[kind])
            ticks = sum(planned.ticks for planned in known[kind])
        else:
            spent, ticks = _trial(plan, mine)
            tried += min(TRIALS, len(mine))
        seconds += sum(planned.ticks for planned in mine) * spent / ticks if ticks else float("nan")
    by = f"{tried} trial cells" if tried else "the cells that are done"
    return Estimate(len(plan.cells), len(done), len(failed), sum(planned.ticks for planned in left), seconds, by)


def _kind(planned: PlannedCell) -> tuple[str, str]:
    return planned.cell.method, planned.cell.surface


def _trial(plan: SweepPlan, cells: Sequence[PlannedCell]) -> tuple[float, int]:
    """What a few of some cells take [s], or their beginnings, and how many ticks that is."""
    # Spread over the list: objects and motions differ in what it takes to put them together.
    chosen = [cells[(2 * i + 1) * len(cells) // (2 * TRIALS)] for i in range(min(TRIALS, len(cells)))]
    seconds, ticks = 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        # The first is for what is compiled, loaded and built but once.
        for number, planned in enumerate([cells[0], *chosen]):
            cell = replace(planned.cell, ticks=min(planned.ticks, TRIAL_TICKS))
            began = perf_counter()
            try:
                summary = replay(open_cell(cell, plan.folder), cell.solver_options(), Path(folder) / "trial.h5")
            except HhsimError:
                continue
            if number > 0:
                seconds += perf_counter() - began
                ticks += summary.ticks
    return seconds, ticks
