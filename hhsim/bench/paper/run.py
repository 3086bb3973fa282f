"""One scene of the paper's evaluation, replayed by one method: times, contacts, depth, touches, force variation.

The scenes of Fig. 15 are replayed as many short motions, each with the hand a little elsewhere; the others once, as
long as they are. All of them come out as the same kind of figures.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import AnyArray, BoolArray, FloatArray
from hhsim.bench.paper.contact_check import hold_distances
from hhsim.bench.paper.scenarios import Scenario
from hhsim.bench.paper.scene import RATE, Stage, held_ticks
from hhsim.bench.run_errors import digest_of, hand_clearance, placed_of
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_TOUCHING
from hhsim.metrics.metrics import component_variation_rate, force_variation_rate
from hhsim.metrics.run_ticks import RunTicks
from hhsim.motion.trajectory import TickInput
from hhsim.motion.tremor import Disturbance
from hhsim.replay.tremor_hold import TREMOR, trembling_hold
from hhsim.scene.contact_goals import TOUCHING, Touch
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

Times = NDArray[np.float32]
"""Of millions of ticks, to a nanosecond in ten milliseconds."""

INDEX = FINGERS.index("index")

COUNTS = 4096
"""A 12-bit sensor's counts a turn."""
GLOVE_RATE = 200.0
"""Samples per second of a glove such as the paper's [Hz]."""
GLOVE = Disturbance(sensor_counts=COUNTS, sensor_noise=0.25 * 2.0 * math.pi / COUNTS)
"""A glove on a still hand: readings flicker by one count of a 12-bit sensor. The paper moved the palm by keys."""
NOISES: dict[str, tuple[Disturbance, float | None]] = {
    "glove": (GLOVE, GLOVE_RATE),
    "trembling": (replace(TREMOR, sensor_counts=GLOVE.sensor_counts, sensor_noise=GLOVE.sensor_noise), GLOVE_RATE),
}
"""How a hold is repeated by a live hand: sensors of the glove alone, and tremor of the palm besides."""
CARRIES = 0.25
"""A component below this share of its force (three equal ones carry 0.58 each) is not looked at: of one that is nearly
zero, a turn of the force by a hair is a large share. The medians over all holds hardly depend on it: they are 0.06 %
apart at most from 0.1 to 0.5."""


@dataclass(frozen=True, eq=False)
class Variation:
    """Change of the index finger's force from tick to tick in one hold [%], mean and standard deviation.

    Attributes:
        size: Of the force's size, shape (2,).
        component: Of each component, shape (3, 2); NaN for a small one (`CARRIES`).
    """

    size: FloatArray
    component: FloatArray


class Moment(NamedTuple):
    """What a picture shows: its name, and the graphic and the haptic hand."""

    name: str
    graphic: HandConfiguration
    haptic: HandConfiguration


class Curves(NamedTuple):
    """Forces tick by tick [N]: size of the normal force at each fingertip (T, 5), force on the index finger (T, 3)."""

    fingertip: FloatArray
    index_finger: FloatArray


