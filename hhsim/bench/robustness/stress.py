"""`hhsim bench stress`: random targets against objects, every tick measured from the hand that it shows.

A run of any length takes the same memory: ticks are run, measured and dropped block by block.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.robustness.failure import Shrunk, failure_of, keep_failure, make_trial, recorded_penetration, shrink
from hhsim.bench.robustness.local_optimality import Pieces, pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.robustness.safety import BLOCK, SafetyFigures, SafetyMeasure
from hhsim.bench.table import columns_of, cpu_times, figure, totals_of
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import Penetration
from hhsim.motion.analytic_motion import replayed
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.options import SolverOptions
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.log_histogram import LogHistogram
from hhsim.system.output_path import free_name
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True)
class KeptFailure:
    """A failure that was shrunk and kept."""

    kind: str
    tick: int
    path: str
    ticks: int
    failing_tick: int
    depth: float
    command: str


@dataclass(frozen=True, kw_only=True)
class StressFigures(SafetyFigures):
    """Figures of a case."""

    level: int = figure("level of the sphere tree", total=max)
    spheres: int = figure("leaf spheres of the object", total=sum)
    seed: int = figure("seed of the random targets")
    penetration_palm: float = figure("deepest penetration of the palm", "m", max, 0.0)
    penetration_finger: float = figure("deepest penetration of a finger", "m", max, 0.0)
    penetrating_deep: int = figure("ticks deeper than 10 um", total=sum, default=0)
    held: int = figure("ticks whose input was no reading of a hand", total=sum, default=0)
    force_max: float = figure("largest total force", "N", default=0.0)
    coupling_force: float = figure("the coupling's own force at that tick", "N", default=np.nan)
    force_ratio: float = figure(
        "largest ratio of the total force to the coupling's own at the same tick", total=max, default=0.0
    )
    cpu: LogHistogram = cpu_times("a tick")  # noqa: RUF009
    failures: tuple[KeptFailure, ...] = ()


COLUMNS = (*columns_of(StressFigures), Column("safe", "kept what a safe method promises"))


def total(rows: Sequence[StressFigures]) -> StressFigures:
    """Return all cases of one solver as one: counts are added, the largest is kept, percentiles are over all ticks."""
    strongest = max(rows, key=lambda row: row.force_max)
    failures = tuple(failure for row in rows for failure in row.failures)
    return replace(strongest, object="all", failures=failures, **totals_of(StressFigures, rows))


DEEP = 1e-5
"""Second depth [m] over which ticks are counted; the first is `SAFE_DEPTH`."""
LEAST_FORCE = 1.0
"""Least force [N] that is compared with the coupling's own."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StressCase:
    """One object, one method, one long motion."""

    object: str  # its name or file
    object_options: str = ""  # options of the object that a replay needs, such as "--level 3 --unit mm"
    tree: SphereTree
    mesh: Mesh | None = None  # its triangles, in the frame of the tree; None for an object of spheres alone
    hand: HandModel
    solver: SolverOptions
    stress: StressOptions  # options of the random targets
    seed: int  # of the random targets
    ticks: int
    keep: Path | None = None  # folder for failing stretches, made when one is kept; None keeps none

    def targets(self) -> RandomTargets:
        """Return the motion from its start: around the object's root sphere, the first hand above it."""
        center, radius = self.tree.center[0], float(self.tree.radius[0])
        return RandomTargets(self.hand, self.seed, self.stress, center=center, height=max(0.25, radius + 0.2))

    @cached_property
    def surface(self) -> Any:
        """Arrays of the surface that the hand touches."""
        return contact_surface(self.solver.surface, self.mesh, self.tree).arrays

    @cached_property
    def pieces(self) -> Pieces:
        """Pieces of that surface, for the judge of stuck ticks."""
        return pieces_of(self.solver.surface, self.mesh, self.tree)

    def new_solver(self) -> HandSolver:
        """Return a solver at the start of the motion."""
        return HandSolver(self.hand, self.surface, self.solver)


def coupling_force(case: StressCase, haptic: HandConfiguration, record: TickRecord) -> FloatArray:
    """Return the force of the coupling itself at each tick [N], shape (T,).

    It is the palm's force, its torque over the reach of the hand, and each joint's torque over the length of its
    phalanx. The forces of `coupled` stay near it. `progressive` holds a joint's torque where the finger touches, and on
    a lever shorter than the phalanx that takes more force.
    """
    bend = np.clip(haptic.flexion, case.hand.flexion_min, case.hand.flexion_max) - record.flexion
    joint = case.solver.stiffness.flexion * np.abs(bend) / case.hand.length
    reach = float(case.hand.arrays().reach.max())
    force, torque = (np.linalg.norm(part, axis=1) for part in (record.palm_wrench[:, :3], record.palm_wrench[:, 3:]))
    return np.asarray(force + torque / reach + joint.sum(axis=(1, 2)), np.float64)


