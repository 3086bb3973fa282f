"""Scenes of the paper's evaluation, and one replayed by one method: times, contacts, depth, touches, force variation.

Scripts of the catalogue declare the figure and the objects of their motion. A scene of Fig. 15 has many short motions,
each with the hand a little elsewhere; the others have one whole motion.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from hhsim.arrays import AnyArray, BoolArray, FloatArray
from hhsim.bench.figures import digest_of, hand_clearance, placed_of
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_SNAP, WORK_CANDIDATES, WORK_TOUCHING
from hhsim.mesh.catalogue import object_names
from hhsim.metrics.metrics import component_variation_rate, force_variation_rate
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import RunTicks
from hhsim.motion.trajectory import TickInput, Trajectory
from hhsim.motion.tremor import Disturbance
from hhsim.replay.summary import TREMOR, trembling_hold
from hhsim.scene.contact_goals import TOUCHING, Touch, touch_distances
from hhsim.scene.finger_closure import Closer, body_distances
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.script import Placement, Script
from hhsim.scene.synthesis import planned, synthesize
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.trees.sphere_tree import SphereTree

SLIDING = "sliding"
"""Stands for a figure: the paper describes sliding on the five simple objects without one."""
FIGURES = {
    "11": "one finger, two fingers, five fingers with the palm, on five simple objects",
    "12": "no finger, one, two, five, two, one, none",
    SLIDING: "grasp and slide on the five simple objects",
    "13": "five complex objects, each from several sides",
    "14": "squeeze, hold and slide on cup and bunny",
    "15": "single finger, two fingers, five fingers, whole hand on the complex objects: 100 instances each",
}
CASES = {"SF": "single finger", "TF": "two fingers", "FF": "five fingers", "WH": "whole hand"}
"""Cases of Fig. 15."""


@dataclass(frozen=True)
class Scenario:
    """One scene of the paper."""

    figure: str  # of `FIGURES`
    object_name: str
    motion: str  # script of the catalogue
    case: str = ""  # of `CASES` in Fig. 15, else empty
    instances: int = 1  # number of seeded variations of the hand's place

    @property
    def name(self) -> str:
        """Object and motion as arguments of `hhsim replay`."""
        return f"{self.object_name} {self.motion}"


def paper_scenarios() -> list[Scenario]:
    """Return all scenes: in the order of `FIGURES`, then of the objects, then of the motions or cases."""
    found = [
        Scenario(use.figure, object_name, motion, use.case, use.instances)
        for motion in script_names()
        for use in load_script(motion).paper
        for object_name in use.objects
    ]
    figure_order, object_order = list(FIGURES), object_names()

    def order(scenario: Scenario) -> tuple[int, int, int]:
        case = [*CASES].index(scenario.case) if scenario.case in CASES else 0
        return figure_order.index(scenario.figure), object_order.index(scenario.object_name), case

    return sorted(found, key=order)


RATE = 1000.0
"""Tick rate [Hz], as in the paper."""
SHIFT, TURN = 0.003, math.radians(3.0)
"""Standard deviations of the palm's place in the instances [m] and [rad], in each axis."""
TRIES = 20
"""Limit of the places tried for an instance from which all named fingers reach; and of these, until a hold touches all
that it names."""
SHORT_WAY = 0.01
"""Distance from which an instance begins [m]."""
SHORT_PHASES = {"approach": 0.1, "hold": 0.1, "release": 0.0}
SHORT_CLOSING = 0.25
"""Durations of an instance's phases [s]: it comes from nearby, closes as fast as a fist, holds, and ends there."""


@dataclass(frozen=True, eq=False)
class Stage:
    """Setting of a scene: script, hand, object at rest in the world's frame, and a haptic motion for each instance."""

    scenario: Scenario
    script: Script
    hand: HandModel
    tree: SphereTree
    motions: tuple[TickInput, ...]

    @cached_property
    def arrays(self) -> TreeArrays:
        """Arrays of the tree."""
        return self.tree.arrays()


