"""Trajectory of a script: minimum-jerk motion between the poses that closing the hand on the object has found."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.motion.object_motion import ObjectMotion
from hhsim.motion.trajectory import Phase, Trajectory
from hhsim.motion.tremor import Disturbance
from hhsim.scene.closure_at_pose import close_placed, find_placement
from hhsim.scene.closure_search import plan_finger_closure
from hhsim.scene.finger_closure import FingerClosure
from hhsim.scene.hand_moves import carried, minimum_jerk, phase_shares, taken_along
from hhsim.scene.script import DEFAULT_FINGERS, Script, ScriptPhase
from hhsim.scene.stored_pose import Placement
from hhsim.trees.sphere_tree import SphereTree

RELEASE_OPENING = 0.6
"""A release opens the fingers in this first share of its duration and retreats in the last share of the same length."""


def synthesize(
    script: Script,
    hand: HandModel,
    tree: SphereTree,
    seed: int = 0,
    *,
    disturbance: Disturbance | None = None,
    placement: Placement | None = None,
    object_position: ArrayLike = (0.0, 0.0, 0.0),
    object_orientation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
) -> Trajectory:
    """Make the trajectory of a script on an object at rest (`tree`, world); the same arguments give the same bytes.

    Args:
        seed: Seed of tremor and sensor noise; the motion itself is the same for every seed.
        disturbance: Replaces the script's own.
        placement: Replaces the script's own, or a search.
        object_position: Recorded with the motion [m], shape (3,); `tree` is already there.
        object_orientation: Recorded with the motion (w, x, y, z), shape (4,).

    Raises:
        TrajectoryError: The script cannot be done on this object.
    """
    closure = planned(script, hand, tree, object_position, object_orientation, placement)
    time = np.arange(script.sample_count) / script.rate
    course = _Course(script, time)
    position = closure.position + course.retreat[:, None] * closure.back + course.slide[:, None] * closure.slide
    command = closure.command + course.ease[:, None, None] * (closure.contact - closure.command)
    flexion = closure.open + course.closure[:, :, None] * (command - closure.open)
    orientation = np.tile(quaternion_from_matrix(closure.rotation), (time.shape[0], 1))
    abduction = np.tile(closure.abduction, (time.shape[0], 1))
    noise = disturbance if disturbance is not None else script.disturbance
    position, orientation, flexion = noise.apply(seed, time, position, orientation, flexion)
    taken = taken_along(script, time, closure.rotation, tree.bounds.mean(axis=0))
    if taken is not None:
        position, orientation = taken.points(position), taken.orientations(orientation)
    moved = carried(script, time, np.asarray(object_position, dtype=np.float64))
    object_motion = None
    if moved is not None:
        position, orientation = moved.points(position), moved.orientations(orientation)
        places = (np.tile(values, (time.shape[0], 1)) for values in (object_position, object_orientation))
        object_motion = ObjectMotion(moved.points(next(places)), moved.orientations(next(places)))
    return Trajectory(
        time=time,
        position=position,
        orientation=orientation,
        object_motion=object_motion,
        flexion=flexion,
        abduction=abduction,
        phases=course.phases,
        object_position=np.asarray(object_position, dtype=np.float64),
        object_orientation=np.asarray(object_orientation, dtype=np.float64),
        name=script.name,
        source=_source(script, closure, hand, seed, noise),
        licence="Apache-2.0",
    )


def planned(
    script: Script,
    hand: HandModel,
    tree: SphereTree,
    object_position: ArrayLike = (0.0, 0.0, 0.0),
    object_orientation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    placement: Placement | None = None,
) -> FingerClosure:
    """Return the closed hand: at the given place, at the script's own on this object, or where a search finds the best.

    Arguments and errors as for `synthesize`.
    """
    if placement is None:
        placement = find_placement(script, hand, tree)
    if placement is None:
        return plan_finger_closure(script, hand, tree)
    rotation = np.empty((3, 3))
    quaternion_to_matrix(np.array(object_orientation, dtype=np.float64), rotation)
    return close_placed(script, hand, tree, placement, np.asarray(object_position, dtype=np.float64), rotation)


def _source(script: Script, closure: FingerClosure, hand: HandModel, seed: int, noise: Disturbance) -> str:
    parts = [f"hhsim script '{script.name}' for a {hand.side} hand of {1000.0 * hand.hand_length:.0f} mm"]
    if closure.missed:
        parts.append(f"fingers that do not reach this object: {', '.join(closure.missed)}")
    if not noise.is_off:
        parts.append(f"{noise}, seed {seed}")
    return "; ".join(parts)


class _Course:
    """Retreat, slide, closure and easing of the hand at each sample, and the phases."""

    def __init__(self, script: Script, time: FloatArray) -> None:
        count = time.shape[0]
        self.retreat = np.full(count, script.start_distance)
        self.slide = np.zeros(count)
        self.closure = np.zeros((count, len(FINGERS)))
        self.ease = np.zeros(count)
        self.phases: tuple[Phase, ...] = ()
        for phase, start, share in phase_shares(script, time):
            self._play(script, phase, share)
            self.phases += (Phase(phase.name, start, start + phase.duration),)

    def _play(self, script: Script, phase: ScriptPhase, share: FloatArray) -> None:
        if phase.name == "approach":
            self._move(self.retreat, -script.palm_depth, minimum_jerk(share))
        elif phase.name in DEFAULT_FINGERS:
            closed = np.array([float(finger in phase.fingers) for finger in FINGERS])
            self._move(self.closure, closed, minimum_jerk(share)[:, None])
            self._move(self.ease, 0.0, minimum_jerk(share))
        elif phase.name in ("slide", "push"):
            self.slide += phase.distance * minimum_jerk(share)
        elif phase.name == "slip":
            self._move(self.ease, 1.0, minimum_jerk(share))
        elif phase.name == "release":
            self._move(self.closure, np.zeros(len(FINGERS)), minimum_jerk(share / RELEASE_OPENING)[:, None])
            going = minimum_jerk((share - 1.0 + RELEASE_OPENING) / RELEASE_OPENING)
            self._move(self.retreat, script.start_distance, going)

    @staticmethod
    def _move(values: FloatArray, target: ArrayLike, share: FloatArray) -> None:
        """Move from the value at the last sample to `target`, in place."""
        values += share * (np.asarray(target) - values[-1])
