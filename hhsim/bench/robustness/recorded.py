"""`hhsim bench recorded`: recordings of real hands, each against every object, by every method, every tick measured.

Penetration is recomputed from the recorded poses, and for some ticks in touch by brute force over all leaves or
triangles. A recording that cannot be read or placed is a row with the reason.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, IntArray
from hhsim.bench.robustness.acceptance import unexplained_stuck
from hhsim.bench.robustness.failure import SAFE_DEPTH, not_finite, recorded_penetration
from hhsim.bench.robustness.pieces import Pieces, hand_distance, pieces_of
from hhsim.bench.run_errors import placed_of
from hhsim.bench.table import columns_of, cpu_times, figure, mean, metric, totals_of
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_START_INSIDE, STATUS_STUCK, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import MOST_CONTACT_ERROR, MOST_TICKS, TouchedObject
from hhsim.metrics.metrics import contact_force_step, force_variation_rate, sample_variation_rate, statistics
from hhsim.motion.trajectory import ResampleMode, Trajectory
from hhsim.scene.motion_catalogue import RECORDING_SUFFIXES, imported_suffixes, load_recorded
from hhsim.scene.recorded_grasp_pose import place_at_grasp
from hhsim.scene.scene import Scene, make_scene
from hhsim.solver.compile import warm_up
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import never_penetrates
from hhsim.solver.options import SolverOptions
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.log_histogram import CpuTimes, LogHistogram
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

NAN = float("nan")


def _largest(values: Sequence[Any]) -> Any:
    return max((value for value in values if value == value), default=NAN)


@dataclass(frozen=True, kw_only=True)
class RecordedFigures(CpuTimes):
    """Figures of a run; `reason` says why there was none.

    Forces in touch are those of the figures `force_contact_…` of a replay; variations are means over the ticks with a
    force before them.
    """

    recording: str = figure("recording")
    object: str = figure("object; empty where the recording could not be read", default="")
    method: str = figure("method of the solver", default="")
    surface: str = figure("what of the object the hand touches", default="")
    reason: str = figure("why there was no run", default="")
    placement: str = figure("where the object was put, and how the hand begins", default="")
    samples: int = figure("samples of the recording", "", sum, 0)
    rate: float = figure("ticks a second", "Hz", default=NAN)
    ticks: int = figure("ticks run", "", sum, 0)
    fastest: float = figure("farthest way of a fingertip of the user's hand in a tick", "m", _largest, NAN)
    penetration: float = figure("deepest penetration", "m", _largest, NAN)
    penetrating: int = figure("ticks deeper than 1 um", "", sum, 0)
    brute_ticks: int = figure("ticks in touch recomputed by brute force over all leaves or triangles", "", sum, 0)
    brute_depth: float = figure("deepest penetration of those, by brute force", "m", _largest, NAN)
    not_finite: int = figure("ticks whose hand or force is not finite", "", sum, 0)
    touching: int = figure("ticks in touch with the object", "", sum, 0)
    candidates_max: int = metric(_largest, 0)
    contact_error_max: float = metric(_largest, NAN)
    force_mean: float = figure("mean size of the total force in touch", "N", mean, NAN)
    force_max: float = figure("largest size of the total force in touch", "N", _largest, NAN)
    force_step: float = figure("largest one-tick step of the total force in touch", "N", _largest, NAN)
    variation_tick: float = figure("mean force variation from tick to tick", "%", mean, NAN)
    variation_sample: float = figure("mean force variation from one new input sample to the next", "%", mean, NAN)
    stuck: int = figure("ticks that kept the last feasible hand", "", sum, 0)
    longest_stuck: int = figure("longest run of stuck ticks", "", _largest, 0)
    unexplained: int = figure("stuck ticks that had a way out", "", sum, 0)
    lagging: int = figure("ticks with distance still to go", "", sum, 0)
    lag: float = figure("most distance still to go", "m", _largest, 0.0)
    started_inside: bool = figure("whether the user's hand begins inside the object", "", _largest, default=False)
    cpu: LogHistogram = cpu_times("a tick with candidates")  # noqa: RUF009

    @property
    def safe(self) -> bool:
        """True if it ran, stayed within 1 µm and finite, and no stuck tick had a free step."""
        if self.reason:
            return False
        shallow = self.penetration <= SAFE_DEPTH and not self.brute_depth > SAFE_DEPTH
        return shallow and self.not_finite == 0 and self.unexplained == 0

    @property
    def floats(self) -> bool:
        """True if it touches farther from the true mesh than a user should feel."""
        return self.contact_error_max > MOST_CONTACT_ERROR

    @property
    def missed(self) -> bool:
        """True if there was no run, or if a method that promises safety is not safe, or floats."""
        return bool(self.reason) or (never_penetrates(self.method) and (self.floats or not self.safe))


COLUMNS = (*columns_of(RecordedFigures), Column("safe", "ran within 1 um, finite, and no stuck tick had a way out"))
"""Columns of the suite's table: a row a run, or one for a recording that could not be run."""