@dataclass(eq=False)
class SceneRun:
    """A scene played by one method; all times [s], one row for each repetition.

    Ticks are those of all motions, one after the other. A run of many instances keeps no poses and forces: they would
    be gigabytes.

    Attributes:
        stage: What was played.
        candidates, touching: Pairs near each other, and touching, at each tick, shape (T,).
        status: Of each tick, shape (T,).
        digest: Of the poses.
        shown: The ends of the holds and the middles of the slides, in order; none for instances.
        curves: Forces; None for instances.
        contact: Ticks with candidate pairs, of those phases in which fingers close, hold or slide, shape (T,).
        depth: Deepest in the object's spheres at each tick [m], shape (T,).
        touches: What was demanded, and how far each was from happening [m], at every hold of every motion.
        variation: Of the index finger's force in the first hold, by the names of NOISES; none for instances.
        cpu, wall: Of every tick in each repetition, shape (T,).
        parts: Detection, palm, fingers, force of every tick in each repetition, shape (T, 4).
    """

    stage: Stage
    options: SolverOptions
    candidates: NDArray[np.int32]
    touching: NDArray[np.int32]
    status: NDArray[np.int32]
    digest: str
    shown: list[Moment]
    curves: Curves | None
    contact: BoolArray
    depth: FloatArray
    touches: list[tuple[Touch, float]]
    variation: dict[str, Variation]
    cpu: list[Times] = field(default_factory=list)
    wall: list[Times] = field(default_factory=list)
    parts: list[Times] = field(default_factory=list)

    @property
    def scenario(self) -> Scenario:
        """The scene."""
        return self.stage.scenario

    @property
    def ticks(self) -> RunTicks:
        """What run metrics that need no force and no pose are computed from."""
        columns: dict[str, AnyArray] = {
            "status": self.status,
            "contacts/candidates": self.candidates,
            "contacts/touching": self.touching,
            "penetration_depth": self.depth,
        }
        return RunTicks(columns, len(self.depth), (), RATE, len(self.options.fingers))

    @cached_property
    def tick_cpu(self) -> FloatArray:
        """Thread time of each tick, the median of the repetitions [s], shape (T,)."""
        return np.median(self.cpu, axis=0).astype(np.float64)

    @cached_property
    def tick_wall(self) -> FloatArray:
        """The same by the clock on the wall [s], shape (T,)."""
        return np.median(self.wall, axis=0).astype(np.float64)

    @cached_property
    def tick_parts(self) -> FloatArray:
        """Detection, palm, fingers and force of each tick by the clock on the wall, medians [s], shape (T, 4)."""
        return np.median(self.parts, axis=0).astype(np.float64)

    @cached_property
    def undisturbed(self) -> BoolArray:
        """Ticks in contact in which the thread was not kept from its processor, shape (T,).

        Wall time is the only time that is known of the parts of a tick, and an interrupted tick's says nothing of it.
        """
        return self.contact & (self.tick_wall <= 1.5 * self.tick_cpu + 5e-6)

    @property
    def missed(self) -> list[tuple[Touch, float]]:
        """Demanded touches that did not happen, and how far [m] they were from it."""
        return [(touch, distance) for touch, distance in self.touches if not distance < TOUCHING]


def play(stage: Stage, options: SolverOptions) -> SceneRun:
    """Play a scene for the first time and measure everything.

    Raises:
        HhsimError: The solver cannot hold the scene's contacts.
    """
    records = _run(stage, options)
    record = joined_record(records)
    contact = np.concatenate([_acting(motion) for motion in stage.motions]) & (record.work[:, WORK_CANDIDATES] > 0)
    touches = []
    for motion, one in zip(stage.motions, records):
        found = hold_distances(stage.script, stage.scenario.object_name, stage.hand, stage.tree, motion, one)
        for demanded, distances in zip(stage.script.hold_touches, found):
            touches += list(zip(demanded, distances.tolist()))
    variation: dict[str, Variation] = {}
    curves: Curves | None = None
    single = stage.scenario.instances == 1
    if single and any(touch.part == "index" for touches in stage.script.hold_touches[:1] for touch in touches):
        variation = {name: _variation(stage, options, records[0], *noise) for name, noise in NOISES.items()}
    if single:
        index_finger = record.phalanx[:, INDEX].sum(axis=1)
        curves = Curves(np.linalg.norm(record.fingertip_normal, axis=2), index_finger)
    run = SceneRun(
        stage=stage,
        options=options,
        candidates=record.work[:, WORK_CANDIDATES].astype(np.int32),
        touching=record.work[:, WORK_TOUCHING].astype(np.int32),
        status=record.status.astype(np.int32),
        digest=digest_of(record),
        shown=_shown(stage, records[0]) if single else [],
        curves=curves,
        contact=contact,
        # 0 - x and not -x: a free hand has depth 0, not minus 0.
        depth=np.maximum(0.0, 0.0 - hand_clearance(stage.hand, stage.arrays, placed_of(record), 0.0)),
        touches=touches,
        variation=variation,
    )
    _keep_times(run, record)
    return run


def play_again(run: SceneRun) -> None:
    """Play a scene once more, for its times.

    Raises:
        HhsimError: The poses are not those of the first time.
    """
    record = joined_record(_run(run.stage, run.options))
    if digest_of(record) != run.digest:
        raise HhsimError(
            f"{run.scenario.name}, {run.options.method}: a repetition gave another hand; please report this"
        )
    _keep_times(run, record)


