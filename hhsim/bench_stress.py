"""The suite `stress`: random targets against objects, as long as you like, every tick measured from what it shows.

Penetration is recomputed from the recorded hand, and on a share of the ticks once more by brute force over all leaves.
A run of any length takes the same memory: ticks are run, measured and forgotten block by block.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.bench_file import Column
from hhsim.brute_distance import brute_clearance
from hhsim.destination import free_name
from hhsim.errors import InputError
from hhsim.failure import (
    SAFE_DEPTH,
    Provenance,
    failure_of,
    keep_failure,
    make_trial,
    not_finite,
    recorded_motion,
    recorded_penetration,
)
from hhsim.hand import HandModel
from hhsim.hand_motion import HandMotion, joined
from hhsim.interrupt import interruptible_between
from hhsim.kernels.block import TickRecord
from hhsim.kernels.tick_state import STATUS_HELD, STATUS_LAG, STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.log_histogram import LogHistogram
from hhsim.metrics import Penetration, hand_clearance
from hhsim.shrink import Shrunk, shrink
from hhsim.solver import HandSolver
from hhsim.solver_options import SolverOptions
from hhsim.sphere_tree import SphereTree
from hhsim.stress import RandomTargets, StressOptions
from hhsim.stuck import way_out
from hhsim.warm_up import warm_up

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Progress = Callable[[str, int, int], None]
MakeSolver = Callable[["StressCase"], HandSolver]

SAFE_METHODS = ("coupled", "progressive")
"""Methods that promise never to penetrate: for these a failure is a missed limit."""
BLOCK = 2048
"""Ticks that are run and measured at a time."""
STRETCH_BLOCKS = 4
"""Blocks before a failure that are kept to shrink it from."""
DEEP = 1e-5
"""The second depth [m] that ticks are counted over; the first is `SAFE_DEPTH`."""
BRUTE_EVERY = 997
"""Every how many ticks the depth is recomputed by brute force; a prime, so that it meets every place in a hold."""
MOST_STUCK_CHECKED = 200
"""Stuck ticks of a case that are looked into for a way out."""
LEAST_FORCE = 1.0
"""Forces [N] from here on are compared with the coupling's own."""
FAR = 0.05
"""Clearances from here on [m] are not compared with brute force."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StressCase:
    """One object, one method, one long motion.

    Attributes:
        object: its name, or the file it is from.
        object_options: what a replay must be told of it, such as "--level 3 --unit mm".
        tree: Its sphere tree.
        hand: The hand.
        solver: Options of the solver, the method among them.
        stress: Options of the random targets.
        seed: Of the random targets.
        ticks: Length of the motion.
        keep: Folder for failing stretches, made when one is kept; None keeps none.
    """

    object: str
    object_options: str = ""
    tree: SphereTree
    hand: HandModel
    solver: SolverOptions
    stress: StressOptions
    seed: int
    ticks: int
    keep: Path | None = None

    def targets(self) -> RandomTargets:
        """The motion from its start: around the object's root sphere, the first hand above it."""
        center, radius = self.tree.center[0], float(self.tree.radius[0])
        return RandomTargets(self.hand, self.seed, self.stress, center=center, height=max(0.25, radius + 0.2))

    def new_solver(self) -> HandSolver:
        """A solver that has seen nothing yet."""
        return HandSolver(self.hand, self.tree.arrays(), self.solver)


@dataclass(frozen=True)
class KeptFailure:
    """A failure that was shrunk and kept.

    `reproduced` is False where no fresh solver fails on any end of the motion: then the file holds all of it.
    """

    kind: str
    tick: int
    path: str
    ticks: int
    failing_tick: int
    depth: float
    reproduced: bool
    command: str


