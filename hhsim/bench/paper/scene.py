"""What a scene of the paper's evaluation is played on: object, hand, and the hand's motion.

A scene of Fig. 15 has many short motions, each with the hand a little elsewhere; the others have one, as long as it is.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.paper.contact_check import check_holds
from hhsim.bench.paper.scenarios import Scenario
from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.motion.trajectory import TickInput
from hhsim.scene.closure_at_pose import PlacedCloser
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.finger_closure import FingerClosure, body_distances
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.script import Script, ScriptPhase
from hhsim.scene.stored_pose import Placement
from hhsim.scene.synthesis import planned, synthesize
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree

RATE = 1000.0
"""Ticks a second [Hz], as in the paper."""

SHIFT, TURN = 0.003, math.radians(3.0)
"""Instances vary the palm's place by this standard deviation [m] and [rad] in each axis."""
TRIES = 20
"""Places that are tried for an instance until one is found from which all named fingers reach; and of these, until one
is found where the hold really touches what it names."""
SHORT_WAY = 0.01
"""How far an instance begins from its place [m]."""
SHORT_PHASES = {"approach": 0.1, "hold": 0.1, "release": 0.0}
SHORT_CLOSING = 0.25
"""Phases of an instance [s]: it comes from nearby, closes as fast as a fist, holds, and the way back is left out."""


@dataclass(frozen=True, eq=False)
class Stage:
    """What a scene is played on.

    Attributes:
        script: Its motion.
        tree: The object at rest, its frame the world's.
        motions: The haptic hand, one motion or as many as there are instances.
    """

    scenario: Scenario
    script: Script
    hand: HandModel
    tree: SphereTree
    motions: tuple[TickInput, ...]

    @cached_property
    def arrays(self) -> TreeArrays:
        """The tree as the kernels take it."""
        return self.tree.arrays()


def make_stage(scenario: Scenario, hand: HandModel, tree: SphereTree, instances: int, seed: int = 0) -> Stage:
    """Find the hand's place, or places, and make the motions.

    Args:
        tree: The object.
        instances: Most motions; a scene that is shown once has one.
        seed: Of the instances' places.

    Raises:
        TrajectoryError: The motion cannot be done on this object.
        HhsimError: No place was found for an instance.
    """
    script = load_script(scenario.motion)
    count = min(instances, scenario.instances)
    if scenario.instances == 1:
        motions = [synthesize(script, hand, tree, seed).resampled(RATE)]
    else:
        script = _short(script)
        places = _places(scenario, script, hand, tree, seed)
        motions = [_instance(scenario, script, hand, tree, places) for _ in range(count)]
    return Stage(scenario, script, hand, tree, tuple(motions))


def held_ticks(stage: Stage) -> BoolArray:
    """Ticks of the holds of all motions, shape (T,)."""
    parts = []
    for motion in stage.motions:
        held = np.zeros(motion.tick_count, bool)
        for phase in motion.phases:
            if phase.name == "hold":
                held[phase.first_tick : phase.last_tick + 1] = True
        parts.append(held)
    return np.concatenate(parts)


def _short(script: Script) -> Script:
    """The same motion, quicker: comes from nearby, closes, holds."""
    phases: list[ScriptPhase] = []
    for phase in script.phases:
        duration = SHORT_PHASES.get(phase.name, SHORT_CLOSING)
        if duration > 0.0:
            phases.append(replace(phase, duration=duration))
    return replace(script, phases=tuple(phases), start_distance=SHORT_WAY)


def _instance(
    scenario: Scenario, script: Script, hand: HandModel, tree: SphereTree, places: Iterator[Placement]
) -> TickInput:
    """A motion whose hold touches all that it names, in the reference optimum (`coupled`).

    Where fingers reach while the palm is held, the palm may still give way to one and take another one off.
    """
    for place in itertools.islice(places, TRIES):
        motion = synthesize(script, hand, tree, placement=place)
        held = check_holds(script, scenario.object_name, hand, tree, motion, SolverOptions())
        if all((distances < TOUCHING).all() for distances in held):
            return motion.resampled(RATE)
    raise HhsimError(f"{scenario.name}: no place found for an instance in {TRIES} tries where the hold touches")


def _places(scenario: Scenario, script: Script, hand: HandModel, tree: SphereTree, seed: int) -> Iterator[Placement]:
    """Places around the script's own, from which every named finger reaches the object, and the palm if it is to."""
    best = planned(script, hand, tree)
    closer = PlacedCloser(script, hand, tree)
    random = np.random.default_rng([seed, *scenario.name.encode()])
    opened = _opening(closer, best)
    while True:
        for _ in range(TRIES):
            angle = TURN * random.standard_normal(3)
            turned = turned_by(angle) @ best.rotation
            place = Placement(
                "",
                best.position + SHIFT * random.standard_normal(3),
                quaternion_from_matrix(turned),
                best.back,
                opened,
                best.abduction,
            )
            closure = closer.close(place)
            clear = closure.reached == script.fingers and _clear(closer, closure)
            if clear and (script.palm_depth == 0.0) == (closure.distance[PALM_BODY] >= 0.0):
                break
        else:
            raise HhsimError(f"{scenario.name}: no place found for an instance in {TRIES} tries")
        yield place


def _opening(closer: PlacedCloser, closure: FingerClosure) -> FloatArray:
    """How far the open fingers' first joints are flexed beyond the widest [rad], shape (5,)."""
    zero = Placement("", np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    return np.asarray((closure.open - closer.opened(zero))[:, 0] / closer.rates[:, 0])


def _clear(closer: PlacedCloser, closure: FingerClosure) -> bool:
    """Whether the open hand is free of the object where the fingers close; a palm that is to touch may."""
    near = body_distances(
        *(closer.hand, closer.tree, closure.position, closure.rotation, closure.open, closure.abduction, closer.work)
    )
    return bool(near.min() >= 0.0)


def turned_by(rotation_vector: FloatArray) -> FloatArray:
    """Rotation matrix, shape (3, 3), about a rotation vector [rad], shape (3,)."""
    angle = float(np.linalg.norm(rotation_vector))
    x, y, z = rotation_vector / angle if angle > 0.0 else np.zeros(3)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)
