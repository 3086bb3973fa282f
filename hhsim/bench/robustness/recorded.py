"""`hhsim bench recorded`: recordings of real hands, each against every object, by every method, every tick measured.

Penetration is recomputed from the recorded poses. A recording that cannot be read or placed is a row with the reason.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.bench.robustness.failure import recorded_penetration
from hhsim.bench.robustness.local_optimality import pieces_of
from hhsim.bench.robustness.safety import BLOCK, NAN, SafetyFigures, SafetyMeasure, deepest, largest
from hhsim.bench.run_errors import placed_of
from hhsim.bench.table import columns_of, cpu_times, figure, mean, metric, totals_of
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import STATUS_START_INSIDE, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import MOST_CONTACT_ERROR, MOST_TICKS, TouchedObject
from hhsim.metrics.metrics import contact_force_step, force_variation_rate, sample_variation_rate, statistics
from hhsim.motion.trajectory import ResampleMode, TickInput, Trajectory
from hhsim.scene.motion_catalogue import RECORDING_SUFFIXES, imported_suffixes, load_recorded
from hhsim.scene.recorded_grasp_pose import place_at_grasp
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.method import never_penetrates
from hhsim.solver.options import SolverOptions
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.log_histogram import LogHistogram
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True, kw_only=True)
class RecordedFigures(SafetyFigures):
    """Figures of a run; `reason` says why there was none.

    Forces in touch are those of the figures `force_contact_…` of a replay; variations are means over the ticks with a
    force before them.
    """

    recording: str = figure("recording")
    penetration: float = figure("deepest penetration", "m", deepest, NAN)
    reason: str = figure("why there was no run", default="")
    placement: str = figure("where the object was put, and how the hand begins", default="")
    samples: int = figure("samples of the recording", "", sum, 0)
    rate: float = figure("ticks a second", "Hz", default=NAN)
    fastest: float = figure("farthest way of a fingertip of the user's hand in a tick", "m", largest, NAN)
    contact_error_max: float = metric(largest, NAN)
    force_mean: float = figure("mean size of the total force in touch", "N", mean, NAN)
    force_max: float = figure("largest size of the total force in touch", "N", largest, NAN)
    force_step: float = figure("largest one-tick step of the total force in touch", "N", largest, NAN)
    variation_tick: float = figure("mean force variation from tick to tick", "%", mean, NAN)
    variation_sample: float = figure("mean force variation from one new input sample to the next", "%", mean, NAN)
    started_inside: bool = figure("whether the user's hand begins inside the object", "", largest, default=False)
    cpu: LogHistogram = cpu_times("a tick with candidates")  # noqa: RUF009

    @property
    def safe(self) -> bool:
        """True if it ran, stayed within 1 µm and finite, and no stuck tick had a free step."""
        return not self.reason and super().safe

    @property
    def floats(self) -> bool:
        """True if it touches farther from the true mesh than a user should feel."""
        return self.contact_error_max > MOST_CONTACT_ERROR

    @property
    def missed(self) -> bool:
        """True if there was no run, or if a method that promises safety is not safe, or floats."""
        return bool(self.reason) or super().missed or (never_penetrates(self.method) and self.floats)


COLUMNS = (*columns_of(RecordedFigures), Column("safe", "ran within 1 um, finite, and no stuck tick had a way out"))
"""Columns of the suite's table: a row a run, or one for a recording that could not be run."""


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


@dataclass(frozen=True, eq=False)
class BenchObject:
    """An object by its name or file."""

    name: str
    mesh: Mesh
    tree: SphereTree


@dataclass(frozen=True, kw_only=True)
class RecordedOptions:
    """Options of every run."""

    rate: float = 1000.0  # tick rate [Hz]
    mode: ResampleMode = "interpolate"  # between two samples: interpolate, or hold the last one
    # Place of the object: where the closing fingers meet it, or as recorded.
    place: Literal["auto", "recorded"] = "auto"
    # Number of ticks to run, around the grasp, or the first ones of an object placed as recorded; None: all.
    ticks: int | None = None