@dataclass(frozen=True, kw_only=True)
class StressFigures:
    """What a case gave; lengths [m], forces [N], times [s], counts of ticks.

    `coupling_force` is the coupling's own at the tick of the largest force, palm and joints together, and `force_ratio`
    the largest ratio of the two at any tick. `unexplained` are the stuck ticks that had a way out (`hhsim.stuck`), of
    those looked into. `brute_ticks` were recomputed over all leaves; `brute_difference` is the largest disagreement
    with what the trees gave.
    """

    object: str
    method: str
    level: int
    spheres: int
    seed: int
    ticks: int
    penetration: float
    penetration_palm: float
    penetration_finger: float
    penetrating: int
    penetrating_deep: int
    not_finite: int
    stuck: int
    unexplained: int
    longest_stuck: int
    lag: int
    held: int
    touching: int
    candidates_max: int
    force_max: float
    coupling_force: float
    force_ratio: float
    brute_ticks: int
    brute_difference: float
    cpu: LogHistogram = field(repr=False, compare=False)
    failures: tuple[KeptFailure, ...] = ()

    @property
    def cpu_p50(self) -> float:
        """CPU time of a tick, median [s]."""
        return 1e-9 * self.cpu.percentile(50.0)

    @property
    def cpu_p99(self) -> float:
        """CPU time of a tick, 99th percentile [s]."""
        return 1e-9 * self.cpu.percentile(99.0)

    @property
    def cpu_max(self) -> float:
        """CPU time of a tick, largest [s]."""
        return 1e-9 * self.cpu.largest

    @property
    def safe(self) -> bool:
        """Whether the method kept what a safe one promises: no penetration, finite, not stuck where there is a way."""
        return (
            self.penetration <= SAFE_DEPTH
            and self.not_finite == 0
            and self.unexplained == 0
            and self.brute_difference <= SAFE_DEPTH
        )

    @property
    def missed(self) -> bool:
        """Whether a limit was missed: the method promises safety and is not safe."""
        return self.method in SAFE_METHODS and not self.safe


COLUMNS = (
    Column("object", "object"),
    Column("method", "method"),
    Column("level", "level of the sphere tree"),
    Column("spheres", "leaf spheres of the object"),
    Column("seed", "seed of the random targets"),
    Column("ticks", "ticks run"),
    Column("penetration", "deepest penetration", "m"),
    Column("penetration_palm", "deepest penetration of the palm", "m"),
    Column("penetration_finger", "deepest penetration of a finger", "m"),
    Column("penetrating", "ticks deeper than 1 um"),
    Column("penetrating_deep", "ticks deeper than 10 um"),
    Column("not_finite", "ticks whose hand or force is not finite"),
    Column("stuck", "ticks that kept the last feasible hand"),
    Column("unexplained", "stuck ticks that had a way out"),
    Column("longest_stuck", "longest run of stuck ticks"),
    Column("lag", "ticks whose budget ended on the way"),
    Column("held", "ticks whose input was no reading of a hand"),
    Column("touching", "ticks in touch with the object"),
    Column("candidates_max", "most pairs in the programs of a tick"),
    Column("force_max", "largest total force", "N"),
    Column("coupling_force", "the coupling's own force at that tick", "N"),
    Column("force_ratio", "largest ratio of the total force to the coupling's own at the same tick"),
    Column("cpu_p50", "CPU time of a tick, median", "s"),
    Column("cpu_p99", "CPU time of a tick, 99th percentile", "s"),
    Column("cpu_max", "CPU time of a tick, largest", "s"),
    Column("brute_ticks", "ticks recomputed by brute force"),
    Column("brute_difference", "largest disagreement with brute force", "m"),
    Column("safe", "kept what a safe method promises"),
)


_ADDED = (
    *("spheres", "ticks", "penetrating", "penetrating_deep", "not_finite", "stuck", "unexplained", "lag", "held"),
    *("touching", "brute_ticks"),
)
_LARGEST = (
    *("level", "penetration", "penetration_palm", "penetration_finger", "longest_stuck", "candidates_max"),
    *("force_ratio", "brute_difference"),
)