def make_stage(scenario: Scenario, hand: HandModel, tree: SphereTree, instances: int, seed: int = 0) -> Stage:
    """Find the hand's places and make the motions, at most `instances`; a scene that is shown once has one.

    Raises TrajectoryError for a motion that this object does not allow, HhsimError where an instance has no place.
    """
    script = load_script(scenario.motion)
    if scenario.instances == 1:
        motions = [synthesize(script, hand, tree, seed).resampled(RATE)]
    else:
        durations = [SHORT_PHASES.get(phase.name, SHORT_CLOSING) for phase in script.phases]
        shorter = zip(script.phases, durations)
        phases = tuple(structs.replace(phase, duration=time) for phase, time in shorter if time > 0.0)
        script = structs.replace(script, phases=phases, start_distance=SHORT_WAY)
        places = _places(scenario, script, hand, tree, seed)
        count = min(instances, scenario.instances)
        motions = [_instance(scenario, script, hand, tree, places) for _ in range(count)]
    return Stage(scenario, script, hand, tree, tuple(motions))


def held_ticks(stage: Stage) -> BoolArray:
    """Return the ticks of the holds of all motions, shape (T,)."""
    return np.concatenate([ticks_of(motion, "hold") for motion in stage.motions])


def ticks_of(motion: TickInput, *phases: str) -> BoolArray:
    """Return the ticks of a motion in the phases of these names, shape (T,)."""
    inside = np.zeros(motion.tick_count, bool)
    for phase in motion.phases:
        inside[phase.first_tick : phase.last_tick + 1] = phase.name in phases
    return inside


def hold_distances(
    script: Script, object_name: str, hand: HandModel, tree: SphereTree, ticks: TickInput, record: TickRecord
) -> list[FloatArray]:
    """Return for each hold the distance of each demanded touch at its last tick [m]; see `touch_distances`."""
    found = []
    holds = [phase.last_tick for phase in ticks.phases if phase.name == "hold"]
    rotation = np.empty((3, 3))
    for tick, touches in zip(holds, script.hold_touches, strict=True):
        quaternion_to_matrix(record.orientation[tick].copy(), rotation)
        shown = (record.joints[tick], record.position[tick], rotation)
        found.append(touch_distances(touches, object_name, hand, tree, *shown))
    return found


def check_holds(
    script: Script, object_name: str, hand: HandModel, tree: SphereTree, motion: Trajectory, options: SolverOptions
) -> list[FloatArray]:
    """Play a motion at 1 kHz and return its `hold_distances`."""
    ticks = motion.resampled(RATE)
    record = HandSolver(hand, tree.arrays(), options).run(*HandConfiguration.of(ticks))
    return hold_distances(script, object_name, hand, tree, ticks, record)


def _instance(
    scenario: Scenario, script: Script, hand: HandModel, tree: SphereTree, places: Iterator[Placement]
) -> TickInput:
    """A motion whose hold by `coupled` touches all that it names.

    Fingers that reach while the palm is held may not all touch once the palm yields.
    """
    for place in itertools.islice(places, TRIES):
        motion = synthesize(script, hand, tree, placement=place)
        held = check_holds(script, scenario.object_name, hand, tree, motion, SolverOptions())
        if all((distances < TOUCHING).all() for distances in held):
            return motion.resampled(RATE)
    raise HhsimError(f"{scenario.name}: no place found for an instance in {TRIES} tries where the hold touches")


