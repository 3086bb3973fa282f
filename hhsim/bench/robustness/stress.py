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
from hhsim.bench.robustness.failure import (
    SAFE_DEPTH,
    Provenance,
    Shrunk,
    delta_debug,
    failure_of,
    keep_failure,
    make_trial,
    not_finite,
    recorded_penetration,
)
from hhsim.bench.robustness.local_optimality import way_out
from hhsim.bench.robustness.pieces import Pieces, hand_distance, pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.run_errors import hand_clearance, placed_of
from hhsim.bench.table import columns_of, cpu_times, figure, metric, totals_of
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_LAG, STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import Penetration
from hhsim.motion.tick_motion import hold_readings, replayed
from hhsim.solver.compile import warm_up
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import never_penetrates
from hhsim.solver.options import SolverOptions
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.log_histogram import CpuTimes, LogHistogram
from hhsim.system.output_path import free_name
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True)
class KeptFailure:
    """A failure that was shrunk and kept.

    `reproduced` is False if no fresh solver fails on any end of the motion: then the file holds all of it.
    """

    kind: str
    tick: int
    path: str
    ticks: int
    failing_tick: int
    depth: float
    reproduced: bool
    command: str


@dataclass
class StressFigures(CpuTimes):
    """Figures of a case.

    `unexplained` are the stuck ticks with a free step (`hhsim.bench.robustness.local_optimality`), of those looked at.
    """

    object: str = figure("object")
    method: str = figure("method")
    surface: str = figure("what of the object the hand touches")
    level: int = figure("level of the sphere tree", total=max)
    spheres: int = figure("leaf spheres of the object", total=sum)
    seed: int = figure("seed of the random targets")
    ticks: int = figure("ticks run", total=sum, default=0)
    penetration: float = figure("deepest penetration", "m", max, default=0.0)
    penetration_palm: float = figure("deepest penetration of the palm", "m", max, default=0.0)
    penetration_finger: float = figure("deepest penetration of a finger", "m", max, default=0.0)
    penetrating: int = figure("ticks deeper than 1 um", total=sum, default=0)
    penetrating_deep: int = figure("ticks deeper than 10 um", total=sum, default=0)
    not_finite: int = figure("ticks whose hand or force is not finite", total=sum, default=0)
    stuck: int = figure("ticks that kept the last feasible hand", total=sum, default=0)
    unexplained: int = figure("stuck ticks that had a way out", total=sum, default=0)
    longest_stuck: int = figure("longest run of stuck ticks", total=max, default=0)
    lag: int = figure("ticks whose budget ended on the way", total=sum, default=0)
    held: int = figure("ticks whose input was no reading of a hand", total=sum, default=0)
    touching: int = figure("ticks in touch with the object", total=sum, default=0)
    candidates_max: int = metric(max, default=0)
    force_max: float = figure("largest total force", "N", default=0.0)
    coupling_force: float = figure("the coupling's own force at that tick", "N", default=np.nan)
    force_ratio: float = figure(
        "largest ratio of the total force to the coupling's own at the same tick", total=max, default=0.0
    )
    cpu: LogHistogram = cpu_times("a tick")  # noqa: RUF009
    brute_ticks: int = figure("ticks recomputed by brute force", total=sum, default=0)
    brute_difference: float = figure("largest disagreement with brute force", "m", max, 0.0)
    failures: tuple[KeptFailure, ...] = ()

    @property
    def safe(self) -> bool:
        """True if the hand is shallow and finite, no stuck tick had a free step, and brute force agrees."""
        shallow = self.penetration <= SAFE_DEPTH and self.brute_difference <= SAFE_DEPTH
        return shallow and self.not_finite == 0 and self.unexplained == 0

    @property
    def missed(self) -> bool:
        """True if the method promises safety and is not safe."""
        return never_penetrates(self.method) and not self.safe


COLUMNS = (*columns_of(StressFigures), Column("safe", "kept what a safe method promises"))


