"""Suites that set the time of a tick against its errors: every way to solve the hand on every scene, in turns.

A run is a replay: its figures are those of the replay's table, and distances to the true mesh by the referee
(`hhsim.verify.mesh_distance`), which shares no code with the solver. The haptic input of a scene is made once. The runs
take turns, so that other load of the machine falls on all of them; of each tick in contact the median of the
repetitions counts. Errors are those of the first repetition; the others must give the same poses.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.bench.figures import TOTALS, hand_clearance
from hhsim.bench.suite import Row, Suite
from hhsim.errors import HhsimError, InputError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.run_ticks import PLACED
from hhsim.motion.trajectory import TickInput, Trajectory
from hhsim.replay.replay import replay_scene
from hhsim.replay.run_inputs import tick_digest
from hhsim.report.trade_off import draw_trade_off
from hhsim.result.reader import Result, load_result
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.scene import Scene, make_scene
from hhsim.scene.synthesis import synthesize
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names
from hhsim.table.file import ALL, rows_of
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_distance import TrueSurface

NEAR = 1e-3
"""Largest distance of the haptic hand from the mesh in a tick in contact [m]."""
LONG = 5.0
"""CPU time of all ticks above which a run is not repeated [s]."""
GAIN = 0.05
"""Share by which the error of a slower way on the frontier is smaller."""
TIMES_REMARK = (
    "times are CPU times of ticks with the haptic hand within 1 mm of the mesh, the median of the repetitions; compare "
    "them within this run, not between machines"
)


@dataclass(frozen=True, eq=False)
class Stage:
    """One motion on one object."""

    object: str
    motion: str
    hand: HandModel
    mesh: Mesh
    trajectory: Trajectory
    ticks: TickInput  # of the haptic hand, in the frame of the mesh
    surface: Any  # triangles of the mesh
    contact: BoolArray  # ticks with the haptic hand within `NEAR` of the mesh or inside, shape (T,)
    referee: TrueSurface

    def scene(self, tree: SphereTree) -> Scene:
        """Return the scene with the object's spheres."""
        return make_scene(self.mesh, tree, self.hand, self.trajectory, rate=self.ticks.rate)


class Way(NamedTuple):
    """One way to solve the hand: options of the solver, and the level of the sphere tree that a suite chose."""

    solver: SolverOptions
    level: int = 0

    @property
    def name(self) -> str:
        """Method, and the QP solver if it is another one."""
        return self.solver.method + (f" with {self.solver.qp}" if self.solver.qp != SolverOptions().qp else "")


@dataclass(frozen=True, eq=False)
class Cell:
    """One way to solve the hand on one stage."""

    stage: Stage
    way: Way
    scene: Scene
    errors: Callable[[Result], dict[str, float]]  # figures besides those of the replay's table, in the mesh's frame
    other: str  # dataset of the times besides the CPU's [ns]


@dataclass
class Run:
    """One way to solve the hand on one scene, as often as it was run."""

    object: str
    motion: str
    way: Way
    figures: dict[str, float] = field(default_factory=dict)  # of the first repetition; none where it failed
    # CPU times of the ticks in contact [s], one array of shape (n,) a repetition; and other times of the same ticks.
    cpu: list[FloatArray] = field(default_factory=list)
    other: list[FloatArray] = field(default_factory=list)
    digest: str = ""  # of its poses and forces
    repeatable: bool = True  # True if all repetitions had the same digest
    seconds: float = 0.0  # CPU time of all ticks of the first repetition
    failure: str = ""  # message of the error that ended it, or ""


def placed_at(result: Result, ticks: IntArray) -> PlacedHand:
    """Return the graphic hand of a result at some ticks."""
    return PlacedHand(*(result[name][ticks] for name in PLACED))


def median_percentile(runs: Sequence[Sequence[FloatArray]], percent: float) -> float:
    """Return a percentile of the ticks of runs, each the median of its repetitions; NaN without any."""
    times = np.concatenate([np.median(repetitions, axis=0) for repetitions in runs if repetitions] or [np.zeros(0)])
    return float(np.percentile(times, percent)) if times.size else np.nan


def mark_frontier(group: Sequence[Row], flag: str, error: str) -> None:
    """Mark the rows of a group that none beats in both time and error."""
    for i in frontier([row["tick_cpu_p50"] for row in group], [row[error] for row in group], GAIN):
        group[i][flag] = True


def frontier(time: ArrayLike, error: ArrayLike, gain: float = 0.0) -> IntArray:
    """Return the indices of the points that no other point beats, by growing time.

    A point beats another if it is no worse in both and better in one. Of equal points the first counts; a point with a
    NaN is on no frontier. The error of a slower point is less by at least the share `gain`; 0 gives the plain frontier.
    """
    first, second = np.asarray(time, np.float64).ravel(), np.asarray(error, np.float64).ravel()
    kept: list[int] = []
    for index in np.lexsort((np.arange(first.size), second, first)):
        best = second[kept[-1]] if kept else np.nan
        less = best - gain * abs(best) if np.isfinite(best) else best
        if not (np.isnan(first[index]) or np.isnan(second[index])) and (not kept or second[index] < less):
            kept.append(int(index))
    return np.array(kept, np.int64)


