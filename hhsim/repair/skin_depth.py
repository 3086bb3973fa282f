"""Depth of a recorded hand's skin in an object, and the least change of posture that frees it.

A frame is freed by Gauss-Newton steps: every vertex near the object gives a linear row, from its signed distance and
its motion with its bones, and the posture nearest to the given one that satisfies all rows is a least-distance
program. The result is measured, not predicted: a frame whose vertices are not outside afterwards keeps its given
posture and is marked.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import ON_SURFACE, Bodies, object_bvh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.repair.skin import BLOCK_FRAMES, Skin, carried, nearest_to_origin
from hhsim.repair.written_hand import bone_frames
from hhsim.solver.options import Stiffness

CLEARANCE = 1e-5
"""Distance of freed vertices to the object that the program asks for [m]."""
REACH = 5e-3
"""Vertices up to this far outside give a row [m]; no step moves a vertex by more than half of it to first order."""
STEPS = 60
"""Most steps of a frame."""
LEAST_SHARE = 1e-3
"""Least share of a step towards the object, and least step in roots of the coupling's energy [√J], that is tried."""
FARTHEST = 0.3
"""Largest shift to a free place [m]."""
DOF = 26
"""Palm translation [m] 0 to 2, palm rotation [rad] 3 to 5, flexion 6 + 3 finger + joint, abduction 21 + finger."""


def skin_depth(given: Mesh | MovingParts, vertices: FloatArray) -> tuple[FloatArray, IntArray]:
    """Compute how deep the deepest vertex of each frame lies inside a watertight mesh or parts [m], (T,), 0 outside.

    Vertices [m] have shape (T, V, 3); NaN counts as outside. Returns also the deepest vertex, (T,), -1 for none inside.
    """
    bodies = Bodies.of(given)
    depth, deepest = np.zeros(len(vertices)), np.full(len(vertices), -1)
    for first in range(0, len(vertices), BLOCK_FRAMES):
        block = slice(first, min(first + BLOCK_FRAMES, len(vertices)))
        inside = np.zeros(vertices[block].shape[:2])
        for mesh, points in zip(bodies.meshes, bodies.at(block).seen(vertices[block])):
            # A vertex beyond the mesh's box is outside.
            near = ((points >= mesh.bounds[0]) & (points <= mesh.bounds[1])).all(axis=2)
            inside[near] = np.maximum(inside[near], -mesh_signed_distance(object_bvh(mesh), points[near]))
        depth[block] = np.maximum(inside.max(axis=1, initial=0.0), 0.0)
        deepest[block] = np.where(depth[block] > 0.0, inside.argmax(axis=1), -1)
    return depth, deepest


class PushedOut(NamedTuple):
    """Postures whose skin is outside an object."""

    # The given one in frames that were outside, and in those that could not be freed, T frames.
    posture: HandConfiguration
    depth: FloatArray  # depth of the skin before [m], shape (T,)
    depth_after: FloatArray  # the same in `posture`, shape (T,)
    is_freed: BoolArray  # True where `depth_after` is 0, shape (T,)


def push_out(
    given: Mesh | MovingParts,
    hand: HandModel,
    skin: Skin,
    joints: FloatArray,
    fitted: HandConfiguration,
    posture: HandConfiguration,
) -> PushedOut:
    """Free the skin of a recorded hand by the least change of its corrected posture, frame by frame.

    The hand's own round cones play no part; its limits are kept, or not exceeded further. Mesh or parts, watertight and
    wound outward, skin, recorded joints as of `hhsim.repair.skin.moved_skin`, and both configurations are in one frame.
    A frame with NaN counts as outside.
    """
    found, vertices = posture.copy(), np.empty_like(skin.vertices)
    for first in range(0, len(vertices), BLOCK_FRAMES):
        some = slice(first, first + BLOCK_FRAMES)
        pair = fitted.at(some), posture.at(some)
        vertices[some] = _posed(hand, replace(skin, vertices=skin.vertices[some]), joints[some], *pair)
    depth = skin_depth(given, vertices)[0]
    bodies, after = Bodies.of(given), depth.copy()
    for frame in np.flatnonzero(depth > 0.0):
        one = slice(frame, frame + 1)
        own = replace(skin, vertices=skin.vertices[one])
        solver = SkinFrame(bodies.at(one), hand, own, joints[one], fitted.at(one), posture.at(one))
        freed = solver.freed()
        if freed is not None:
            after[frame] = max(0.0, -float(solver.distance.min()))
            for mine, new in zip(found, freed):
                mine[frame] = new[0]
    return PushedOut(found, depth, after, after <= 0.0)


def _posed(
    hand: HandModel, skin: Skin, joints: FloatArray, fitted: HandConfiguration, posture: HandConfiguration
) -> FloatArray:
    """Compute the skin's vertices in a posture [m], shape (T, V, 3); arguments as of `push_out`."""
    rotation = bone_frames(hand, posture) @ bone_frames(hand, fitted).swapaxes(2, 3)
    return carried(skin.weights, skin.vertices, joints, fitted, posture, rotation)


