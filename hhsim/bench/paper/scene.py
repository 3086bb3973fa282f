"""Scenes of the paper's evaluation: object, hand and motions.

Scripts of the catalogue declare the figure and the objects of their motion. A scene of Fig. 15 has many short motions,
each with the hand a little elsewhere; the others have one whole motion.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import object_names
from hhsim.motion.trajectory import TickInput, Trajectory
from hhsim.scene.contact_goals import TOUCHING, touch_distances
from hhsim.scene.finger_closure import PlacedCloser, body_distances
from hhsim.scene.motion_catalogue import load_script, script_names
from hhsim.scene.script import Placement, Script
from hhsim.scene.synthesis import planned, synthesize
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
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
        phases = tuple(replace(phase, duration=time) for phase, time in zip(script.phases, durations) if time > 0.0)
        script = replace(script, phases=phases, start_distance=SHORT_WAY)
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
    closer = PlacedCloser(script, hand, tree)
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