def total(rows: Sequence[StressFigures]) -> StressFigures:
    """All cases of one method as one: counts added up, largest of what has a largest, percentiles over all ticks."""
    strongest = max(rows, key=lambda row: row.force_max)
    return StressFigures(
        object="all",
        method=rows[0].method,
        seed=rows[0].seed,
        force_max=strongest.force_max,
        coupling_force=strongest.coupling_force,
        cpu=LogHistogram.sum(row.cpu for row in rows),
        failures=tuple(failure for row in rows for failure in row.failures),
        **{name: sum(getattr(row, name) for row in rows) for name in _ADDED},
        **{name: max(getattr(row, name) for row in rows) for name in _LARGEST},
    )


def table_row(figures: StressFigures) -> dict[str, Any]:
    """The figures as a row of `COLUMNS`."""
    return {column.name: getattr(figures, column.name) for column in COLUMNS}


def coupling_force(case: StressCase, haptic: HandMotion, record: TickRecord) -> Array:
    """What the coupling itself pulls with at each tick [N], shape (T,).

    The palm's force, its torque over the reach of the hand, and each joint's torque over the length of its phalanx.
    The forces of `coupled` stay near it. `progressive` holds a joint's torque where the finger touches, and on a lever
    that is shorter than the phalanx that takes more force.

    Args:
        case: For the hand and its stiffness.
        haptic: Readings of a hand at every tick.
        record: Of these ticks.
    """
    bend = np.clip(haptic.flexion, case.hand.flexion_min, case.hand.flexion_max) - record.flexion
    joint = case.solver.stiffness.flexion * np.abs(bend) / case.hand.length
    reach = float(case.hand.arrays().reach.max())
    force, torque = (np.linalg.norm(part, axis=1) for part in (record.palm_wrench[:, :3], record.palm_wrench[:, 3:]))
    whole: Array = force + torque / reach + joint.sum(axis=(1, 2))
    return whole


def run_case(
    case: StressCase, *, make_solver: MakeSolver = StressCase.new_solver, check: Callable[[], None] = lambda: None
) -> StressFigures:
    """Run one case.

    Args:
        case: What to run.
        make_solver: Makes the solver, for the run and for every candidate of the shrinking.
        check: Called between blocks.

    Raises:
        HhsimError: More pairs were near than the solver holds, or a failure could not be written.
    """
    warm_up(case.hand, case.solver)
    measure = _Measure(case)
    solver = make_solver(case)
    stretch: deque[tuple[HandMotion, HandMotion]] = deque(maxlen=STRETCH_BLOCKS)
    kept: dict[str, KeptFailure] = {}
    for motion in case.targets().blocks(case.ticks, BLOCK):
        first = measure.ticks
        record = solver.run(*motion)
        depth = recorded_penetration(case.hand, solver.tree, record)
        stretch.append((motion, recorded_motion(record).copy()))
        failing = measure.add(motion, record, depth)
        for kind, ticks in failing.items():
            if case.keep is not None and kind not in kept and ticks.any():
                tick = int(np.argmax(ticks))
                kept[kind] = _keep(case, make_solver, kind, first + tick, tick, list(stretch))
        check()
    return measure.figures(tuple(kept.values()))


def run_stress(
    cases: Sequence[StressCase], *, jobs: int = 1, progress: Progress | None = None
) -> Iterator[StressFigures]:
    """Run cases, `jobs` of them at a time in processes of their own; figures come in the order of the cases.

    Raises:
        HhsimError: As `run_case`.
    """
    with interruptible_between() as check:
        for done, figures in enumerate(_run_all(cases, jobs, check)):
            if progress is not None:
                progress("cases", done + 1, len(cases))
            yield figures


def _run_all(cases: Sequence[StressCase], jobs: int, check: Callable[[], None]) -> Iterator[StressFigures]:
    if jobs <= 1 or len(cases) <= 1:
        for case in cases:
            yield run_case(case, check=check)
        return
    with _workers(min(jobs, len(cases))) as pool:
        waiting = [pool.submit(run_case, case) for case in cases]
        for future in waiting:
            yield future.result()
            check()