def longest_run(where: BoolArray) -> int:
    """Return the largest number of neighbouring entries that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def totals(rows: Sequence[RecordedFigures]) -> list[RecordedFigures]:
    """Return all recordings of each object, method and surface as one; those of all objects too if there are several.

    Counts are added, the largest is kept, percentiles are over all ticks; means are over the recordings that have one.
    """
    ran = [row for row in rows if not row.reason]
    objects = list(dict.fromkeys(row.object for row in ran))
    found = []
    for name in [*objects, *(["all"] if len(objects) > 1 else [])]:
        for solver in dict.fromkeys((row.method, row.surface) for row in ran):
            group = [row for row in ran if (row.method, row.surface) == solver and name in (row.object, "all")]
            if group:
                known = replace(group[0], recording=f"all {len({row.recording for row in group})}", object=name)
                found.append(replace(known, placement="", **totals_of(RecordedFigures, group)))
    return found


Placing = Literal["auto", "recorded"]

BLOCK = 2048
"""Ticks that are run and measured together."""
BRUTE_TICKS = 12
"""Ticks in touch of each run whose depth is recomputed by brute force."""


@dataclass(frozen=True, eq=False)
class BenchObject:
    """An object by its name or file."""

    name: str
    mesh: Mesh
    tree: SphereTree


@dataclass(frozen=True, kw_only=True)
class RecordedOptions:
    """Options of every run.

    Attributes:
        rate: Tick rate [Hz].
        mode: Between two samples: interpolate, or hold the last one.
        place: Place of the object: where the closing fingers meet it, or as recorded.
        ticks: Number of ticks to run, around the grasp, or the first ones of an object placed as recorded; None: all.
        seed: Of the choice of ticks that are recomputed by brute force.
    """

    rate: float = 1000.0
    mode: ResampleMode = "interpolate"
    place: Placing = "auto"
    ticks: int | None = None
    seed: int = 0


def recording_files(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings among files and in folders, where the suffix tells them.

    Raises:
        InputError: A path that is not there, a folder without recordings, or no path.
    """
    found: list[Path] = []
    suffixes = (*RECORDING_SUFFIXES, *imported_suffixes())
    for path in paths:
        if path.is_dir():
            inside = sorted(entry for entry in path.iterdir() if entry.is_file() and entry.suffix.lower() in suffixes)
            if not inside:
                raise InputError(
                    f"{path}: no recordings in this folder; expected files that end in {', '.join(suffixes)}"
                )
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise InputError(f"{path}: no such file or folder; expected recordings, {', '.join(suffixes)}")
    if not found:
        raise InputError("no recordings; expected a folder or files")
    return list(dict.fromkeys(found))


def bench_recorded(
    files: Sequence[Path],
    objects: Sequence[BenchObject],
    solvers: Sequence[SolverOptions],
    options: RecordedOptions,
    progress: Progress = silent,
) -> Iterator[RecordedFigures]:
    """Run every recording against every object by every method, in this order."""
    hands = {side: HandModel.default(side) for side in ("right", "left")}
    each = len(objects) * len(solvers)
    with interruptible_between() as check:
        for number, file in enumerate(files):
            progress(file.stem, number * each, len(files) * each)
            try:
                motion = load_recorded(file)
            except HhsimError as error:
                yield RecordedFigures(recording=file.stem, reason=str(error))
                continue
            motion = motion if motion.name else replace(motion, name=file.stem)
            hand = hands["left" if motion.hand == "left" else "right"]
            for placed in objects:
                yield from _runs(motion, file.stem, hand, placed, solvers, options, check)
    progress("recordings", len(files) * each, len(files) * each)


def _runs(
    motion: Trajectory,
    name: str,
    hand: HandModel,
    at: BenchObject,
    solvers: Sequence[SolverOptions],
    options: RecordedOptions,
    check: Callable[[], None],
) -> Iterator[RecordedFigures]:
    rows = [
        RecordedFigures(recording=name, object=at.name, method=solver.method, surface=solver.surface)
        for solver in solvers
    ]
    try:
        scene, text = _scene(motion, hand, at, options)
    except HhsimError as error:
        yield from (replace(row, reason=str(error)) for row in rows)
        return
    tips = forward_kinematics(hand, *HandConfiguration.of(scene.ticks)).joints[:, :, 3]
    fastest = float(np.linalg.norm(np.diff(tips, axis=0), axis=2).max(initial=0.0))
    for row, solver in zip(rows, solvers):
        known = replace(row, placement=text, samples=motion.sample_count, rate=options.rate, fastest=fastest)
        try:
            yield run_scene(scene, solver, known, options.seed, check)
        except HhsimError as error:
            yield replace(known, reason=str(error))


