"""Demonstrations: a recording of a real hand, and the finger of it that is to touch whichever object.

A TOML file beside the recording::

    title = "Finger tap, recorded"
    stresses = "a real hand at 54 Hz: …"
    recording = "finger-tap.h5"     # beside this file: .h5 or .csv, as hhsim import writes them

    [touch]
    finger = "index"
    depth = 0.015                   # its tip is commanded this much deeper than first contact [m]

`notice` and `package` say where the recording comes from; nothing reads them.

At the moment when the fingertip is farthest along its stroke (the main direction of its path, towards the palm's side)
the object is set before it: upright, at some turn about the vertical and offset across the stroke, so near that the tip
is commanded `depth` deeper than first contact. The candidate whose other bodies keep the largest distance wins; a hand
that would start in the object is no candidate. Nothing is random.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.resources import as_file
from importlib.resources.abc import Traversable
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

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
from hhsim.motion.file import load_trajectory
from hhsim.motion.trajectory import HandSide, Trajectory
from hhsim.reproducible import across, dot, matmul, norm, principal_axes
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.system.settings_file import Settings, one_of, parse_settings
from hhsim.trees.sphere_tree import SphereTree

TURNS = 12
"""Number of turns about the vertical."""
ACROSS = (-0.4, -0.2, 0.0, 0.2, 0.4)
"""Offsets of the stroke across the object, as shares of its width."""
LOOKS = 24
"""Number of samples of the recording at which a candidate is evaluated."""
START_GAP = 0.002
"""Least distance [m] of the hand at the start."""
WANTED_GAP = 0.01
"""Distance [m] at which other bodies count as clear."""
PRESSED = 0.4
"""Least share of the depth that the tip must reach: less is a graze."""
FAR = 1e3
"""A gap of minus this [m] never stops a body."""


class Wanted(Settings, frozen=True):
    """Touch that the recording is to make: the finger, and its tip's commanded depth beyond first contact [m]."""

    finger: Annotated[str, one_of(FINGERS)]
    depth: Annotated[float, Meta(gt=0.0, le=0.1, description="a number above 0, up to 0.1 m")]


@dataclass(frozen=True)
class Demonstration:
    """A recorded motion that touches any object; the recording's own object pose is ignored.

    It has a title, what it stresses, and the finger that touches, with its depth.
    """

    motion: Trajectory
    touch: Wanted
    title: str = ""
    stresses: str = ""

    @property
    def name(self) -> str:
        """Name of the motion."""
        return self.motion.name

    @property
    def hand(self) -> HandSide:
        """Side of the hand that was recorded."""
        return self.motion.hand

    def placed(self, hand: HandModel, tree: SphereTree) -> Trajectory:
        """Return the motion beside an object (`tree` at rest, z up); TrajectoryError if the finger cannot reach it."""
        finger = FINGERS.index(self.touch.finger)
        tips = forward_kinematics(hand, *HandConfiguration.of(self.motion)).joints[:, finger, 3]
        best = _search(self.motion, hand, tree, finger, *_stroke(tips, self.motion), self.touch.depth)
        if best is None:
            name = self.name or "the motion"
            why = f"nowhere does its {self.touch.finger} finger reach it without the hand beginning in it"
            raise TrajectoryError(f"{name} cannot be placed at this object: {why}")
        placed = placed_by(self.motion, best.shift, best.turn)
        how = f"the object placed so that the {self.touch.finger} goes {1e3 * self.touch.depth:g} mm into it"
        return replace(placed, source="; ".join(part for part in (placed.source, how) if part))


def is_demonstration(table: dict[str, Any]) -> bool:
    """Return True if a TOML document is a demonstration rather than a script."""
    return "recording" in table


def parse_demonstration(text: str, *, name: str, folder: Path | Traversable, where: str) -> Demonstration:
    """Read a demonstration from TOML text; `folder` has the recording, `where` names the text in messages.

    TrajectoryError if it is not TOML, has an unknown value, or no recording.
    """
    table = parse_settings(text, _DemonstrationTable, where, TrajectoryError)
    entry = folder / table.recording
    if not entry.is_file():
        raise TrajectoryError(f"{where}: no recording {table.recording} beside it")
    with as_file(entry) as path:
        motion = replace(load_trajectory(path), name=name)
    return Demonstration(motion, table.touch, table.title, table.stresses)


