"""Skin of a recorded hand: a mesh with vertices for every frame, and the bones that carry them.

A vertex moves with the rigid motions of its bones, blended by its weights (linear blend skinning). A MANO model brings
weights; in any other mesh each vertex belongs to the nearest bone.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import TrajectoryError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.round_cone import cone_slope
from hhsim.mesh.mesh import require_usable_arrays
from hhsim.motion.npz_arrays import numbers, read_npz
from hhsim.motion.trajectory import check_finite
from hhsim.recordings.correction import BONES, Correction, moved_joints
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, ManoModel
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content
from hhsim.system.counted import counted

BLOCK_FRAMES = 64
"""Frames whose vertices are moved at once."""
LOOKS = 48
"""Frames in which the nearest bone of a vertex is searched, spread evenly over the recording."""


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


def read_skin(path: Path, recording: Recording, hand: HandModel, fitted: HandConfiguration) -> Skin:
    """Read a skin from an .npz of `vertices` (N, V, 3), in the recording's file frame, and `faces` (F, 3).

    Args:
        path: File with one set of vertices for each of the N frames of the recording's file.
        recording: Recording, which names the frames it was read from.
        hand: Hand model, whose nearest bone carries a vertex.
        fitted: Its configuration in each sample.

    Raises:
        TrajectoryError: No such file, arrays missing or of another shape, or vertices that are not finite.
        MeshError: A triangle names a vertex that does not exist.
    """
    with named(path):
        arrays = read_npz(Content(path, what="a skin").data)
        missing = [key for key in ("vertices", "faces") if key not in arrays]
        if missing:
            held = ", ".join(sorted(arrays)[:6]) or "nothing"
            raise TrajectoryError(f"no array '{missing[0]}', it holds {held}; expected vertices and faces")
        vertices, corners = numbers(arrays, "vertices"), numbers(arrays, "faces")
        if vertices.ndim != 3 or vertices.shape[2] != 3:
            raise TrajectoryError(f"array 'vertices' has shape {vertices.shape}; expected (frames, vertices, 3)")
        frames = int(recording.rows.max(initial=-1)) + 1
        if len(vertices) < frames:
            given = counted(len(vertices), "frame")
            raise TrajectoryError(f"vertices of {given}; expected at least {frames:,}, as the recording has")
        vertices = vertices[recording.rows]
        check_finite("array 'vertices'", vertices)
        if not np.array_equal(corners, np.round(corners)):
            raise TrajectoryError("array 'faces' has numbers that are not whole; expected indices of vertices")
        faces = np.asarray(np.nan_to_num(corners), dtype=np.int64)
        require_usable_arrays(vertices.reshape(-1, 3)[: vertices.shape[1]], faces, "skin")
    world = recording.file_frame.to_world(vertices)
    weights = np.eye(BONES)[nearest_bone(hand, fitted, world)]
    return Skin(world, _outward(faces, recording.file_frame), weights)


def _outward(faces: IntArray, frame: FileFrame) -> IntArray:
    """Return triangles that are outward in our world too."""
    return faces if np.prod(frame.flip) > 0.0 else faces[:, ::-1]


def nearest_bone(hand: HandModel, fitted: HandConfiguration, vertices: FloatArray) -> IntArray:
    """Return the bone of each vertex, shape (V,): least mean distance of the hand's bodies over the frames.

    Vertices [m], world, have shape (T, V, 3); the palm's body is its spheres.
    """
    looks = np.unique(np.linspace(0, len(vertices) - 1, LOOKS).astype(np.int64))
    placed = forward_kinematics(hand, *fitted.at(looks))
    total = np.zeros((vertices.shape[1], BONES))
    for points in in_palm(fitted.at(looks), vertices[looks]):
        total[:, 0] += palm_distance(hand, points)
    for finger in range(5):
        along, across = cone_coordinates(placed.joints[:, finger], vertices[looks])
        gap = cone_gaps(along, across, hand.length[finger], hand.radius[finger])[1]
        total[:, 1 + 3 * finger : 4 + 3 * finger] = gap.sum(axis=0)
    return np.asarray(total.argmin(axis=1))


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