class StressMeasure:
    """Figures of a case, block by block."""

    def __init__(self, case: StressCase) -> None:
        self._case, solver, tree = case, case.solver, case.tree
        self._safety = SafetyMeasure(case.hand, case.pieces, solver)
        self.figures = StressFigures(
            object=case.object,
            method=solver.method,
            surface=solver.surface,
            level=tree.depth,
            spheres=tree.leaf_count,
            seed=case.seed,
        )

    def add(self, motion: HandConfiguration, record: TickRecord, depth: Penetration) -> dict[str, BoolArray]:
        """Measure a block; return its failed ticks, shape (T,), by the name of the failure."""
        haptic, before = self._safety.readings(motion), self.figures
        failed = self._safety.add(haptic, record, depth.depth)
        before.cpu.add(record.duration_cpu)
        size, own = np.linalg.norm(record.total, axis=1), coupling_force(self._case, haptic, record)
        top = int(np.argmax(np.where(np.isfinite(size), size, -1.0)))
        strongest = before.force_max, before.coupling_force
        if size[top] > before.force_max or (size[top] == 0.0 and np.isnan(before.coupling_force)):
            strongest = float(size[top]), float(own[top])
        pushed = size >= LEAST_FORCE
        # A method that is not held back by its coupling can push where the coupling's own force is zero.
        with np.errstate(divide="ignore"):
            ratio = float((size[pushed] / own[pushed]).max(initial=0.0))
        self.figures = replace(
            before,
            **self._safety.totals,
            # np.maximum, unlike max, keeps a NaN whichever side it is on.
            penetration_palm=float(np.maximum(before.penetration_palm, depth.palm.max())),
            penetration_finger=float(np.maximum(before.penetration_finger, depth.finger.max())),
            penetrating_deep=before.penetrating_deep + int((~(depth.depth <= DEEP)).sum()),
            held=before.held + int(((record.status & STATUS_INPUT_INVALID) > 0).sum()),
            force_max=strongest[0],
            coupling_force=strongest[1],
            force_ratio=max(before.force_ratio, ratio),
        )
        return failed


STRETCH_BLOCKS = 4
"""Blocks up to a failure that are kept to shrink it from."""


def run_case(case: StressCase, check: Callable[[], None] = lambda: None) -> StressFigures:
    """Run one case, with a check between its blocks; HhsimError for too many near pairs, or a failure not written."""
    warm_up(case.hand, case.solver)
    measure = StressMeasure(case)
    solver = case.new_solver()
    stretch: deque[tuple[HandConfiguration, HandConfiguration]] = deque(maxlen=STRETCH_BLOCKS)
    kept: dict[str, KeptFailure] = {}
    targets = case.targets()
    for first in range(0, case.ticks, BLOCK):
        motion = targets.take(min(BLOCK, case.ticks - first))
        record = solver.run(*motion)
        depth = recorded_penetration(case.hand, solver.workspace.surface, record)
        stretch.append((motion, HandConfiguration.of(record).copy()))
        failing = measure.add(motion, record, depth)
        for kind, ticks in failing.items():
            if case.keep is not None and kind not in kept and ticks.any():
                tick = int(np.argmax(ticks))
                kept[kind] = _keep(case, case.keep, kind, first + tick, tick, list(stretch))
        check()
    return replace(measure.figures, failures=tuple(kept.values()))


def run_stress(cases: Sequence[StressCase], *, jobs: int = 1, progress: Progress = silent) -> Iterator[StressFigures]:
    """Run cases, `jobs` of them at a time in own processes; yield their figures in order. HhsimError as `run_case`."""
    with interruptible_between() as check:
        for done, figures in enumerate(_run_all(cases, jobs, check)):
            progress("cases", done + 1, len(cases))
            yield figures


def _run_all(cases: Sequence[StressCase], jobs: int, check: Callable[[], None]) -> Iterator[StressFigures]:
    if jobs <= 1 or len(cases) <= 1:
        for case in cases:
            yield run_case(case, check)
        return
    # Spawned, not forked: a fork of a process with threads copies locks that nobody will release.
    pool = ProcessPoolExecutor(min(jobs, len(cases)), mp_context=get_context("spawn"))
    try:
        for future in [pool.submit(run_case, case) for case in cases]:
            yield future.result()
            check()
    finally:
        pool.shutdown(cancel_futures=True)


def _keep(
    case: StressCase,
    folder: Path,
    kind: str,
    tick: int,
    tick_in_block: int,
    stretch: list[tuple[HandConfiguration, HandConfiguration]],
) -> KeptFailure:
    motion, graphic = (sequence(*pieces) for pieces in zip(*stretch))
    end = motion.ticks - (stretch[-1][0].ticks - tick_in_block - 1)
    trial = make_trial(case.hand, case.new_solver, failure_of(kind, case.hand, case.pieces, case.solver))
    shrunk = shrink(motion.part(0, end), graphic.part(0, end), trial)
    if shrunk is None:
        # The solver's memory of what came before the stretch decides: keep the whole way there.
        whole = replayed(case.targets().take(tick + 1))
        shrunk = Shrunk(whole, trial(whole))
    last = shrunk.tick
    record = case.new_solver().run(*shrunk.motion)
    depth = float(recorded_penetration(case.hand, case.surface, record).depth[last])
    folder.mkdir(parents=True, exist_ok=True)
    stem = Path(case.object).stem
    touched = "" if case.solver.surface == "spheres" else f"-{case.solver.surface}"
    name = f"{stem}-{case.solver.method}{touched}-{kind.replace(' ', '-')}-seed{case.seed}-tick{tick}.h5"
    path = free_name(folder / name)
    command = keep_failure(
        path,
        shrunk,
        case.object,
        case.object_options,
        case.solver,
        kind=kind,
        seed=case.seed,
        tick=tick,
        failing_tick=last,
        depth=depth,
        stress=asdict(case.stress),
        hand=case.hand.side,
    )
    return KeptFailure(kind, tick, str(path), shrunk.motion.ticks, last, depth, command)
