"""Trajectory of a script: minimum-jerk motion between the poses that closing the hand on the object has found.

In a `carry` hand and object move together. In a lift, a move, a shake and a turn the hand alone is commanded; a free
object follows as friction has it.
"""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix
from hhsim.motion.trajectory import ObjectMotion, Phase, RigidMotion, Trajectory
from hhsim.reproducible import sine_and_cosine
from hhsim.scene.closure_search import OtherHand, level, plan_finger_closure
from hhsim.scene.finger_closure import Closer, FingerClosure, find_placement
from hhsim.scene.script import DEFAULT_FINGERS, TAKE_ALONG, Placement, Script, ScriptPhase
from hhsim.trees.sphere_tree import SphereTree

RELEASE_OPENING = 0.6
"""A release opens the fingers in this first share of its duration and retreats in the last share of the same length."""

USUAL_CYCLES = 4.0
"""Cycles of a shake that states none."""
END = 1e-9
"""A sample this near to the end of a phase, as a share of its duration, is at the end."""


def minimum_jerk(share: ArrayLike) -> FloatArray:
    """Return 10τ³ − 15τ⁴ + 6τ⁵ for τ in [0, 1], 0 before and 1 after: no jumps in speed and acceleration."""
    tau = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return np.asarray(tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0)))


def to_and_fro(share: ArrayLike, cycles: float) -> FloatArray:
    """Return sin²(πτ) sin(2πnτ) for τ in [0, 1] and n cycles, else 0: an oscillation that starts and ends at rest."""
    tau = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return np.asarray(sine_and_cosine(np.pi * tau)[0] ** 2 * sine_and_cosine(2.0 * np.pi * cycles * tau)[0])


def _about(angle: FloatArray, pivot: FloatArray, place: FloatArray) -> RigidMotion:
    """Rotation by vectors [rad] about a pivot (3,) that moves to a place; one row a sample."""
    turn = quaternion(angle)
    return RigidMotion(turn, place - RigidMotion(turn, np.zeros_like(place)).points(np.tile(pivot, (len(turn), 1))))


