"""Hand as it is written to a recording: recorded joints that have moved with our hand's bones, and their clearance.

Its bodies are round cones of our hand's radii between these joints, and the palm's spheres at the corrected palm. The
joints differ from our hand's by the error of the fit, so a free hand of ours may be written as one that penetrates.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.correction import moved_joints

SHARES = np.linspace(0.0, 1.0, 17)
"""Places along the axis of a phalanx whose distances are linearised."""


JOINTS = len(SHARES) * np.arange(15).reshape(5, 3, 1) + [0, len(SHARES) - 1]
JOINTS = np.concatenate([JOINTS[:, :, 0], JOINTS[:, 2:, 1]], axis=1).ravel()
"""Places of the joints and tips among the balls of `WrittenHand.samples`, shape (20,)."""
TIPS = len(SHARES) * (3 * np.arange(5)[:, None] + 2) + np.arange(len(SHARES))
"""Places of the balls of the distal phalanges, shape (5, 17)."""
CROSS = -np.array(
    [[[0, 0, 0], [0, 0, 1], [0, -1, 0]], [[0, 0, -1], [0, 0, 0], [1, 0, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]]
)
"""Coefficients of a cross product: the k-th component of a × p is the sum of a_i CROSS[i, k, l] p_l."""


class PosedHand(NamedTuple):
    """Bodies of T written hands, and the frames of their bones, see `bone_frames`."""

    placed: PlacedHand
    frames: FloatArray


def bone_frames(hand: HandModel, posture: HandConfiguration) -> FloatArray:
    """Compute the frame of each bone, shape (T, 16, 3, 3), world.

    Its columns are, of a phalanx, the axis, the flexion axis and their cross product; of the palm, its own axes.
    """
    across = hand.flexion_axis
    spread = hand.abduction_sign * posture.abduction[..., None]
    forward = np.cos(spread) * hand.distal + np.sin(spread) * across
    hinge = np.cos(spread) * across - np.sin(spread) * hand.distal
    total = np.cumsum(posture.flexion, axis=2)[..., None]
    axis = np.cos(total) * forward[:, :, None] - np.sin(total) * hand.dorsal[:, None]
    hinges = np.broadcast_to(hinge[:, :, None], axis.shape)
    frames = np.stack([axis, hinges, np.cross(axis, hinges)], axis=-1).reshape(-1, 15, 3, 3)
    palm = rotation_matrix(posture.orientation)[:, None]
    return np.concatenate([palm, palm @ frames], axis=1)


class WrittenHand:
    """Writes corrections of recorded joints.

    Args:
        joints: Recorded joints of T frames in the order of `KEYPOINTS` [m], shape (T, 21, 3), NaN where missing.
        fitted: Hand fitted to each frame, in the frame of the joints.
        tip_on_surface: True if recorded tips are points of the skin; False if they are centres of the fingertips.
    """

    def __init__(self, joints: FloatArray, hand: HandModel, fitted: HandConfiguration, tip_on_surface: bool) -> None:
        self.joints, self.hand, self.fitted = joints, hand, fitted
        model = forward_kinematics(hand, *fitted)
        usual = np.concatenate([model.position[:, None], model.joints.reshape(-1, 20, 3)], axis=1)
        axes = np.where(np.isfinite(joints), joints, usual)
        if tip_on_surface:
            of_finger = np.where(np.isfinite(joints), joints, np.nan)[:, 1:].reshape(-1, 5, 4, 3)
            last = of_finger[:, :, 3] - of_finger[:, :, 2]
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
        shift = posture.position - self.fitted.position
        return moved_joints(joints, self.fitted.position, shift, frames @ self.frames.swapaxes(-1, -2))

    def at(self, frame: int) -> "WrittenHand":
        """Return a single frame, T = 1, with the tips where they are."""
        part = object.__new__(WrittenHand)
        own = slice(frame, frame + 1)
        part.hand, part.fitted = self.hand, self.fitted.at(own)
        part.joints, part.axes, part.frames = self.joints[own], self.axes[own], self.frames[own]
        return part

    def samples(self, posed: PosedHand) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return balls that fill the bodies of one frame, and their motion with the hand.

        They are centres [m], shape (n, 3); radii [m], shape (n,); and derivatives of the centres by a change of the
        hand as of `hhsim.repair.hand_change.change_between`, shape (n, 3, 26).
        """
        joints, position = posed.placed.joints[0], posed.placed.position[0]
        frames, palm = posed.frames[0], posed.frames[0, 0]
        radius, tree = self.hand.radius, self.hand.palm_tree
        along = SHARES[:, None]
        centers = joints[:, :3, None] + along * (joints[:, 1:] - joints[:, :3])[:, :, None]
        radii = radius[:, :3, None] + SHARES * (radius[:, 1:] - radius[:, :3])[:, :, None]
        points = np.concatenate([centers.reshape(-1, 3), position + tree.leaf_center @ palm.T])
        # Turns about the palm's origin, the flexion axes and the abduction axes, in this order.
        spread = self.hand.abduction_sign * self.hand.dorsal @ palm.T
        axis = np.concatenate([np.eye(3), frames[1:, :, 1], spread])
        origin = np.concatenate([np.tile(position, (3, 1)), joints[:, :3].reshape(15, 3), joints[:, 0]])
        across = np.tensordot(axis, CROSS, 1)
        motion = np.empty((len(points), 3, 26))
        motion[:, :, :3] = np.eye(3)
        turns = (across @ points.T - across @ origin[:, :, None]).transpose(2, 1, 0)
        motion[:, :, 3:] = turns * _moves(len(points))[:, None]
        return points, np.concatenate([radii.ravel(), tree.leaf_radius]), motion


@lru_cache(maxsize=4)
def _moves(count: int) -> FloatArray:
    """Return 1 where a ball of `samples` moves with a turn and 0 elsewhere, shape (count, 23)."""
    moves = np.zeros((count, 23))
    moves[:, :3] = 1.0
    finger, phalanx = np.divmod(np.arange(15 * len(SHARES)) // len(SHARES), 3)
    moves[: len(finger), 3:18] = (finger[:, None] == np.arange(15) // 3) & (phalanx[:, None] >= np.arange(15) % 3)
    moves[: len(finger), 18:] = finger[:, None] == np.arange(5)
    return moves
