"""Where an object has to stand so that a recorded hand touches it: a recording has no object of ours.

The named finger has one moment at which its tip is farthest along its stroke (the main direction of its way, towards
the palm's side). There the object is set before it: upright, in some turn about the vertical, somewhere across the
stroke, and so near that the tip is commanded `depth` deeper than first contact. Of the candidates the best is the one
whose other bodies keep out of the way; a hand that would start in the object is no candidate. Nothing is random.
"""

from itertools import product
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, PHALANX_COUNT
from hhsim.motion.trajectory import Trajectory
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.system.settings_file import Settings, one_of
from hhsim.trees.sphere_tree import SphereTree

TURNS = 12
"""Turns about the vertical that are tried."""
ACROSS = (-0.4, -0.2, 0.0, 0.2, 0.4)
"""Places of the stroke across the object, as shares of its width."""
LOOKS = 24
"""Samples of the recording at which a candidate is looked at."""
START_GAP = 0.002
"""The hand begins at least this far from the object [m]."""
WANTED_GAP = 0.01
"""Bodies that are to keep out of the way are out of it at this distance [m]."""
PRESSED = 0.4
"""The tip has to get this share of the depth into the object: else it grazes it."""
FAR = 1e3
"""A gap below minus this [m] never stops a body."""


class Wanted(Settings, frozen=True):
    """What the recording is to do to the object.

    Attributes:
        finger: That touches it.
        depth: How much deeper than first contact its tip is commanded [m].
    """

    finger: Annotated[str, one_of(FINGERS)]
    depth: Annotated[float, Meta(gt=0.0, le=0.1, description="a number above 0, up to 0.1 m")]


class _Best(NamedTuple):
    """A placement in the object's frame: the hand's shift, the object's turn, how far others keep away in the mean."""

    shift: FloatArray
    turn: float
    score: float


def place_object(motion: Trajectory, hand: HandModel, tree: SphereTree, wanted: Wanted) -> Trajectory:
    """The motion beside the object.

    Args:
        motion: Of a hand, without regard for its object pose.
        tree: The object at rest in its own frame, z up.
        wanted: What is to be touched, by what.

    Raises:
        TrajectoryError: Nowhere does the finger reach the object without the hand beginning in it.
    """
    finger = FINGERS.index(wanted.finger)
    placed = forward_kinematics(hand, *HandConfiguration.of(motion))
    tips = placed.joints[:, finger, 3]
    stroke, moment = _stroke(tips, motion)
    best = _search(motion, hand, tree, finger, stroke, moment, wanted.depth)
    if best is None:
        raise TrajectoryError(
            f"{motion.name or 'the motion'} cannot be placed at this object: nowhere does its {wanted.finger} finger "
            "reach it without the hand beginning in it"
        )
    turn = quaternion(np.array([0.0, 0.0, best.turn]))
    # In the object's frame a point is Rᵀ p + shift, so the object's own origin is at -R shift.
    return motion.placed(-(rotation_matrix(turn) @ best.shift), turn)


def _stroke(tips: FloatArray, motion: Trajectory) -> tuple[FloatArray, int]:
    """Unit direction of a fingertip's main way, towards the palm's side, and the sample that is farthest along it."""
    off = tips - tips.mean(axis=0)
    direction = np.linalg.svd(off, full_matrices=False)[2][0]
    inwards = -rotation_matrix(motion.orientation)[:, :, 2].mean(axis=0)
    if direction @ inwards < 0.0:
        direction = -direction
    return direction, int(np.argmax(off @ direction))


def _search(
    motion: Trajectory,
    hand: HandModel,
    tree: SphereTree,
    finger: int,
    stroke: FloatArray,
    moment: int,
    depth: float,
) -> _Best | None:
    arrays, nodes, work = hand.arrays(), tree.arrays(), make_work()
    looks = np.unique(np.concatenate([np.linspace(0, motion.sample_count - 1, LOOKS).round().astype(int), [moment]]))
    here = int(np.flatnonzero(looks == moment)[0])
    flexion = [np.ascontiguousarray(values) for values in motion.flexion[looks]]
    abduction = [np.ascontiguousarray(values) for values in motion.abduction[looks]]
    joints = hand.joints(motion.position[moment], motion.orientation[moment], flexion[here], abduction[here])
    center, radius = tree.leaf_center, tree.leaf_radius
    low, high = (center - radius[:, None]).min(axis=0), (center + radius[:, None]).max(axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    tip_body = PHALANX_COUNT * finger + PHALANX_COUNT - 1
    gap = np.full(BODY_COUNT, -FAR)
    gap[tip_body] = 0.0
    others = np.array([body for body in range(BODY_COUNT) if body // PHALANX_COUNT != finger])
    best: _Best | None = None
    for step in range(TURNS):
        turn = 2.0 * np.pi * step / TURNS
        back = rotation_matrix(quaternion(np.array([0.0, 0.0, turn]))).T
        direction = np.ascontiguousarray(back @ stroke)
        rotations = [np.ascontiguousarray(back @ rotation_matrix(q)) for q in motion.orientation[looks]]
        positions = motion.position[looks] @ back.T
        tip = back @ joints[finger, 3]
        side = across(direction)
        for a, b in product(ACROSS, ACROSS):
            goal = middle + (np.array([a, b]) * (np.abs(side) @ (high - low))) @ side
            start = positions[here] - tip + goal - size * direction
            travel, body = kernel.advance_hand(
                arrays, nodes, start, rotations[here], flexion[here], abduction[here], direction, gap, 2.0 * size, work
            )
            if body != tip_body:
                continue
            shift = goal - tip + (travel + depth - size) * direction
            poses = [
                (np.ascontiguousarray(p + shift), r, f, b)
                for p, r, f, b in zip(positions, rotations, flexion, abduction)
            ]
            # Most places fail at one of these two moments.
            first, pressed = (body_distances(arrays, nodes, *poses[i], work) for i in (0, here))
            if first.min() < START_GAP or pressed[tip_body] > -PRESSED * depth:
                continue
            distance = np.stack([body_distances(arrays, nodes, *pose, work) for pose in poses])
            score = float(np.minimum(distance[:, others], WANTED_GAP).mean())
            if best is None or score > best.score + 1e-12:
                best = _Best(shift, turn, score)
    return best


def across(direction: FloatArray) -> FloatArray:
    """Two unit vectors across a direction and each other, shape (2, 3)."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])
