"""Skin of a recorded hand: a mesh with vertices for every frame, and the bones that carry them.

A vertex moves with the rigid motions of its bones, blended by its weights (linear blend skinning), which a MANO model
brings.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.round_cone import cone_slope
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, ManoModel
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.registry import BONES, Correction, moved_joints

BLOCK_FRAMES = 64
"""Frames whose vertices are moved at once."""


@dataclass(frozen=True, eq=False, repr=False)
class Skin:
    """Mesh of the hand's surface, one set of vertices a frame, our world."""

    vertices: FloatArray  # [m], shape (T, V, 3)
    faces: IntArray  # triangles, outward by the right hand, shape (F, 3); the wrist may be open
    # Share of each bone in a vertex's motion, bones in the order of `Correction`, shape (V, 16); rows sum to 1.
    weights: FloatArray

    def __repr__(self) -> str:
        frames, count = self.vertices.shape[:2]
        return f"Skin({frames:,} frames, {count:,} vertices, {len(self.faces):,} triangles)"

    @cached_property
    def bone(self) -> IntArray:
        """Bone with the largest weight on each vertex, shape (V,)."""
        return np.asarray(self.weights.argmax(axis=1))


def mano_skin(
    model: ManoModel,
    rotation: FloatArray,
    pose: FloatArray,
    translation: FloatArray,
    betas: FloatArray,
    frame: FileFrame | None = None,
) -> Skin:
    """Compute the skin of a MANO hand, as `ManoModel.keypoints`, in a file's `frame`; TrajectoryError without faces."""
    if not len(model.faces):
        raise TrajectoryError("the MANO model has no triangles; expected its array 'f'")
    frame = FileFrame() if frame is None else frame
    vertices = model.vertices(rotation, pose, translation, betas)
    return Skin(frame.to_world(vertices), _outward(model.faces, frame), model.weights[:, list(KEYPOINT_JOINTS)])


def _outward(faces: IntArray, frame: FileFrame) -> IntArray:
    """Return triangles that are outward in our world too."""
    return faces if np.prod(frame.flip) > 0.0 else faces[:, ::-1]


def in_palm(configuration: HandConfiguration, points: FloatArray) -> FloatArray:
    """Convert points [m], shape (T, V, 3), from the world to the palm frame of each configuration."""
    return np.asarray((points - configuration.position[:, None]) @ rotation_matrix(configuration.orientation))


def palm_distance(hand: HandModel, points: FloatArray) -> FloatArray:
    """Compute signed distances [m] of points in the palm frame, shape (V, 3), to the palm's spheres, shape (V,)."""
    tree = hand.palm_tree
    apart = np.linalg.norm(points[:, None] - tree.leaf_center, axis=2)
    return np.asarray((apart - tree.leaf_radius).min(axis=1))


def cone_coordinates(joints: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the place of points along each phalanx of a finger, from its first joint, and across its axis.

    Of joints and tip [m], shape (T, 4, 3), and points [m], shape (T, V, 3); both [m], (T, V, 3): one column a phalanx.
    """
    axis = np.diff(joints, axis=1)
    axis /= np.linalg.norm(axis, axis=2, keepdims=True)
    offset = points[:, :, None] - joints[:, None, :3]
    along = (offset * axis[:, None]).sum(axis=3)
    return along, np.linalg.norm(offset - along[..., None] * axis[:, None], axis=3)


def cone_gaps(
    along: FloatArray, across: FloatArray, length: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the nearest sphere and the signed distance of points to each round cone of a finger.

    Coordinates are as of `cone_coordinates` [m], shape (…, 3), lengths those of the phalanges [m], shape (3,), radii at
    the joints and the tip [m], shape (4,). Returns the share of the axis where the nearest sphere lies, and the
    distance [m], shapes (…, 3).
    """
    slope = np.array([cone_slope(*cone) for cone in zip(length, radius[:3], radius[1:])])
    share = np.clip((along - across * slope[:, 0]) * slope[:, 1], 0.0, 1.0)
    gap = np.hypot(along - share * length, across) - (radius[:3] + share * np.diff(radius))
    return share, gap


def moved_skin(skin: Skin, joints: FloatArray, correction: Correction) -> FloatArray:
    """Return the skin's vertices [m], shape (T, V, 3), moved with their bones from the recorded to the corrected hand.

    A frame without a correction keeps its vertices exactly. Recorded joints are in the order of
    `hhsim.recordings.joint_names.KEYPOINTS` [m], our world, (T, 21, 3).
    """
    moved = skin.vertices.copy()
    changed = np.flatnonzero(correction.changed)
    for first in range(0, len(changed), BLOCK_FRAMES):
        frames = changed[first : first + BLOCK_FRAMES]
        pair = correction.fitted.at(frames), correction.posture.at(frames)
        moved[frames] = carried(skin.weights, skin.vertices[frames], joints[frames], *pair, correction.rotation[frames])
    return moved


def carried(
    weights: FloatArray,
    vertices: FloatArray,
    joints: FloatArray,
    fitted: HandConfiguration,
    posture: HandConfiguration,
    rotation: FloatArray,
) -> FloatArray:
    """Move vertices [m], shape (T, V, 3), by the blend of their bones' motions from `fitted` to `posture`.

    `weights` is that of a `Skin`, `joints` are recorded, shape (T, 21, 3), `rotation` is that of a `Correction`.
    """
    after = moved_joints(joints, fitted.position, posture.position - fitted.position, rotation)
    start, end = (_bone_starts(*pair) for pair in ((joints, fitted), (after, posture)))
    shift = end - (rotation @ start[..., None])[..., 0]
    blend = (weights @ rotation.reshape(-1, BONES, 9)).reshape(*vertices.shape, 3)
    return np.asarray((blend @ vertices[..., None])[..., 0] + weights @ shift)


def _bone_starts(joints: FloatArray, configuration: HandConfiguration) -> FloatArray:
    """Return the palm's origin and the first joint of each phalanx [m], shape (T, 16, 3)."""
    fingers = joints[:, 1:].reshape(-1, 5, 4, 3)[:, :, :3].reshape(-1, BONES - 1, 3)
    return np.concatenate([configuration.position[:, None], fingers], axis=1)