def _places(scenario: Scenario, script: Script, hand: HandModel, tree: SphereTree, seed: int) -> Iterator[Placement]:
    """Places around the script's own, from which every named finger reaches the object, and the palm if named."""
    best = planned(script, hand, tree)
    closer = Closer(script, hand, tree)
    random = np.random.default_rng([seed, *scenario.name.encode()])
    zero = Placement("", np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    # Flexion of the open fingers' first joints beyond the widest opening [rad].
    opened = np.asarray((best.open - closer.opened(zero))[:, 0] / closer.rates[:, 0])
    while True:
        for _ in range(TRIES):
            angle = TURN * random.standard_normal(3)
            turned = quaternion_from_matrix(rotation_matrix(quaternion(angle)) @ best.rotation)
            position = best.position + SHIFT * random.standard_normal(3)
            place = Placement("", position, turned, best.back, opened, best.abduction)
            closure = closer.close(place)
            # The open hand is free of the object there.
            near = body_distances(closure.position, closure.rotation, closure.open, closure.abduction, closer.work)
            clear = closure.reached == script.fingers and near.min() >= 0.0
            if clear and (script.palm_depth == 0.0) == (closure.distance[PALM_BODY] >= 0.0):
                break
        else:
            raise HhsimError(f"{scenario.name}: no place found for an instance in {TRIES} tries")
        yield place


Times = NDArray[np.float32]
"""Times of millions of ticks, to a nanosecond in ten milliseconds."""
INDEX = FINGERS.index("index")
STEPS = ("posture_jump_max", "posture_jump_p999", "force_contact_step", "force_contact_step_share")
"""Figures of the paper's criterion that nothing jumps between two adjacent ticks (Section V, 2)."""

COUNTS = 4096
"""Counts a turn of a 12-bit sensor."""
GLOVE_RATE = 200.0
"""Sample rate of a glove such as the paper's [Hz]."""
GLOVE = Disturbance(sensor_counts=COUNTS, sensor_noise=0.25 * 2.0 * math.pi / COUNTS)
"""Noise of a glove on a still hand: one count of a 12-bit sensor. The paper moved the palm by keys."""
NOISES: dict[str, tuple[Disturbance, float | None]] = {
    "glove": (GLOVE, GLOVE_RATE),
    "trembling": (replace(TREMOR, sensor_counts=GLOVE.sensor_counts, sensor_noise=GLOVE.sensor_noise), GLOVE_RATE),
}
"""Noises of a repeated hold: sensors of the glove alone, and with tremor of the palm."""
UNTOLD = "posture_jump_untold"
"""Largest posture jump of the ticks that neither are nor follow one whose status tells a snap or a lag."""
BISECTIONS = 10
"""Bisections of the margin that gives a number of contacts."""
CARRIES = 0.25
"""Least share of its force of a component that is measured (three equal ones have 0.58 each): a nearly zero one varies
by large shares of itself. The medians over all holds differ by 0.06 % at most from 0.1 to 0.5."""


class Moment(NamedTuple):
    """Name of a picture, the hands that it shows, and their forces [N]."""

    name: str
    graphic: HandConfiguration
    haptic: HandConfiguration
    fingertip: FloatArray  # normal force at each fingertip, shape (5, 3)
    index_finger: FloatArray  # contact force on each phalanx of the index finger, shape (3, 3)


class Curves(NamedTuple):
    """Forces tick by tick [N]: size of the normal force at each fingertip (T, 5), force on the index finger (T, 3)."""

    fingertip: FloatArray
    index_finger: FloatArray


@dataclass(eq=False)
class SceneRun:
    """A scene played by one method; ticks are those of all motions, one after the other.

    A run of many instances keeps no poses and forces: they would be gigabytes.
    """

    stage: Stage
    options: SolverOptions
    candidates: NDArray[np.int32]  # number of candidate pairs, shape (T,)
    digest: str  # of the poses and forces
    shown: list[Moment]  # ends of the holds and middles of the slides, in order; none for instances
    curves: Curves | None  # forces; None for instances
    contact: BoolArray  # ticks with candidate pairs while fingers close, hold or slide, shape (T,)
    depth: FloatArray  # penetration of the object's spheres at each tick [m], shape (T,)
    touches: list[tuple[Touch, float]]  # demanded touches and their distances [m], at every hold of every motion
    steps: dict[str, float]  # figures of STEPS and UNTOLD: how far hand and force go in a tick
    # Change of the index finger's force from tick to tick in the first hold [%], by the names of NOISES; none for
    # instances. Of its size and its components, mean and standard deviation, NaN for small ones, shape (4, 2).
    variation: dict[str, FloatArray]
    # Times of every tick [s], shape (T, 6), an array a repetition: CPU, wall, detection, palm, fingers, force.
    times: list[Times] = field(default_factory=list)

    case: str = ""  # case of Fig. 15 whose number of contacts the margin of the options gives
    wanted: float = math.nan  # number of contacts that the paper names

    @property
    def scenario(self) -> Scenario:
        """Scenario of the stage."""
        return self.stage.scenario

    @cached_property
    def median_times(self) -> FloatArray:
        """Times of each tick, the medians of the repetitions [s], shape (T, 6)."""
        return np.median(self.times, axis=0).astype(np.float64)

    @property
    def tick_cpu(self) -> FloatArray:
        """CPU time of each tick [s], shape (T,)."""
        return self.median_times[:, 0]

    @property
    def tick_parts(self) -> FloatArray:
        """Wall times of detection, palm, fingers and force of each tick [s], shape (T, 4)."""
        return self.median_times[:, 2:]

    @property
    def undisturbed(self) -> BoolArray:
        """Ticks in contact that were not interrupted, shape (T,): only wall times are known of the parts of a tick."""
        return self.contact & (self.median_times[:, 1] <= 1.5 * self.tick_cpu + 5e-6)

    @property
    def contacts(self) -> float:
        """Mean number of candidate pairs of the ticks in contact, those that have the times; NaN without one."""
        return float(self.candidates[self.contact].mean()) if self.contact.any() else math.nan

    @property
    def missed(self) -> list[tuple[Touch, float]]:
        """Demanded touches that did not happen, and their distances [m]."""
        return [(touch, distance) for touch, distance in self.touches if not distance < TOUCHING]


def play(stage: Stage, options: SolverOptions) -> SceneRun:
    """Play a scene for the first time and measure everything; HhsimError if the solver cannot hold its contacts."""
    records = _run(stage, options)
    record = joined_record(records)
    names = {phase.name for motion in stage.motions for phase in motion.phases} - {"approach", "release"}
    acting = np.concatenate([ticks_of(motion, *names) for motion in stage.motions])
    touches = []
    for motion, one in zip(stage.motions, records):
        found = hold_distances(stage.script, stage.scenario.object_name, stage.hand, stage.tree, motion, one)
        for demanded, distances in zip(stage.script.hold_touches, found):
            touches += list(zip(demanded, distances.tolist()))
    variation: dict[str, FloatArray] = {}
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
        digest=digest_of(record),
        shown=_shown(stage, records[0]) if single else [],
        curves=curves,
        contact=acting & (record.work[:, WORK_CANDIDATES] > 0),
        # 0 - x and not -x: a free hand has depth 0, not minus 0.
        depth=np.maximum(0.0, 0.0 - hand_clearance(stage.hand, stage.arrays, placed_of(record), 0.0)),
        touches=touches,
        steps=_steps(stage, options, record),
        variation=variation,
    )
    _keep_times(run, record)
    return run


