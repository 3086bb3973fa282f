"""Depth of a recorded hand's skin in an object, and the corrected posture that frees it.

A frame is freed by the programs of the projection, with the vertices of the skin in place of balls along the bones. The
result is measured, not predicted: a frame whose vertices are not outside afterwards keeps its given posture and is
marked.
"""

from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import Bodies
from hhsim.metrics.moving_parts import MovingParts
from hhsim.repair.projection import HandJudge, Projection, put
from hhsim.repair.skin import BLOCK_FRAMES, Skin, carried
from hhsim.repair.written_hand import NUMBERS, PosedHand, WrittenHand, ball_radii


def skin_depth(given: Mesh | MovingParts, vertices: FloatArray) -> FloatArray:
    """Compute how deep the deepest vertex of each frame lies inside a watertight mesh or parts [m], (T,), 0 outside.

    Vertices [m] have shape (T, V, 3).
    """
    bodies, depth = Bodies.of(given), np.empty(len(vertices))
    for first in range(0, len(vertices), BLOCK_FRAMES):
        block = slice(first, min(first + BLOCK_FRAMES, len(vertices)))
        depth[block] = np.maximum(-bodies.at(block).distance(vertices[block]).min(axis=1), 0.0)
    return depth


class WrittenSkin(WrittenHand):
    """Writes corrections of recorded joints with the skin of the hand, whose vertices have to be outside."""

    def __init__(
        self, joints: FloatArray, hand: HandModel, fitted: HandConfiguration, tip_on_surface: bool, skin: Skin
    ) -> None:
        super().__init__(joints, hand, fitted, tip_on_surface)
        self.skin, self.surface = skin, slice(len(ball_radii(hand)), None)

    def at(self, frame: int) -> Self:
        """Return a single frame, T = 1."""
        part = super().at(frame)
        part.skin = replace(self.skin, vertices=self.skin.vertices[frame : frame + 1])
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
    given: Mesh | MovingParts,
    hand: HandModel,
    skin: Skin,
    joints: FloatArray,
    fitted: HandConfiguration,
    posture: HandConfiguration,
) -> PushedOut:
    """Free the skin of a recorded hand near its corrected posture, frame by frame.

    The hand's own round cones play no part. Mesh or parts, watertight and wound outward, skin, recorded joints as of
    `hhsim.repair.skin.moved_skin`, and both configurations are in one frame.
    """
    projection = SkinProjection(WrittenSkin(joints, hand, fitted, False, skin), HandJudge(hand, given))
    vertices = np.empty_like(skin.vertices)
    for first in range(0, len(vertices), BLOCK_FRAMES):
        some = slice(first, first + BLOCK_FRAMES)
        part = WrittenSkin(joints[some], hand, fitted.at(some), False, replace(skin, vertices=skin.vertices[some]))
        vertices[some] = part.vertices(part.posed(posture.at(some)))
    depth = skin_depth(given, vertices)
    found, is_freed = posture.copy(), depth <= 0.0
    for frame in np.flatnonzero(~is_freed).tolist():
        one = projection.at(frame)
        freed = one.free_near(posture.part(frame, frame + 1))
        if freed is not None:
            put(found, frame, freed)
            is_freed[frame] = bool(one.clearance(freed)[0] >= 0.0)
    return PushedOut(found, depth, is_freed)