def total(rows: Sequence[StressFigures]) -> StressFigures:
    """Return all cases of one solver as one: counts are added, the largest is kept, percentiles are over all ticks."""
    strongest = max(rows, key=lambda row: row.force_max)
    failures = tuple(failure for row in rows for failure in row.failures)
    return replace(strongest, object="all", failures=failures, **totals_of(StressFigures, rows))


DEEP = 1e-5
"""Second depth [m] over which ticks are counted; the first is `SAFE_DEPTH`."""
BRUTE_EVERY = 997
"""Ticks from one brute-force depth to the next; a prime, so that it meets every place in a hold."""
MOST_STUCK_CHECKED = 200
"""Stuck ticks of a case that are examined for a free step."""
LEAST_FORCE = 1.0
"""Least force [N] that is compared with the coupling's own."""
FAR = 0.05
"""Least clearance [m] that is not compared with brute force."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StressCase:
    """One object, one method, one long motion.

    Attributes:
        object: Its name or file.
        object_options: Options of the object that a replay needs, such as "--level 3 --unit mm".
        mesh: Its triangles, in the frame of the tree; None for an object of spheres alone.
        stress: Options of the random targets.
        seed: Of the random targets.
        keep: Folder for failing stretches, made when one is kept; None keeps none.
    """

    object: str
    object_options: str = ""
    tree: SphereTree
    mesh: Mesh | None = None
    hand: HandModel
    solver: SolverOptions
    stress: StressOptions
    seed: int
    ticks: int
    keep: Path | None = None

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
        """Pieces of that surface, for brute force."""
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
    whole: FloatArray = force + torque / reach + joint.sum(axis=(1, 2))
    return whole


class StressMeasure:
    """Figures of a case, block by block."""

    def __init__(self, case: StressCase) -> None:
        self._case = case
        self._stuck_run = 0
        self._before: HandConfiguration | None = None
        solver, tree = case.solver, case.tree
        self.figures = StressFigures(case.object, solver.method, solver.surface, tree.depth, tree.leaf_count, case.seed)

    def add(self, motion: HandConfiguration, record: TickRecord, depth: Penetration) -> dict[str, BoolArray]:
        """Measure a block; return its failed ticks, shape (T,), by the name of the failure."""
        made = self.figures
        self._brute(record)
        made.ticks += motion.ticks
        # np.maximum, unlike max, keeps a NaN whichever side it is on.
        made.penetration = float(np.maximum(made.penetration, depth.depth.max()))
        made.penetration_palm = float(np.maximum(made.penetration_palm, depth.palm.max()))
        made.penetration_finger = float(np.maximum(made.penetration_finger, depth.finger.max()))
        penetrating, lost = ~(depth.depth <= SAFE_DEPTH), not_finite(record)
        made.penetrating += int(penetrating.sum())
        made.penetrating_deep += int((~(depth.depth <= DEEP)).sum())
        made.not_finite += int(lost.sum())
        made.lag += int(((record.status & STATUS_LAG) > 0).sum())
        made.held += int(((record.status & STATUS_INPUT_INVALID) > 0).sum())
        made.touching += int((record.work[:, WORK_TOUCHING] > 0).sum())
        made.candidates_max = max(made.candidates_max, int(record.work[:, WORK_CANDIDATES].max()))
        made.cpu.add(record.duration_cpu)
        haptic = self._readings(motion)
        size = np.linalg.norm(record.total, axis=1)
        top = int(np.argmax(np.where(np.isfinite(size), size, -1.0)))
        own = coupling_force(self._case, haptic, record)
        if size[top] > made.force_max or (size[top] == 0.0 and np.isnan(made.coupling_force)):
            made.force_max, made.coupling_force = float(size[top]), float(own[top])
        pushed = size >= LEAST_FORCE
        if pushed.any():
            # A method that is not held back by its coupling can push where the coupling's own force is zero.
            with np.errstate(divide="ignore"):
                made.force_ratio = max(made.force_ratio, float((size[pushed] / own[pushed]).max()))
        return {"penetration": penetrating, "not finite": lost, "stuck": self._explain(haptic, record)}

    def _brute(self, record: TickRecord) -> None:
        case, shape = self._case, hand_shape(self._case.hand)
        for tick in range(-self.figures.ticks % BRUTE_EVERY, len(record.status), BRUTE_EVERY):
            shown = placed_of(record).at([tick])
            brute = hand_distance(case.pieces, shape, *(values[0] for values in shown))
            difference = abs(min(brute, FAR) - float(hand_clearance(case.hand, case.surface, shown, FAR)[0]))
            self.figures.brute_ticks += 1
            self.figures.brute_difference = max(self.figures.brute_difference, difference)

    def _readings(self, motion: HandConfiguration) -> HandConfiguration:
        """Readings as the solver holds them, across blocks too."""
        if self._before is None:
            held = hold_readings(motion)
        else:
            held = hold_readings(sequence(self._before, motion)).part(1, motion.ticks + 1)
        self._before = held.part(motion.ticks - 1, motion.ticks).copy()
        return held

    def _explain(self, haptic: HandConfiguration, record: TickRecord) -> BoolArray:
        stuck = (record.status & STATUS_STUCK) > 0
        unexplained = np.zeros(len(stuck), dtype=bool)
        case, made, shown = self._case, self.figures, HandConfiguration.of(record)
        for tick, is_stuck in enumerate(stuck):
            self._stuck_run = self._stuck_run + 1 if is_stuck else 0
            made.longest_stuck = max(made.longest_stuck, self._stuck_run)
            if is_stuck and made.stuck < MOST_STUCK_CHECKED:
                goal, here = haptic.part(tick, tick + 1), shown.part(tick, tick + 1)
                unexplained[tick] = way_out(case.hand, case.pieces, case.solver, here, goal) > 0.0
            made.stuck += int(is_stuck)
        made.unexplained += int(unexplained.sum())
        return unexplained


BLOCK = 2048
"""Ticks that are run and measured at a time."""
STRETCH_BLOCKS = 4
"""Blocks up to a failure that are kept to shrink it from."""


def run_case(case: StressCase, check: Callable[[], None] = lambda: None) -> StressFigures:
    """Run one case, with a check between its blocks.

    Raises:
        HhsimError: More pairs were near than the solver holds, or a failure could not be written.
    """
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
    """Run cases, `jobs` of them at a time in processes of their own; yield their figures in order.

    Raises:
        HhsimError: As `run_case`.
    """
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
    behind = stretch[-1][0].ticks - tick_in_block - 1
    motion, graphic = (sequence(*pieces) for pieces in zip(*stretch))
    end = motion.ticks - behind
    trial = make_trial(case.hand, case.new_solver, failure_of(kind, case.hand, case.pieces, case.solver))
    reproduced = True
    try:
        shrunk = delta_debug(motion.part(0, end), trial, graphic=graphic.part(0, end))
    except InputError:
        # The solver's memory of what came before the stretch decides: keep the whole way there.
        whole = replayed(case.targets().take(tick + 1))
        shrunk = Shrunk(whole, trial(whole), tick + 1, 1)
        reproduced = bool(shrunk.trace.failed.any())
    last = shrunk.tick if reproduced else shrunk.motion.ticks - 1
    solver = case.new_solver()
    record = solver.run(*shrunk.motion)
    depth = float(recorded_penetration(case.hand, solver.workspace.surface, record).depth[last])
    provenance = Provenance(
        kind=kind,
        object=case.object,
        object_options=case.object_options,
        method=case.solver.method,
        seed=case.seed,
        tick=tick,
        failing_tick=last,
        depth=depth,
        stress=asdict(case.stress),
        solver=case.solver.to_json(),
        hand=case.hand.side,
    )
    folder.mkdir(parents=True, exist_ok=True)
    stem = Path(case.object).stem
    touched = "" if case.solver.surface == "spheres" else f"-{case.solver.surface}"
    name = f"{stem}-{case.solver.method}{touched}-{kind.replace(' ', '-')}-seed{case.seed}-tick{tick}.h5"
    path = free_name(folder / name)
    command = keep_failure(path, shrunk, provenance)
    return KeptFailure(kind, tick, str(path), shrunk.motion.ticks, last, depth, reproduced, command)