def recording_files(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings among files and in folders, by their suffix; InputError where there is none."""
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
        at_hand, ticks, text = _scene(motion, hand, at, options)
    except HhsimError as error:
        yield from (replace(row, reason=str(error)) for row in rows)
        return
    tips = forward_kinematics(hand, *HandConfiguration.of(ticks)).joints[:, :, 3]
    fastest = float(np.linalg.norm(np.diff(tips, axis=0), axis=2).max(initial=0.0))
    for row, solver in zip(rows, solvers):
        known = replace(row, placement=text, samples=motion.sample_count, rate=options.rate, fastest=fastest)
        try:
            yield run_scene(hand, *at_hand, ticks, solver, known, check)
        except HhsimError as error:
            yield replace(known, reason=str(error))


def _scene(
    motion: Trajectory, hand: HandModel, at: BenchObject, options: RecordedOptions
) -> tuple[tuple[Mesh, SphereTree], TickInput, str]:
    """Return the object where it is at first, the hand's ticks as the object sees them, and how it was placed."""
    text, middle = "", 0.0
    if options.place == "auto":
        placement = place_at_grasp(motion, hand, at.tree)
        motion, text, middle = placement.motion, placement.text, placement.time
    scene = make_scene(at.mesh, at.tree, hand, motion, rate=options.rate, mode=options.mode)
    body, ticks = scene.solids[0], scene.hands[0].ticks.seen_from_object()
    found, total = (body.placed_mesh, body.placed_tree), ticks.tick_count
    if options.ticks is None or options.ticks >= total:
        return found, ticks, text
    first = min(max(0, round(middle * options.rate) - options.ticks // 2), total - options.ticks)
    keys = ("time", "input_seq", "position", "orientation", "flexion", "abduction")
    part = slice(first, first + options.ticks)
    arrays: dict[str, Any] = {key: np.ascontiguousarray(getattr(ticks, key)[part]) for key in keys}
    return found, replace(ticks, phases=(), **arrays), text


def run_scene(
    hand: HandModel,
    mesh: Mesh,
    tree: SphereTree,
    ticks: TickInput,
    solver: SolverOptions,
    known: RecordedFigures,
    check: Callable[[], None],
) -> RecordedFigures:
    """Run one scene by one method and measure every tick; `known` figures do not come from the run.

    `check` is called between blocks. HhsimError for more candidate pairs than the solver holds.
    """
    solver = solver.at_rate(ticks.rate)
    warm_up(hand, solver)
    surface = contact_surface(solver.surface, mesh, tree).arrays
    running = HandSolver(hand, surface, solver)
    safety = SafetyMeasure(hand, pieces_of(solver.surface, mesh, tree), solver)
    blocks: list[tuple[AnyArray, ...]] = []
    cpu = LogHistogram()
    fingers = np.array([finger in solver.fingers for finger in FINGERS])
    touched_object = TouchedObject(mesh, surface, hand_shape(hand), fingers, solver.touch)
    looked_at, off_mesh = max(1, ticks.tick_count // MOST_TICKS), [np.nan]
    for first in range(0, ticks.tick_count, BLOCK):
        motion = HandConfiguration.of(ticks).at(slice(first, first + BLOCK))
        record = running.run(*motion)
        safety.add(safety.readings(motion), record, recorded_penetration(hand, surface, record).depth)
        touching = record.work[:, WORK_TOUCHING] > 0
        blocks.append((record.status, record.total, touching))
        cpu.add(record.duration_cpu[record.work[:, WORK_CANDIDATES] > 0])
        some = touching & ((first + np.arange(len(touching))) % looked_at == 0)
        off_mesh.append(statistics(touched_object.contact_error(placed_of(record), some)).max)
        check()
    status, force, touched = (np.concatenate(values) for values in zip(*blocks))
    # As `RunTicks.touch` has it: a force is a touch, however far the nearest pair is.
    size = np.linalg.norm(force, axis=1)
    felt = touched | (size > 0.0)
    in_touch = statistics(size, felt)
    return replace(
        known,
        **safety.totals,
        contact_error_max=float(np.fmax.reduce(off_mesh)),
        force_mean=in_touch.mean,
        force_max=in_touch.max,
        force_step=contact_force_step(force, felt),
        variation_tick=statistics(force_variation_rate(force)).mean,
        variation_sample=statistics(sample_variation_rate(force, ticks.input_seq)).mean,
        started_inside=bool(((status & STATUS_START_INSIDE) > 0).any()),
        cpu=cpu,
    )
