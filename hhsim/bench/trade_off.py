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
from hhsim.bench.figures import Figure, hand_clearance, summed
from hhsim.bench.suite import Row
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
from hhsim.table.file import ALL, rows_of
from hhsim.table.table import Column
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_distance import HandReferee

NEAR = 1e-3
"""Largest distance of the haptic hand from the mesh in a tick in contact [m]."""
LONG = 5.0
"""CPU time of all ticks above which a run is not repeated [s]."""
GAIN = 0.05
"""Share by which the error of a slower way on the frontier is smaller."""
SCENE_COLUMNS = (Column("object", "object; 'all' sums up"), Column("motion", "motion; 'all' sums up"))
TIME_COLUMNS = (
    Column("contact_ticks", "ticks with the haptic hand within 1 mm of the mesh or inside; times are of these"),
    Column("tick_cpu_p50", "CPU time of a tick in contact, median", "µs"),
    Column("tick_cpu_p99", "CPU time of a tick in contact, 99th percentile", "µs"),
)
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
    referee: HandReferee

    def scene(self, tree: SphereTree) -> Scene:
        """Return the scene with the object's spheres."""
        return make_scene(self.mesh, tree, self.hand, self.trajectory, rate=self.ticks.rate)


def check_scenes(objects: Sequence[str], motions: Sequence[str]) -> None:
    """Raise InputError for an object or a motion that the catalogue lacks, or a motion that touches nothing."""
    check_known("object", objects, object_names())
    check_known("trajectory", motions, script_names())
    for motion in motions:
        if not load_script(motion).contact:
            raise InputError(f"the motion '{motion}' touches nothing: there is no error to measure")


def stages(options: Any, hand: HandModel, tree: Callable[[Mesh], SphereTree], progress: Progress) -> Iterator[Stage]:
    """Yield every motion on every object, made on the object's tree; TrajectoryError for one that cannot be done.

    `options` have objects, motions, rate [Hz] and seed.
    """
    count = len(options.objects) * len(options.motions)
    for i, name in enumerate(options.objects):
        mesh = load_object(name).mesh
        spheres, referee = tree(mesh), HandReferee(mesh, open_too=True)
        surface = contact_surface("mesh", mesh, spheres).arrays
        for j, motion in enumerate(options.motions):
            progress("scenes", i * len(options.motions) + j, count)
            trajectory = synthesize(load_script(motion), hand, spheres, options.seed)
            scene = make_scene(mesh, spheres, hand, trajectory, rate=options.rate)
            ticks = scene.hands[0].ticks.seen_from_object()
            placed = forward_kinematics(hand, *HandConfiguration.of(ticks))
            contact = hand_clearance(hand, surface, placed, NEAR) < NEAR
            yield Stage(name, motion, hand, mesh, trajectory, ticks, surface, contact, referee)


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


def run_cell(cell: Cell, before: Run | None) -> Run:
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


def placed_at(result: Result, ticks: IntArray) -> PlacedHand:
    """Return the graphic hand of a result at some ticks."""
    return PlacedHand(*(result[name][ticks] for name in PLACED))


def median_percentile(runs: Sequence[Sequence[FloatArray]], percent: float) -> float:
    """Return a percentile of the ticks of runs, each the median of its repetitions; NaN without any."""
    times = np.concatenate([np.median(repetitions, axis=0) for repetitions in runs if repetitions] or [np.zeros(0)])
    return float(np.percentile(times, percent)) if times.size else np.nan


def summed_rows(runs: Sequence[Run], figures: Sequence[Figure], of_way: Callable[[Sequence[Run]], Row]) -> list[Row]:
    """Return a row a run, then one for each way and object, then one for each way.

    `of_way` returns what a row has of runs of one way besides names, times, figures and failures.
    """
    groups: dict[tuple[str, Way], list[Run]] = defaultdict(list)
    for run in runs:
        groups[run.object, run.way].append(run)
    for run in runs:
        groups[ALL, run.way].append(run)

    def row(name: str, motion: str, group: Sequence[Run]) -> Row:
        times, values = [run.cpu for run in group], summed(figures, [run.figures for run in group if run.figures])
        return {
            "object": name,
            "motion": motion,
            "contact_ticks": sum(cpu[0].size for cpu in times if cpu),
            "tick_cpu_p50": median_percentile(times, 50.0),
            "tick_cpu_p99": median_percentile(times, 99.0),
            **{name: float(value) for name, value in values.items()},
            **of_way(group),
            "failed_runs": sum(bool(run.failure) for run in group),
        }

    rows = [row(run.object, run.motion, [run]) for run in runs]
    return rows + [row(name, ALL, group) for (name, _), group in groups.items()]


def competing(rows: Sequence[Row]) -> list[list[Row]]:
    """Return the rows that compete: of one object and motion, without failures."""
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if not row["failed_runs"]:
            groups[row["object"], row["motion"]].append(row)
    return list(groups.values())


def mark_frontier(group: Sequence[Row], flag: str, error: str) -> None:
    """Mark the rows of a group that none beats in both time and error."""
    for i in frontier([row["tick_cpu_p50"] for row in group], [row[error] for row in group], GAIN):
        group[i][flag] = True


def draw(
    path: Path, settings: Any, rows: Sequence[Row], figures: Sequence[Any], progress: Progress, note: str
) -> list[Path]:
    """Draw the picture of a suite, with the engines of the table that its settings name; see `Suite`."""
    peers = getattr(settings, "peers", None)
    draw_trade_off(path, rows, rows_of(Path(peers), "peers") if peers else [], note)
    return [path]


def failure_remark(runs: Sequence[Run]) -> list[str]:
    """Return a remark on the runs that failed, if any."""
    failed = [run for run in runs if run.failure]
    where = [f"{run.way.name}, {run.object}, {run.motion}: {run.failure}" for run in failed[:1]]
    return [f"{len(failed)} of {len(runs)} runs could not be done; the first: {first}" for first in where]


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