def _scene(motion: Trajectory, hand: HandModel, at: BenchObject, options: RecordedOptions) -> tuple[Scene, str]:
    text, middle = "", 0.0
    if options.place == "auto":
        placement = place_at_grasp(motion, hand, at.tree)
        motion, text, middle = placement.motion, placement.text, placement.time
    scene = make_scene(at.mesh, at.tree, hand, motion, rate=options.rate, mode=options.mode)
    total = scene.ticks.tick_count
    if options.ticks is None or options.ticks >= total:
        return scene, text
    first = min(max(0, round(middle * options.rate) - options.ticks // 2), total - options.ticks)
    keys = ("time", "input_seq", "position", "orientation", "flexion", "abduction")
    part = slice(first, first + options.ticks)
    arrays: dict[str, Any] = {key: np.ascontiguousarray(getattr(scene.ticks, key)[part]) for key in keys}
    return replace(scene, ticks=replace(scene.ticks, phases=(), **arrays)), text


def run_scene(
    scene: Scene, solver: SolverOptions, known: RecordedFigures, seed: int, check: Callable[[], None]
) -> RecordedFigures:
    """Run one scene by one method and measure every tick.

    Args:
        known: Figures that do not come from the run.
        check: Called between blocks.

    Raises:
        HhsimError: More candidate pairs than the solver holds.
    """
    solver = solver.at_rate(scene.ticks.rate)
    warm_up(scene.hand, solver)
    surface = contact_surface(solver.surface, scene.mesh, scene.tree).arrays
    pieces = pieces_of(solver.surface, scene.mesh, scene.tree)
    running = HandSolver(scene.hand, surface, solver)
    ticks = scene.ticks
    blocks: list[tuple[AnyArray, ...]] = []
    cpu, candidates, unexplained = LogHistogram(), 0, 0
    brute = _BruteForce(pieces, hand_shape(scene.hand), ticks.tick_count, np.random.default_rng(seed))
    fingers = np.array([finger in solver.fingers for finger in FINGERS])
    touched_object = TouchedObject(scene.mesh, surface, hand_shape(scene.hand), fingers, solver.touch)
    looked_at, off_mesh = max(1, ticks.tick_count // MOST_TICKS), [np.nan]
    for first in range(0, ticks.tick_count, BLOCK):
        part = slice(first, first + BLOCK)
        motion = HandConfiguration.of(ticks).at(part)
        record = running.run(*motion)
        touching = record.work[:, WORK_TOUCHING] > 0
        depth = recorded_penetration(scene.hand, surface, record).depth
        blocks.append((record.status, record.total, record.lag, depth, not_finite(record), touching))
        near = record.work[:, WORK_CANDIDATES] > 0
        cpu.add(record.duration_cpu[near])
        candidates = max(candidates, int(record.work[:, WORK_CANDIDATES].max(initial=0)))
        unexplained += unexplained_stuck(scene.hand, pieces, solver, motion, record)
        brute.look(record, np.flatnonzero(touching))
        some = touching & ((first + np.arange(len(touching))) % looked_at == 0)
        placed = placed_of(record)
        off_mesh.append(statistics(touched_object.contact_error(placed, some)).max)
        check()
    status, force, lag, depth, lost, touched = (np.concatenate(values) for values in zip(*blocks))
    stuck = (status & STATUS_STUCK) > 0
    # As `RunTicks.touch` has it: a force is a touch, however far the nearest pair is.
    size = np.linalg.norm(force, axis=1)
    felt = touched | (size > 0.0)
    in_touch = statistics(size, felt)
    return replace(
        known,
        ticks=ticks.tick_count,
        penetration=float(depth.max()),
        penetrating=int((~(depth <= SAFE_DEPTH)).sum()),
        brute_ticks=brute.ticks,
        brute_depth=brute.depth,
        not_finite=int(lost.sum()),
        touching=int(touched.sum()),
        candidates_max=candidates,
        contact_error_max=float(np.fmax.reduce(off_mesh)),
        force_mean=in_touch.mean,
        force_max=in_touch.max,
        force_step=contact_force_step(force, felt),
        variation_tick=statistics(force_variation_rate(force)).mean,
        variation_sample=statistics(sample_variation_rate(force, ticks.input_seq)).mean,
        stuck=int(stuck.sum()),
        longest_stuck=longest_run(stuck),
        unexplained=unexplained,
        lagging=int(((status & STATUS_LAG) > 0).sum()),
        lag=float(lag.max()),
        started_inside=bool(((status & STATUS_START_INSIDE) > 0).any()),
        cpu=cpu,
    )


class _BruteForce:
    """Depths of chosen ticks in touch over all leaves or triangles."""

    def __init__(self, pieces: Pieces, shape: HandShape, ticks: int, random: np.random.Generator) -> None:
        self._pieces, self._shape, self._random = pieces, shape, random
        self._every = max(1, ticks // BRUTE_TICKS)
        self.ticks, self.depth = 0, float("nan")

    def look(self, record: TickRecord, touching: IntArray) -> None:
        """Recompute the depth of some of a block's ticks in touch."""
        count = min(len(touching), -(-len(record.status) // self._every))
        for tick in self._random.choice(touching, count, replace=False) if count else ():
            shown = record.joints[tick], record.position[tick], record.orientation[tick]
            clear = hand_distance(self._pieces, self._shape, *shown)
            self.depth = float(np.fmax(self.depth, max(0.0, -clear)))
            self.ticks += 1
