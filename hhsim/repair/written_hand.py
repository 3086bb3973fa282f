"""Hand as it is written to a recording: recorded joints that have moved with our hand's bones, by a change of it.

A change from one hand to another is a vector of 26 numbers. The bodies of the written hand are round cones of our
hand's radii between its joints, and the palm's spheres at the corrected palm. The joints differ from our hand's by the
error of the fit, so a free hand of ours may be written as one that penetrates.
"""

from copy import copy
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.written_hand import HandBones, fill_with_balls, move_joints, place_bones
from hhsim.kernels.hand.pose import apply_changes, turns_between
from hhsim.kernels.jit import as_argument

NUMBERS = 26
"""Numbers of a change: palm shift [m], palm rotation vector [rad], 15 flexions and 5 abductions [rad]."""


def finite_frames(hands: HandConfiguration) -> BoolArray:
    """Return True for hands of finite numbers, shape (T,)."""
    finite = [np.isfinite(values).all(axis=tuple(range(1, values.ndim))) for values in hands]
    return np.asarray(np.logical_and.reduce(finite))


def change_between(first: HandConfiguration, second: HandConfiguration) -> FloatArray:
    """Return the changes from the first to the second hands, shape (T, 26), the palm's rotation from the left.

    That of equal hands is exactly zero.
    """
    turn = np.empty((len(first.orientation), 3))
    turns_between(as_argument(first.orientation), as_argument(second.orientation), turn)
    flexion = (second.flexion - first.flexion).reshape(len(turn), 15)
    return np.concatenate([second.position - first.position, turn, flexion, second.abduction - first.abduction], axis=1)


def changed_hand(hand: HandConfiguration, change: FloatArray) -> HandConfiguration:
    """Return hands after these changes, shape (T, 26); a change of exactly zero returns the same numbers."""
    orientation, flexion = as_argument(hand.orientation), as_argument(hand.flexion.reshape(-1, 15))
    turned, bent, spread = np.empty(orientation.shape), np.empty(flexion.shape), np.empty(hand.abduction.shape)
    apply_changes(orientation, flexion, as_argument(hand.abduction), as_argument(change), turned, bent, spread)
    return HandConfiguration(hand.position + change[:, :3], turned, bent.reshape(-1, 5, 3), spread)


def mean_acceleration(points: FloatArray) -> float:
    """Return the mean length of the second differences of points along the frames [m], shape (T, P, 3); 0 below 3."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.norm(np.diff(points, n=2, axis=0), axis=-1).mean())


SHARES = np.linspace(0.0, 1.0, 17)
"""Places along the axis of a phalanx whose distances are linearised."""


JOINTS = len(SHARES) * np.arange(15).reshape(5, 3, 1) + [0, len(SHARES) - 1]
JOINTS = np.concatenate([JOINTS[:, :, 0], JOINTS[:, 2:, 1]], axis=1).ravel()
"""Places of the joints and tips among the balls of `WrittenHand.samples`, shape (20,)."""
TIPS = len(SHARES) * (3 * np.arange(5)[:, None] + 2) + np.arange(len(SHARES))
"""Places of the balls of the distal phalanges, shape (5, 17)."""


class PosedHand(NamedTuple):
    """Bodies of T written hands, and the frames of their bones, see `bone_frames`."""

    placed: PlacedHand
    frames: FloatArray


@lru_cache(maxsize=8)
def hand_bones(hand: HandModel) -> HandBones:
    """Return the directions and sizes of a hand in the kernels' form."""
    palm = hand.palm_tree
    sizes = hand.distal, hand.flexion_axis, hand.dorsal, hand.radius, palm.leaf_center, palm.leaf_radius
    distal, across, dorsal, radius, center, ball = map(as_argument, sizes)
    return HandBones(distal, across, dorsal, hand.abduction_sign, radius, center, ball)


@lru_cache(maxsize=8)
def ball_radii(hand: HandModel) -> FloatArray:
    """Return the radii of the balls of `WrittenHand.samples` [m], shape (n,)."""
    along = hand.radius[:, :3, None] + SHARES * np.diff(hand.radius, axis=1)[:, :, None]
    return np.concatenate([along.ravel(), hand.palm_tree.leaf_radius])