def at_contacts(stage: Stage, options: SolverOptions, wanted: float, rounds: int = 10) -> tuple[float, SceneRun]:
    """The margin [m] with which the hold of a stage's first motion has about so many candidate pairs, and its run.

    Pairs farther off than the margin are no candidates: a wider one lets more in, which costs time and changes nothing
    else. Halving; the run with the count nearest to the wanted one is kept.
    """
    one = replace(stage, motions=stage.motions[:1])
    held = held_ticks(one)
    low, high = 1e-4, 2e-2
    best: tuple[float, float] | None = None
    for _ in range(rounds):
        margin = math.sqrt(low * high)
        try:
            (record,) = _run(one, replace(options, margin=margin))
        except HhsimError:
            high = margin
            continue
        count = float(record.work[held, WORK_CANDIDATES].mean())
        if best is None or abs(count - wanted) < abs(best[0] - wanted):
            best = count, margin
        if count < wanted:
            low = margin
        else:
            high = margin
    if best is None:
        raise HhsimError(f"{stage.scenario.name}: no margin is small enough for the solver")
    return best[1], play(one, replace(options, margin=best[1]))


def joined_record(records: list[TickRecord]) -> TickRecord:
    """Ticks of several runs, one after the other."""
    if len(records) == 1:
        return records[0]
    return TickRecord(*(np.concatenate(columns) for columns in zip(*records)))


def _run(stage: Stage, options: SolverOptions) -> list[TickRecord]:
    """Play every motion; each begins with the graphic hand on the haptic one, which is free of the object."""
    solver = HandSolver(stage.hand, stage.arrays, options)
    records = []
    for motion in stage.motions:
        haptic = HandConfiguration.of(motion)
        solver.place(*haptic.at(0))
        record = solver.run(*haptic)
        if not np.isfinite(record.joints).all():
            raise HhsimError(f"{stage.scenario.name}, {options.method}: the graphic hand is not finite")
        records.append(record)
    return records


def _shown(stage: Stage, record: TickRecord) -> list[Moment]:
    motion, holds = stage.motions[0], 0
    found = []
    for phase in motion.phases:
        if phase.name == "hold":
            holds += 1
            name, t = f"hold {holds}", phase.last_tick
        elif phase.name == "slide":
            name, t = "slide", (phase.first_tick + phase.last_tick) // 2
        else:
            continue
        graphic = HandConfiguration.of(record).at(t)
        haptic = HandConfiguration.of(motion).at(t)
        found.append(Moment(name, graphic, haptic))
    return found


def _keep_times(run: SceneRun, record: TickRecord) -> None:
    run.cpu.append((1e-9 * record.duration_cpu).astype(np.float32))
    run.wall.append((1e-9 * record.duration_total).astype(np.float32))
    run.parts.append((1e-9 * record.duration).astype(np.float32))
    for name in ("tick_cpu", "tick_wall", "tick_parts", "undisturbed"):
        run.__dict__.pop(name, None)


def _acting(motion: TickInput) -> BoolArray:
    """Ticks in which fingers close, hold or slide: the hand neither comes nor goes."""
    acting = np.zeros(motion.tick_count, bool)
    for phase in motion.phases:
        acting[phase.first_tick : phase.last_tick + 1] = phase.name not in ("approach", "release")
    return acting


def _variation(
    stage: Stage, options: SolverOptions, record: TickRecord, noise: Disturbance, sample_rate: float | None
) -> Variation:
    motion = stage.motions[0]
    phase = next(phase for phase in motion.phases if phase.name == "hold")
    hold = slice(phase.first_tick, phase.last_tick + 1)
    haptic = HandConfiguration.of(motion).at(hold)
    graphic = HandConfiguration.of(record).at(hold)
    again, settled = trembling_hold(*(stage.hand, stage.arrays, options, haptic, graphic, RATE, 0, noise, sample_rate))
    force = again.phalanx[:, INDEX].sum(axis=1)
    mean = float(np.linalg.norm(force[settled], axis=1).mean())
    size = force_variation_rate(force)[settled]
    component = component_variation_rate(force, floor=max(CARRIES * mean, 1e-2))[settled]
    # A component that is rarely large enough says nothing of the hold.
    often = np.isfinite(component).mean(axis=0) > 0.5
    return Variation(
        _mean_std(size), np.array([_mean_std(component[:, k]) if often[k] else (np.nan, np.nan) for k in range(3)])
    )


def _mean_std(values: FloatArray) -> FloatArray:
    defined = values[np.isfinite(values)]
    return np.array([defined.mean(), defined.std()]) if defined.size else np.full(2, np.nan)