class SkinFrame:
    """Single frame of a skin, posed beside an object; arguments as of `push_out`, of one frame each."""

    def __init__(
        self,
        bodies: Bodies,
        hand: HandModel,
        skin: Skin,
        joints: FloatArray,
        fitted: HandConfiguration,
        posture: HandConfiguration,
    ) -> None:
        self.bodies, self.hand, self.skin, self.joints = bodies, hand, skin, joints
        self.fitted, self.start = fitted, posture
        stiffness = Stiffness()
        self.scale = np.sqrt(np.append(stiffness.diagonal(), np.full(5, stiffness.flexion)))
        self.place(np.zeros(DOF))

    def posture(self) -> HandConfiguration:
        """Return the posture of the present change."""
        turn = quaternion_product(quaternion(self.change[None, 3:6]), self.start.orientation)
        flexion = self.start.flexion + self.change[6:21].reshape(1, 5, 3)
        return HandConfiguration(
            self.start.position + self.change[:3], turn, flexion, self.start.abduction + self.change[21:]
        )

    def place(self, change: FloatArray) -> None:
        """Compute vertices and their distances to the object after a change of the given posture, shape (26,)."""
        self.change = change
        self.vertices = _posed(self.hand, self.skin, self.joints, self.fitted, self.posture())[0]
        self.distance, self.slope = self.bodies.slopes(self.vertices)

    def is_free(self) -> bool:
        """Return True if all vertices are outside, by more than a file's rounding of the posture."""
        return bool(self.distance.min() >= 0.5 * CLEARANCE)

    def freed(self) -> HandConfiguration | None:
        """Return the nearest posture with all vertices outside; None if the steps do not reach one.

        Where the rows of a deep hand contradict each other, the steps begin again from a free place beside the object.
        """
        for _ in range(STEPS):
            step = self._step()
            if step is None:
                break
            self.place(self.change + step)
            if self.is_free():
                return self.posture()
        if not self._retreat():
            return None
        for _ in range(STEPS):
            step, here = self._step(), self.change
            if step is None:
                break
            share = 1.0
            self.place(here + step)
            while not self.is_free() and share > LEAST_SHARE:
                share *= 0.5
                self.place(here + share * step)
            if not self.is_free():
                self.place(here)
            if np.abs(self.scale * (self.change - here)).max() < LEAST_SHARE:
                break
        return self.posture()

    def _retreat(self) -> bool:
        """Shift the hand to the nearest free place along 26 directions; False if there is none within `FARTHEST`."""
        directions = [np.array(index) - 1.0 for index in np.ndindex(3, 3, 3) if index != (1, 1, 1)]
        for distance in np.arange(REACH, FARTHEST, REACH):
            for direction in directions:
                change = np.zeros(DOF)
                change[:3] = distance / np.linalg.norm(direction) * direction
                self.place(change)
                if self.is_free():
                    return True
        return False

    def _step(self) -> FloatArray | None:
        """Compute the step to the posture nearest to the given one that satisfies all rows; None if there is none."""
        # A vertex on the surface itself has no direction.
        near = np.flatnonzero((self.distance < REACH) & (np.abs(self.distance) > ON_SURFACE))
        motion = self.motion()
        rows = np.einsum("vi,vij->vj", self.slope[near], motion[near])
        limits, ends = self._limits()
        bounds = np.append(CLEARANCE - self.distance[near] + rows @ self.change, ends)
        goal = nearest_to_origin(np.vstack([rows, limits]) / self.scale, bounds)
        if goal is None:
            return None
        step = goal / self.scale - self.change
        longest = float(np.linalg.norm(motion @ step, axis=1).max())
        return np.asarray(step * min(1.0, 0.5 * REACH / max(longest, 1e-12)))

    def _limits(self) -> tuple[FloatArray, FloatArray]:
        """Return rows of A · change ≥ b for the joint limits; a joint beyond its limit may stay."""
        start = np.append(self.start.flexion, self.start.abduction)
        low = np.append(self.hand.flexion_min, self.hand.abduction_min)
        high = np.append(self.hand.flexion_max, self.hand.abduction_max)
        joints = np.eye(DOF)[6:]
        return np.vstack([joints, -joints]), np.minimum(np.append(low - start, start - high), 0.0)

    def motion(self) -> FloatArray:
        """Compute the derivative of the vertices by the change, shape (V, 3, 26)."""
        posture, hand = self.posture(), self.hand
        placed = forward_kinematics(hand, *posture).joints[0]
        bones = bone_frames(hand, posture)[0]
        points, weights = self.vertices, self.skin.weights
        motion = np.zeros((len(points), 3, DOF))
        motion[:, :, :3] = np.eye(3)
        for k in range(3):
            motion[:, :, 3 + k] = np.cross(np.eye(3)[k], points - posture.position[0])
        for finger in range(5):
            share = weights[:, 1 + 3 * finger : 4 + 3 * finger]
            for k in range(3):
                turned = np.cross(bones[1 + 3 * finger, :, 1], points - placed[finger, k])
                motion[:, :, 6 + 3 * finger + k] = share[:, k:].sum(axis=1, keepdims=True) * turned
            spread = hand.abduction_sign * bones[0] @ hand.dorsal[finger]
            turned = np.cross(spread, points - placed[finger, 0])
            motion[:, :, 21 + finger] = share.sum(axis=1, keepdims=True) * turned
        return motion