def play_again(run: SceneRun) -> None:
    """Play a scene once more, for its times; HhsimError if the poses are not those of the first time."""
    record = joined_record(_run(run.stage, run.options))
    if digest_of(record) != run.digest:
        raise HhsimError(
            f"{run.scenario.name}, {run.options.method}: a repetition gave another hand; please report this"
        )
    _keep_times(run, record)


def at_contacts(stage: Stage, options: SolverOptions, case: str, wanted: float) -> SceneRun:
    """Return the run of a stage's first motion whose hold has about `wanted` candidate pairs by its margin.

    A wider margin lets more candidate pairs in, which costs time and changes nothing else. Found by bisection.
    """
    one = replace(stage, motions=stage.motions[:1])
    held = held_ticks(one)
    low, high = 1e-4, 2e-2
    best: tuple[float, float] | None = None
    for _ in range(BISECTIONS):
        margin = math.sqrt(low * high)
        try:
            (record,) = _run(one, replace(options, margin=margin))
        except HhsimError:
            high = margin
            continue
        count = float(record.work[held, WORK_CANDIDATES].mean())
        if best is None or abs(count - wanted) < abs(best[0] - wanted):
            best = count, margin
        low, high = (margin, high) if count < wanted else (low, margin)
    if best is None:
        raise HhsimError(f"{stage.scenario.name}: no margin is small enough for the solver")
    return replace(play(one, replace(options, margin=best[1])), case=case, wanted=wanted)