def bone_frames(hand: HandModel, posture: HandConfiguration) -> FloatArray:
    """Compute the frame of each bone, shape (T, 16, 3, 3), world.

    Its columns are, of a phalanx, the axis, the flexion axis and their cross product; of the palm, its own axes.
    """
    frames = np.empty((len(posture.orientation), 16, 3, 3))
    orientation, flexion, abduction = map(as_argument, posture[1:])
    place_bones(hand_bones(hand), orientation, flexion, abduction, frames)
    return frames


def moved_joints(joints: FloatArray, origin: FloatArray, position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Move recorded joints with their bones, each of which keeps its length.

    The joints [m], shape (T, 21, 3), are in the order of `KEYPOINTS`; the palm's origins before and after [m] have
    shape (T, 3), the rotations of the bones (T, 16, 3, 3).
    """
    moved, still = np.empty(joints.shape), np.tile(np.eye(3), (*rotation.shape[:2], 1, 1))
    move_joints(as_argument(joints), as_argument(origin), still, as_argument(position), as_argument(rotation), moved)
    return moved


class WrittenHand:
    """Writes corrections of recorded joints; `surface` are the balls of `samples` that have to be outside.

    Args:
        joints: Recorded joints of T frames in the order of `KEYPOINTS` [m], shape (T, 21, 3).
        fitted: Hand fitted to each frame, in the frame of the joints.
        tip_on_surface: True if recorded tips are points of the skin; False if they are centres of the fingertips.
    """

    surface = slice(None)

    def __init__(self, joints: FloatArray, hand: HandModel, fitted: HandConfiguration, tip_on_surface: bool) -> None:
        self.joints, self.hand, self.fitted = joints, hand, fitted
        axes = joints.copy()
        if tip_on_surface:
            last = joints[:, 4::4] - joints[:, 3::4]
            with np.errstate(invalid="ignore", divide="ignore"):
                inset = hand.radius[:, 3:] * last / np.linalg.norm(last, axis=-1, keepdims=True)
            axes[:, 4::4] -= np.nan_to_num(inset)
        self.axes = axes
        self.frames = bone_frames(hand, fitted)

    def posed(self, posture: HandConfiguration) -> PosedHand:
        """Return the bodies' axes and the palm of the written hands, and the frames of their bones."""
        frames = bone_frames(self.hand, posture)
        axes = self._moved(self.axes, posture, frames)[:, 1:].reshape(-1, 5, 4, 3)
        return PosedHand(PlacedHand(np.ascontiguousarray(axes), posture.position, posture.orientation), frames)

    def placed(self, posture: HandConfiguration) -> PlacedHand:
        """Return the bodies' axes and the palm of the written hands."""
        return self.posed(posture).placed

    def rotation(self, posture: HandConfiguration) -> FloatArray:
        """Return the rotation of each bone from the fitted to these hands, shape (T, 16, 3, 3)."""
        return np.asarray(bone_frames(self.hand, posture) @ self.frames.swapaxes(-1, -2))

    def moved(self, joints: FloatArray, posture: HandConfiguration) -> FloatArray:
        """Return joints that have moved with the bones [m], shape (T, 21, 3)."""
        return self._moved(joints, posture, bone_frames(self.hand, posture))

    def _moved(self, joints: FloatArray, posture: HandConfiguration, frames: FloatArray) -> FloatArray:
        moved, own = np.empty(joints.shape), (as_argument(joints), as_argument(self.fitted.position))
        move_joints(*own, self.frames, as_argument(posture.position), frames, moved)
        return moved

    def at(self, frames: slice) -> Self:
        """Return some frames, with the tips where they are."""
        part = copy(self)
        part.fitted = self.fitted.at(frames)
        part.joints, part.axes, part.frames = self.joints[frames], self.axes[frames], self.frames[frames]
        return part

    def samples(self, posed: PosedHand) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return balls that fill the bodies of one frame, and their motion with the hand.

        They are centres [m], shape (n, 3); radii [m], shape (n,); and derivatives of the centres by a change of the
        hand as of `hhsim.repair.written_hand.change_between`, shape (n, 3, 26).
        """
        radii = ball_radii(self.hand)
        points, motion = np.empty((len(radii), 3)), np.empty((len(radii), 3, NUMBERS))
        joints, position = (as_argument(values[0]) for values in posed.placed[:2])
        fill_with_balls(hand_bones(self.hand), joints, position, posed.frames[0], SHARES, points, motion)
        return points, radii, motion