@contextmanager
def _workers(count: int) -> Iterator[ProcessPoolExecutor]:
    # Spawned, not forked: a fork of a process with threads copies locks that nobody will release.
    pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


class _Measure:
    """Figures of a case, block by block."""

    def __init__(self, case: StressCase) -> None:
        self._case = case
        self._tree = case.tree.arrays()
        self._leaves = np.array(case.tree.leaf_center), np.array(case.tree.leaf_radius)
        self._cpu = LogHistogram()
        self._deepest = np.zeros(3)
        self._force = (-np.inf, np.nan)
        self._force_ratio = 0.0
        self._counts = dict.fromkeys(("penetrating", "deep", "not_finite", "stuck", "lag", "held", "touching"), 0)
        self._candidates = 0
        self._stuck_run = self._longest_stuck = 0
        self._stuck_checked = self._unexplained = 0
        self._brute_ticks, self._brute_difference = 0, 0.0
        self._before: HandMotion | None = None
        self.ticks = 0

    def add(self, motion: HandMotion, record: TickRecord, depth: Penetration) -> dict[str, Mask]:
        """Measure a block; returns which of its ticks failed, shape (T,), by the name of the failure."""
        counts, case = self._counts, self._case
        deepest = [depth.depth, depth.palm, depth.finger]
        self._deepest = np.maximum(self._deepest, [float(np.max(values)) for values in deepest])
        penetrating, lost = ~(depth.depth <= SAFE_DEPTH), not_finite(record)
        counts["penetrating"] += int(penetrating.sum())
        counts["deep"] += int((~(depth.depth <= DEEP)).sum())
        counts["not_finite"] += int(lost.sum())
        for name, bit in (("stuck", STATUS_STUCK), ("lag", STATUS_LAG), ("held", STATUS_HELD)):
            counts[name] += int(((record.status & bit) > 0).sum())
        counts["touching"] += int((record.work[:, WORK_TOUCHING] > 0).sum())
        self._candidates = max(self._candidates, int(record.work[:, WORK_CANDIDATES].max()))
        self._cpu.add(record.duration_cpu)
        haptic = self._readings(motion)
        size = np.linalg.norm(record.total, axis=1)
        top = int(np.argmax(np.where(np.isfinite(size), size, -1.0)))
        own = coupling_force(case, haptic, record)
        if size[top] > self._force[0]:
            self._force = float(size[top]), float(own[top])
        pushed = size >= LEAST_FORCE
        if pushed.any():
            # A method that is not held back by its coupling can push where the coupling pulls at nothing.
            with np.errstate(divide="ignore"):
                self._force_ratio = max(self._force_ratio, float((size[pushed] / own[pushed]).max()))
        self._brute(record)
        unexplained = self._explain(haptic, record)
        self.ticks += motion.ticks
        return {"penetration": penetrating, "not finite": lost, "stuck": unexplained}

    def _brute(self, record: TickRecord) -> None:
        hand, palm = self._case.hand, self._case.hand.palm_tree
        for tick in range(-self.ticks % BRUTE_EVERY, len(record.status), BRUTE_EVERY):
            shown = record.joints[tick], record.position[tick], record.orientation[tick]
            brute = brute_clearance(*self._leaves, hand.radius, palm.leaf_center, palm.leaf_radius, *shown)
            joints, position, orientation = (values[None] for values in shown)
            by_tree = hand_clearance(
                self._tree, hand.radius, palm.leaf_center, palm.leaf_radius, joints, position, orientation, limit=FAR
            )
            difference = abs(min(brute, FAR) - float(np.minimum(by_tree[0], by_tree[1].min(axis=1))[0]))
            self._brute_ticks += 1
            self._brute_difference = max(self._brute_difference, difference)

    def _readings(self, motion: HandMotion) -> HandMotion:
        # As the solver holds them, across blocks too.
        if self._before is None:
            held = motion.held()
        else:
            held = joined([self._before, motion]).held().part(1, motion.ticks + 1)
        self._before = held.part(motion.ticks - 1, motion.ticks).copy()
        return held

    def _explain(self, haptic: HandMotion, record: TickRecord) -> Mask:
        stuck = (record.status & STATUS_STUCK) > 0
        unexplained = np.zeros(len(stuck), dtype=bool)
        shown = recorded_motion(record)
        for tick, is_stuck in enumerate(stuck):
            self._stuck_run = self._stuck_run + 1 if is_stuck else 0
            self._longest_stuck = max(self._longest_stuck, self._stuck_run)
            if is_stuck and self._stuck_checked < MOST_STUCK_CHECKED:
                self._stuck_checked += 1
                case = self._case
                goal, here = haptic.part(tick, tick + 1), shown.part(tick, tick + 1)
                unexplained[tick] = way_out(case.hand, case.tree, case.solver, here, goal) > 0.0
        self._unexplained += int(unexplained.sum())
        return unexplained

    def figures(self, failures: tuple[KeptFailure, ...]) -> StressFigures:
        """Everything so far."""
        case, counts = self._case, self._counts
        return StressFigures(
            object=case.object,
            method=case.solver.method,
            level=case.tree.depth,
            spheres=case.tree.leaf_count,
            seed=case.seed,
            ticks=self.ticks,
            penetration=float(self._deepest[0]),
            penetration_palm=float(self._deepest[1]),
            penetration_finger=float(self._deepest[2]),
            penetrating=counts["penetrating"],
            penetrating_deep=counts["deep"],
            not_finite=counts["not_finite"],
            stuck=counts["stuck"],
            unexplained=self._unexplained,
            longest_stuck=self._longest_stuck,
            lag=counts["lag"],
            held=counts["held"],
            touching=counts["touching"],
            candidates_max=self._candidates,
            force_max=max(self._force[0], 0.0),
            coupling_force=self._force[1],
            force_ratio=self._force_ratio,
            brute_ticks=self._brute_ticks,
            brute_difference=self._brute_difference,
            cpu=self._cpu,
            failures=failures,
        )