class _DemonstrationTable(Settings, frozen=True):
    recording: Annotated[str, Meta(min_length=1, description="the name of a .h5 or .csv file beside this one")]
    touch: Annotated[Wanted, Meta(description="[touch] with a finger and a depth [m]")]
    title: str = ""
    stresses: str = ""
    notice: Any = None
    package: Any = None


class Candidate(NamedTuple):
    """A placement in the object's frame: turn of the object [rad], shift of the hand [m], shape (3,), and score."""

    turn: float
    shift: FloatArray
    score: float


def upright_turns() -> Iterator[tuple[float, FloatArray]]:
    """Yield `TURNS` angles [rad] about the vertical, each with its rotation backwards, shape (3, 3)."""
    for step in range(TURNS):
        turn = 2.0 * np.pi * step / TURNS
        yield turn, upright_turn(turn).T


def upright_turn(angle: float) -> FloatArray:
    """Return the rotation matrix of an angle [rad] about the vertical, shape (3, 3)."""
    return rotation_matrix(quaternion(np.array([0.0, 0.0, angle])))


def placed_by(motion: Trajectory, shift: FloatArray, angle: float) -> Trajectory:
    """Return a motion beside an object in whose frame a point of the world is Rᵀ p + shift, R a turn by an angle."""
    return motion.placed(-matmul(upright_turn(angle), shift), quaternion(np.array([0.0, 0.0, angle])))


def _stroke(tips: FloatArray, motion: Trajectory) -> tuple[FloatArray, int]:
    """Unit main direction of a fingertip's path, towards the palm's side, and the sample that is farthest along it."""
    off = tips - tips.mean(axis=0)
    spread = np.stack([dot(off[:, i], off[:, j]) for i in range(3) for j in range(3)]).reshape(3, 3)
    direction = principal_axes(spread)[1][:, 2]
    inwards = -rotation_matrix(motion.orientation)[:, :, 2].mean(axis=0)
    if dot(direction, inwards) < 0.0:
        direction = -direction
    return direction, int(np.argmax(dot(off, direction)))


def _search(
    motion: Trajectory, hand: HandModel, tree: SphereTree, finger: int, stroke: FloatArray, moment: int, depth: float
) -> Candidate | None:
    work = make_work(hand.arrays(), tree.arrays())
    looks = np.unique(np.concatenate([np.linspace(0, motion.sample_count - 1, LOOKS).round().astype(int), [moment]]))
    here = int(np.flatnonzero(looks == moment)[0])
    flexion = [np.ascontiguousarray(values) for values in motion.flexion[looks]]
    abduction = [np.ascontiguousarray(values) for values in motion.abduction[looks]]
    joints = hand.joints(motion.position[moment], motion.orientation[moment], flexion[here], abduction[here])
    low, high = tree.bounds
    middle, size = 0.5 * (low + high), float(norm(high - low))
    tip_body = PHALANX_COUNT * finger + PHALANX_COUNT - 1
    gap = np.full(BODY_COUNT, -FAR)
    gap[tip_body] = 0.0
    others = np.array([body for body in range(BODY_COUNT) if body // PHALANX_COUNT != finger])
    best: Candidate | None = None
    for turn, back in upright_turns():
        direction = matmul(back, stroke)
        rotations = [matmul(back, rotation_matrix(q)) for q in motion.orientation[looks]]
        positions = matmul(motion.position[looks], back.T)
        tip = matmul(back, joints[finger, 3])
        side = across(direction)
        for a, b in product(ACROSS, ACROSS):
            goal = middle + matmul(np.array([a, b]) * matmul(np.abs(side), high - low), side)
            start = positions[here] - tip + goal - size * direction
            posture = rotations[here], flexion[here], abduction[here]
            travel, body = kernel.advance_hand(start, *posture, direction, gap, 2.0 * size, work)
            if body != tip_body:
                continue
            shift = goal - tip + (travel + depth - size) * direction
            poses = [
                (np.ascontiguousarray(p + shift), r, f, b)
                for p, r, f, b in zip(positions, rotations, flexion, abduction)
            ]
            # Most places fail at one of these two moments.
            first, pressed = (body_distances(*poses[i], work) for i in (0, here))
            if first.min() < START_GAP or pressed[tip_body] > -PRESSED * depth:
                continue
            distance = np.stack([body_distances(*pose, work) for pose in poses])
            # The mean distance of the other bodies.
            score = float(np.minimum(distance[:, others], WANTED_GAP).mean())
            if best is None or score > best.score + 1e-12:
                best = Candidate(turn, shift, score)
    return best