@dataclass(frozen=True, kw_only=True)
class TradeOff(Suite):
    """Scenes and ways to solve the hand, each with each."""

    objects: Names
    motions: Names
    methods: Names | None
    repetitions: Count
    rate: float  # [Hz]
    seed: int
    hands: Count  # limit of the hands of a run whose depth is measured, 6 to 18 ms each
    draws_picture = True

    def check(self) -> None:
        """Raise InputError for an object or a motion that the catalogue lacks, or a motion that touches nothing."""
        check_known("object", self.objects, object_names())
        check_known("trajectory", self.motions, script_names())
        for motion in self.motions:
            if not load_script(motion).contact:
                raise InputError(f"the motion '{motion}' touches nothing: there is no error to measure")

    def stages(self, hand: HandModel, tree: Callable[[Mesh], SphereTree], progress: Progress) -> Iterator[Stage]:
        """Yield every motion on every object, made on the object's tree; TrajectoryError for one that cannot be."""
        count = len(self.objects) * len(self.motions)
        for i, name in enumerate(self.objects):
            mesh = load_object(name).mesh
            spheres, referee = tree(mesh), TrueSurface(mesh, open_too=True)
            surface = contact_surface("mesh", mesh, spheres).arrays
            for j, motion in enumerate(self.motions):
                progress("scenes", i * len(self.motions) + j, count)
                trajectory = synthesize(load_script(motion), hand, spheres, self.seed)
                scene = make_scene(mesh, spheres, hand, trajectory, rate=self.rate)
                ticks = scene.hands[0].ticks.seen_from_object()
                placed = forward_kinematics(hand, *HandConfiguration.of(ticks))
                contact = hand_clearance(hand, surface, placed, NEAR) < NEAR
                yield Stage(name, motion, hand, mesh, trajectory, ticks, surface, contact, referee)

    def run(self, cell: Cell, before: Run | None) -> Run:
        """Replay a way on its scene once more, unless it failed or takes long; an HhsimError is kept."""
        run = before or Run(cell.stage.object, cell.stage.motion, cell.way)
        if run.failure or run.seconds > LONG:
            return run
        with TemporaryDirectory() as folder:
            path = Path(folder) / "run.h5"
            try:
                summary = replay_scene(cell.scene, cell.way.solver, path)
                result = load_result(path)
                finite = np.isfinite(result["graphic/joints"]).all(axis=(1, 2, 3))
                if not finite.all():
                    raise HhsimError(f"the graphic hand is not finite after tick {int(finite.argmin())}")
                digest, cpu = tick_digest(result), 1e-9 * result["duration/total_cpu"]
                if not run.figures:
                    run.figures = {**summary.attributes(), **cell.errors(result.seen_from_object)}
                    run.digest, run.seconds = digest, float(cpu.sum())
            except HhsimError as error:
                run.failure = str(error)
                return run
            run.repeatable = run.repeatable and digest == run.digest
            run.cpu.append(cpu[cell.stage.contact])
            run.other.append(1e-9 * result[cell.other][cell.stage.contact])
        return run

    def of_way(self, runs: Sequence[Run]) -> Row:
        """Return what a row has of runs of one way besides names, times, figures and failures."""
        raise NotImplementedError

    def mark(self, group: Sequence[Row]) -> None:
        """Mark the best of the rows that compete."""
        raise NotImplementedError

    def rows(self, figures: Sequence[Run]) -> list[Row]:
        """Return a row a run, then one for each way and object, then one for each way."""
        groups: dict[tuple[str, Way], list[Run]] = defaultdict(list)
        for run in figures:
            groups[run.object, run.way].append(run)
        for run in figures:
            groups[ALL, run.way].append(run)
        totals = {name: TOTALS[one.total] for name, one in self.plan().columns.items() if one.total}

        def row(name: str, motion: str, group: Sequence[Run]) -> Row:
            times, known = [run.cpu for run in group], [run.figures for run in group if run.figures]
            values = {key: float(total([of.get(key, np.nan) for of in known])) for key, total in totals.items()}
            return {
                "object": name,
                "motion": motion,
                "contact_ticks": sum(cpu[0].size for cpu in times if cpu),
                "tick_cpu_p50": median_percentile(times, 50.0),
                "tick_cpu_p99": median_percentile(times, 99.0),
                **values,
                **self.of_way(group),
                "failed_runs": sum(bool(run.failure) for run in group),
            }

        rows = [row(run.object, run.motion, [run]) for run in figures]
        rows += [row(name, ALL, group) for (name, _), group in groups.items()]
        competing: dict[tuple[str, str], list[Row]] = defaultdict(list)
        for one in rows:
            if not one["failed_runs"]:
                competing[one["object"], one["motion"]].append(one)
        for together in competing.values():
            self.mark(together)
        return rows

    def title(self) -> str:
        """Return the motions."""
        return ", ".join(self.motions)

    def notes(self, figures: Sequence[Run]) -> list[str]:
        """Return remarks on the times, and on the runs that failed."""
        failed = [run for run in figures if run.failure]
        where = [f"{run.way.name}, {run.object}, {run.motion}: {run.failure}" for run in failed[:1]]
        told = [f"{len(failed)} of {len(figures)} runs could not be done; the first: {first}" for first in where]
        return [TIMES_REMARK, *told]

    def named(self, cell: Cell) -> str:
        """Return way and scene."""
        return f"{cell.way.name}, {cell.stage.object}, {cell.stage.motion}"

    def draw(
        self, path: Path, rows: Sequence[Row], figures: Sequence[Run], progress: Progress, note: str
    ) -> list[Path]:
        """Draw time against error, with the engines of the table that the settings name."""
        peers = getattr(self, "peers", None)
        draw_trade_off(path, rows, rows_of(Path(peers), "peers") if peers else [], note)
        return [path]
