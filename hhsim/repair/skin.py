"""Skin of a recorded hand, how deep it is in an object, and the corrected posture that frees it.

A vertex moves with the rigid motions of its bones, blended by its weights (linear blend skinning), which a MANO model
brings. A frame is freed by the programs of the projection, with the vertices of the skin in place of balls along the
bones. The result is measured, not predicted: a frame whose vertices are not outside afterwards keeps its given posture
and is marked.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.round_cone import cone_slope
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, ManoModel
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.registry import BONES, Correction
from hhsim.repair.projection import HandJudge, Projection, put
from hhsim.repair.written_hand import NUMBERS, PosedHand, WrittenHand, ball_radii, moved_joints

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
    """Compute the skin of a MANO hand with triangles, as `ManoModel.keypoints`, in a file's `frame`."""
    frame = FileFrame() if frame is None else frame
    vertices = frame.to_world(model.vertices(rotation, pose, translation, betas))
    # Triangles are outward in our world too.
    faces = model.faces if np.prod(frame.flip) > 0.0 else model.faces[:, ::-1]
    return Skin(vertices, faces, model.weights[:, list(KEYPOINT_JOINTS)])


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
    after = moved_joints(joints, fitted.position, posture.position, rotation)
    # The palm's origin and the first joint of each phalanx [m], shape (T, 16, 3).
    firsts = [each[:, 1:].reshape(-1, 5, 4, 3)[:, :, :3].reshape(-1, BONES - 1, 3) for each in (joints, after)]
    origins = fitted.position[:, None], posture.position[:, None]
    start, end = (np.concatenate(pair, axis=1) for pair in zip(origins, firsts))
    shift = end - (rotation @ start[..., None])[..., 0]
    blend = (weights @ rotation.reshape(-1, BONES, 9)).reshape(*vertices.shape, 3)
    return np.asarray((blend @ vertices[..., None])[..., 0] + weights @ shift)


class WrittenSkin(WrittenHand):
    """Writes corrections of recorded joints with the skin of the hand, whose vertices have to be outside."""

    def __init__(
        self, joints: FloatArray, hand: HandModel, fitted: HandConfiguration, tip_on_surface: bool, skin: Skin
    ) -> None:
        super().__init__(joints, hand, fitted, tip_on_surface)
        self.skin, self.surface = skin, slice(len(ball_radii(hand)), None)

    def at(self, frames: slice) -> Self:
        """Return some frames."""
        part = super().at(frames)
        part.skin = replace(self.skin, vertices=self.skin.vertices[frames])
        return part

    def vertices(self, posed: PosedHand) -> FloatArray:
        """Return the skin of hands [m], shape (T, V, 3)."""
        after = self.fitted._replace(position=posed.placed.position)
        rotation = posed.frames @ self.frames.swapaxes(-1, -2)
        return carried(self.skin.weights, self.skin.vertices, self.joints, self.fitted, after, rotation)

    def samples(self, posed: PosedHand) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the balls of `WrittenHand.samples` of one frame, and after them the vertices of the skin."""
        balls, radii, moved = super().samples(posed)
        points, weights, bones = self.vertices(posed)[0], self.skin.weights, posed.frames[0]
        joints, motion = posed.placed.joints[0], np.zeros((len(points), 3, NUMBERS))
        motion[:, :, :3] = np.eye(3)
        for k in range(3):
            motion[:, :, 3 + k] = np.cross(np.eye(3)[k], points - posed.placed.position[0])
        for finger in range(5):
            share = weights[:, 1 + 3 * finger : 4 + 3 * finger]
            for k in range(3):
                turned = np.cross(bones[1 + 3 * finger, :, 1], points - joints[finger, k])
                motion[:, :, 6 + 3 * finger + k] = share[:, k:].sum(axis=1, keepdims=True) * turned
            spread = self.hand.abduction_sign * bones[0] @ self.hand.dorsal[finger]
            turned = np.cross(spread, points - joints[finger, 0])
            motion[:, :, 21 + finger] = share.sum(axis=1, keepdims=True) * turned
        sizes = np.append(radii, np.zeros(len(points)))
        return np.concatenate([balls, points]), sizes, np.concatenate([moved, motion])


class SkinProjection(Projection):
    """Nearest hands whose skin is outside."""

    written: WrittenSkin

    def clearance(self, posture: HandConfiguration) -> FloatArray:
        """Return the least signed distance of the vertices [m], shape (T,)."""
        return np.asarray(self.judge.bodies.distance(self.written.vertices(self.written.posed(posture))).min(axis=1))


class PushedOut(NamedTuple):
    """Postures whose skin is outside an object."""

    # The given one in frames that were outside, and in those that could not be freed, T frames.
    posture: HandConfiguration
    depth: FloatArray  # depth of the skin before [m], shape (T,)
    is_freed: BoolArray  # True where the skin is outside in `posture`, shape (T,)


def push_out(
    judge: HandJudge, skin: Skin, joints: FloatArray, fitted: HandConfiguration, posture: HandConfiguration
) -> PushedOut:
    """Free the skin of a recorded hand near its corrected posture, frame by frame.

    The hand's own round cones play no part. The judge's meshes, watertight and wound outward, skin, recorded joints as
    of `moved_skin`, and both configurations are in one frame.
    """
    projection = SkinProjection(WrittenSkin(joints, judge.hand, fitted, False, skin), judge)
    depth = np.empty(len(joints))
    for first in range(0, len(depth), BLOCK_FRAMES):
        some = slice(first, first + BLOCK_FRAMES)
        depth[some] = np.maximum(-projection.at(some).clearance(posture.at(some)), 0.0)
    found, is_freed = posture.copy(), depth <= 0.0
    for frame in np.flatnonzero(~is_freed).tolist():
        one = projection.at(frame)
        freed = one.free_near(posture.part(frame, frame + 1))
        if freed is not None:
            put(found, frame, freed)
            is_freed[frame] = bool(one.clearance(freed)[0] >= 0.0)
    return PushedOut(found, depth, is_freed)