def synthesize(
    script: Script,
    hand: HandModel,
    tree: SphereTree,
    seed: int = 0,
    *,
    placement: Placement | None = None,
    other: OtherHand | None = None,
) -> Trajectory:
    """Make the trajectory of a script on an object at rest (`tree`, world); the same arguments give the same bytes.

    `seed` is of tremor and sensor noise; the motion itself is the same for every seed. Further arguments and errors as
    for `planned`.
    """
    closure = planned(script, hand, tree, placement, other)
    time = np.arange(script.sample_count) / script.rate
    # Two hands take what they hold along as the first one goes.
    leading = closure if other is None else other.closure
    course = Course(script, time, hand.side, leading.rotation, tree.bounds.mean(axis=0))
    position = closure.position + course.retreat[:, None] * closure.back + course.slide[:, None] * closure.slide
    command = closure.command + course.ease[:, None, None] * (closure.contact - closure.command)
    flexion = closure.open + course.closure[:, :, None] * (command - closure.open)
    orientation = np.tile(quaternion_from_matrix(closure.rotation), (len(time), 1))
    position, orientation, flexion = script.disturbance.apply(seed, time, position, orientation, flexion)
    if (taken := course.taken) is not None:
        position, orientation = taken.points(position), taken.orientations(orientation)
    object_motion = None
    if (moved := course.carried) is not None:
        position, orientation = moved.points(position), moved.orientations(orientation)
        place, turn = np.zeros((len(time), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
        object_motion = ObjectMotion(moved.points(place), moved.orientations(turn))
    origin = [f"hhsim script '{script.name}' for a {hand.side} hand of {1000.0 * hand.hand_length:.0f} mm"]
    if closure.missed:
        origin.append(f"fingers that do not reach this object: {', '.join(closure.missed)}")
    if not script.disturbance.is_off:
        origin.append(f"{script.disturbance}, seed {seed}")
    return Trajectory(
        time=time,
        position=position,
        orientation=orientation,
        object_motion=object_motion,
        flexion=flexion,
        abduction=np.tile(closure.abduction, (len(time), 1)),
        phases=course.phases,
        name=script.name,
        source="; ".join(origin),
        licence="Apache-2.0",
    )


def planned(
    script: Script,
    hand: HandModel,
    tree: SphereTree,
    placement: Placement | None = None,
    other: OtherHand | None = None,
) -> FingerClosure:
    """Return the closed hand: at the given place, at the script's own on this object, or where a search finds the best.

    `other` is a hand beside which this one finds its place. Raises TrajectoryError for a script that cannot be done on
    this object.
    """
    if placement is None:
        placement = find_placement(script, hand, tree)
    if placement is None:
        return plan_finger_closure(script, hand, tree, other)
    closure = Closer(script, hand, tree).close(placement)
    closure.require_touch(script, "the object from its place")
    return closure


class Course:
    """Motion of a hand by a script at each sample, time [s] of shape (T,), and the phases.

    Attributes:
        retreat, slide, closure, ease: Of the hand, from and to the object at rest.
        carried: Common motion of hand and object in the carries; None without a carry.
        taken: Motion of the hand in the lifts, moves, shakes and turns; None without any. A lift goes straight up, a
            shake across the palm, and a turn is about the direction of the fingers through the middle [m], shape (3,),
            of the object at rest; the last two directions are made level. `rotation` is of the closed hand, palm to
            world, shape (3, 3).
    """

    def __init__(self, script: Script, time: FloatArray, side: Side, rotation: FloatArray, middle: FloatArray) -> None:
        count = len(time)
        self.retreat = np.full(count, script.start_distance)
        self.slide, self.ease = np.zeros(count), np.zeros(count)
        self.closure = np.zeros((count, len(FINGERS)))
        self.phases: tuple[Phase, ...] = ()
        self._heading, self._arc = np.zeros(count), np.zeros((count, 3))
        self._angle, self._place = np.zeros(count), np.tile(middle, (count, 1))
        self._across, ahead = level(rotation[:, 0], rotation[:, 1]), level(rotation[:, 1], rotation[:, 0])
        start = 0.0
        for phase in script.phases:
            # Below 0 before, above 1 after it. A sample at the end has a share of exactly 1, whatever rounding makes of
            # its stamp: a hold stands still.
            share = (time - start) / phase.duration
            share[np.abs(share - 1.0) < END] = 1.0
            if phase.hand in (None, side):
                self._play(script, phase, share)
            self.phases += (Phase(phase.name, start, start + phase.duration),)
            start += phase.duration
        upright = np.stack([np.zeros(count), np.zeros(count), self._heading], axis=1)
        self.carried = _about(upright, np.zeros(3), self._arc) if script.has("carry") else None
        self.taken = _about(self._angle[:, None] * ahead, middle, self._place) if script.has(*TAKE_ALONG) else None

    def _play(self, script: Script, phase: ScriptPhase, share: FloatArray) -> None:
        way, distance, turn = minimum_jerk(share), phase.distance or 0.0, phase.turn or 0.0
        if phase.name == "approach":
            self._move(self.retreat, -script.palm_depth, way)
        elif phase.name in DEFAULT_FINGERS:
            closed = np.array([float(finger in phase.fingers) for finger in FINGERS])
            self._move(self.closure, closed, way[:, None])
            self._move(self.ease, 0.0, way)
        elif phase.name in ("slide", "push"):
            self.slide += distance * way
        elif phase.name == "slip":
            self._move(self.ease, 1.0, way)
        elif phase.name == "release":
            self._move(self.closure, np.zeros(len(FINGERS)), minimum_jerk(share / RELEASE_OPENING)[:, None])
            going = minimum_jerk((share - 1.0 + RELEASE_OPENING) / RELEASE_OPENING)
            self._move(self.retreat, script.start_distance, going)
        elif phase.name == "carry":
            # Every later sample stands at the end of the arc, until another arc goes on from there.
            turned = turn * way
            # Chord and middle heading of the arc so far; a straight line has no half turn to divide by.
            half = 0.5 * turned
            straight = half == 0.0
            ratio = np.where(straight, 1.0, sine_and_cosine(half)[0] / np.where(straight, 1.0, half))
            sine, cosine = sine_and_cosine(self._heading[-1] + half)
            direction = np.stack([cosine, sine, np.zeros(len(share))], axis=1)
            self._arc += (distance * way * ratio)[:, None] * direction
            self._heading += turned
        elif phase.name == "lift":
            self._place += (distance * way)[:, None] * [0.0, 0.0, 1.0]
        elif phase.name == "move":
            self._place += way[:, None] * np.array(phase.way)
        elif phase.name == "shake":
            self._place += (distance * to_and_fro(share, phase.cycles or USUAL_CYCLES))[:, None] * self._across
        elif phase.name == "turn":
            self._angle += turn * way

    @staticmethod
    def _move(values: FloatArray, target: ArrayLike, share: FloatArray) -> None:
        """Move from the value at the last sample to `target`, in place."""
        values += share * (np.asarray(target) - values[-1])