def _keep(
    case: StressCase,
    make_solver: MakeSolver,
    kind: str,
    tick: int,
    tick_in_block: int,
    stretch: list[tuple[HandMotion, HandMotion]],
) -> KeptFailure:
    assert case.keep is not None
    behind = stretch[-1][0].ticks - tick_in_block - 1
    motion, graphic = (joined(pieces) for pieces in zip(*stretch))
    end = motion.ticks - behind
    trial = make_trial(
        case.hand, case.tree, lambda: make_solver(case), failure_of(kind, case.hand, case.tree, case.solver)
    )
    reproduced = True
    try:
        shrunk = shrink(motion.part(0, end), trial, graphic=graphic.part(0, end))
    except InputError:
        # The solver's memory of what came before the stretch decides: keep the whole way there.
        whole = case.targets().take(tick + 1).replayed()
        shrunk = Shrunk(whole, trial(whole), tick + 1, 1)
        reproduced = bool(shrunk.trace.failed.any())
    last = shrunk.tick if reproduced else shrunk.motion.ticks - 1
    record = make_solver(case).run(*shrunk.motion)
    depth = float(recorded_penetration(case.hand, case.tree.arrays(), record).depth[last])
    provenance = Provenance(
        kind=kind,
        object=case.object,
        object_options=case.object_options,
        method=case.solver.method,
        seed=case.seed,
        tick=tick,
        failing_tick=last,
        depth=depth,
        stress=case.stress.to_json(),
        solver=case.solver.to_json(),
        hand=case.hand.side,
    )
    case.keep.mkdir(parents=True, exist_ok=True)
    stem = Path(case.object).stem
    name = f"{stem}-{case.solver.method}-{kind.replace(' ', '-')}-seed{case.seed}-tick{tick}.h5"
    path = free_name(case.keep / name)
    command = keep_failure(path, shrunk, provenance)
    return KeptFailure(kind, tick, str(path), shrunk.motion.ticks, last, depth, reproduced, command)