def joined_record(records: list[TickRecord]) -> TickRecord:
    """Return the ticks of several runs, one after the other."""
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


def _steps(stage: Stage, options: SolverOptions, record: TickRecord) -> dict[str, float]:
    """Return the largest steps of shown hand and force from tick to tick, by the names of STEPS, and UNTOLD's."""
    columns: dict[str, AnyArray] = {
        "contacts/touching": record.work[:, WORK_TOUCHING],
        "force/phalanx": record.phalanx,
        "force/total": record.total,
        "graphic/joints": record.joints,
    }
    user = [forward_kinematics(stage.hand, *HandConfiguration.of(motion)).joints for motion in stage.motions]
    begins = np.zeros(len(record.total), bool)
    begins[np.cumsum([0, *map(len, user)])[:-1]] = True
    run = RunTicks(columns, len(begins), (), RATE, len(options.fingers), breaks=begins, user=np.concatenate(user))
    told = (record.status & (STATUS_SNAP | STATUS_LAG)) != 0
    told[1:] |= told[:-1]
    untold = run_figure("posture_jump_max", replace(run, breaks=begins | told))
    return {name: run_figure(name, run) for name in STEPS} | {UNTOLD: untold}


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
        hands = HandConfiguration.of(record).at(t), HandConfiguration.of(motion).at(t)
        found.append(Moment(name, *hands, record.fingertip_normal[t], record.phalanx[t, INDEX]))
    return found


def _keep_times(run: SceneRun, record: TickRecord) -> None:
    times = np.column_stack([record.duration_cpu, record.duration_total, record.duration])
    run.times.append((1e-9 * times).astype(np.float32))
    run.__dict__.pop("median_times", None)


def _variation(
    stage: Stage, options: SolverOptions, record: TickRecord, noise: Disturbance, sample_rate: float | None
) -> FloatArray:
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
    # A component that is rarely large enough tells nothing about the hold.
    component[:, np.isfinite(component).mean(axis=0) <= 0.5] = np.nan

    def mean_std(values: FloatArray) -> FloatArray:
        defined = values[np.isfinite(values)]
        return np.array([defined.mean(), defined.std()]) if defined.size else np.full(2, np.nan)

    return np.array([mean_std(values) for values in (size, *component.T)])


class PaperRuns(tuple[SceneRun, ...]):
    """Runs by scene, then by method; last those with the numbers of contacts that the paper names, of a `case`."""

    def of(self, method: str, *figures: str, object_name: str | None = None, case: str | None = None) -> list[SceneRun]:
        """Return the runs of a method in some figures, but for those of a number of contacts."""
        return [
            run
            for run in self
            if not run.case
            and run.options.method == method
            and run.scenario.figure in figures
            and object_name in (None, run.scenario.object_name)
            and case in (None, run.scenario.case)
        ]


def percentile(run: SceneRun, share: float) -> float:
    """Return a percentile of the thread time of a run's ticks in contact [s]; NaN without any."""
    times = run.tick_cpu[run.contact]
    return float(np.percentile(times, share)) if times.size else float("nan")
