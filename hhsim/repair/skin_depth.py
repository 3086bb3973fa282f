"""Depth of a recorded hand's skin in an object, the least change of posture that frees it, and a second judge.

A frame is freed by Gauss-Newton steps: every vertex near the object gives a linear row, from its signed distance and
its motion with its bones, and the posture nearest to the given one that satisfies all rows is a least-distance
program. The result is measured, not predicted: a frame
whose vertices are not outside afterwards keeps its given posture and is marked.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, closest_points, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.repair.least_distance import nearest_to_origin
from hhsim.repair.skin import BLOCK_FRAMES, Skin, bone_rotations, carried
from hhsim.solver.options import Stiffness
from hhsim.verify.coal_distance import coal_model
from hhsim.verify.tree_checks import TrueSurface

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


def skin_depth(mesh: Mesh, vertices: FloatArray) -> tuple[FloatArray, IntArray]:
    """Compute how deep the deepest vertex of each frame lies inside a mesh.

    Args:
        mesh: Watertight and wound outward [m].
        vertices: In the frame of the mesh [m], shape (T, V, 3); NaN counts as outside.

    Returns:
        Depth [m], shape (T,), 0 outside, and the deepest vertex, shape (T,), -1 for a frame without one inside.
    """
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    depth, deepest = np.zeros(len(vertices)), np.full(len(vertices), -1)
    low, high = mesh.bounds
    for first in range(0, len(vertices), BLOCK_FRAMES):
        points = vertices[first : first + BLOCK_FRAMES]
        # A vertex beyond the mesh's box is outside.
        near = ((points >= low) & (points <= high)).all(axis=2)
        inside = np.zeros(near.shape)
        inside[near] = -mesh_signed_distance(bvh, points[near])
        block = slice(first, first + len(points))
        depth[block] = np.maximum(inside.max(axis=1, initial=0.0), 0.0)
        deepest[block] = np.where(depth[block] > 0.0, inside.argmax(axis=1), -1)
    return depth, deepest


class PushedOut(NamedTuple):
    """Postures whose skin is outside an object.

    Attributes:
        posture: The given one in frames that were outside, and in those that could not be freed, T frames.
        depth: Depth of the skin before [m], shape (T,).
        depth_after: The same in `posture`, shape (T,).
        is_freed: True where `depth_after` is 0, shape (T,).
    """

    posture: HandConfiguration
    depth: FloatArray
    depth_after: FloatArray
    is_freed: BoolArray


def push_out(
    mesh: Mesh, hand: HandModel, skin: Skin, joints: FloatArray, fitted: HandConfiguration, posture: HandConfiguration
) -> PushedOut:
    """Free the skin of a recorded hand by the least change of its corrected posture, frame by frame.

    The hand's own round cones play no part; all arguments but the hand are in the frame of the mesh.

    Args:
        mesh: Watertight and wound outward [m].
        hand: Hand model of both configurations; its limits are kept, or not exceeded further.
        skin: Skin of the recorded hand in T frames.
        joints: Recorded joints as of `hhsim.repair.skin.moved_skin` [m], shape (T, 21, 3).
        fitted: Configuration of the hand in each recorded frame.
        posture: Corrected configuration, the one to stay near to.
    """
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    found, depth = posture.copy(), np.empty(len(skin.vertices))
    after = np.empty_like(depth)
    for frame in range(len(depth)):
        one = slice(frame, frame + 1)
        solver = SkinFrame(
            bvh, hand, replace(skin, vertices=skin.vertices[one]), joints[one], fitted.at(one), posture.at(one)
        )
        depth[frame] = after[frame] = solver.depth()
        if depth[frame] > 0.0 and (freed := solver.freed()) is not None:
            for mine, new in zip(found, freed):
                mine[frame] = new[0]
            after[frame] = 0.0
    return PushedOut(found, depth, after, after <= 0.0)


class SkinFrame:
    """Single frame of a skin, posed beside an object; arguments as of `push_out`, of one frame each."""

    def __init__(
        self,
        bvh: MeshBvh,
        hand: HandModel,
        skin: Skin,
        joints: FloatArray,
        fitted: HandConfiguration,
        posture: HandConfiguration,
    ) -> None:
        self.bvh, self.hand, self.skin, self.joints = bvh, hand, skin, joints
        self.fitted, self.start = fitted, posture
        self.fitted_bones = bone_rotations(hand, fitted)
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
        posture = self.posture()
        bones = bone_rotations(self.hand, posture)
        rotation = bones @ self.fitted_bones.swapaxes(2, 3)
        self.vertices = carried(self.skin.weights, self.skin.vertices, self.joints, self.fitted, posture, rotation)[0]
        self.closest, self.distance = np.empty_like(self.vertices), np.empty(len(self.vertices))
        closest_points(self.bvh, np.ascontiguousarray(self.vertices), self.closest, self.distance)

    def depth(self) -> float:
        """Return the depth of the deepest vertex [m]."""
        return max(0.0, -float(self.distance.min()))

    def freed(self) -> HandConfiguration | None:
        """Return the nearest posture with all vertices outside; None if the steps do not reach one.

        Where the rows of a deep hand contradict each other, the steps begin again from a free place beside the object.
        """
        for _ in range(STEPS):
            step = self._step()
            if step is None:
                break
            self.place(self.change + step)
            if self.depth() == 0.0:
                return self.posture()
        if not self._retreat():
            return None
        for _ in range(STEPS):
            step, here = self._step(), self.change
            if step is None:
                break
            share = 1.0
            self.place(here + step)
            while self.depth() > 0.0 and share > LEAST_SHARE:
                share *= 0.5
                self.place(here + share * step)
            if self.depth() > 0.0:
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
                if self.depth() == 0.0:
                    return True
        return False

    def _step(self) -> FloatArray | None:
        """Compute the step to the posture nearest to the given one that satisfies all rows; None if there is none."""
        # A vertex on the surface itself has no direction; the clearance keeps them off it.
        near = np.flatnonzero((self.distance < REACH) & (np.abs(self.distance) > 0.1 * CLEARANCE))
        normal = (self.vertices[near] - self.closest[near]) / self.distance[near, None]
        motion = self.motion()
        rows = np.einsum("vi,vij->vj", normal, motion[near])
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
        bones = bone_rotations(hand, posture)[0]
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


class SkinJudgement(NamedTuple):
    """Skin of one frame and an object, as the library coal sees them.

    Attributes:
        depth: Of the deepest vertex inside the object [m], 0 if there is none.
        crosses: True if a triangle of the skin meets one of the object: possible between vertices that are outside.
    """

    depth: float
    crosses: bool


def judge_skin(surface: TrueSurface, mesh: Mesh, vertices: FloatArray, faces: IntArray) -> SkinJudgement:
    """Judge the skin of a frame without the code that repaired it.

    Args:
        surface: Coal's surface of `mesh`.
        mesh: Object [m].
        vertices: Of the skin, in the frame of the mesh [m], shape (V, 3).
        faces: Of the skin, shape (F, 3).
    """
    import coal

    request, answer = coal.CollisionRequest(), coal.CollisionResult()
    skin, still = coal_model(vertices, faces), coal.Transform3s()
    coal.collide(surface.model, still, skin, still, request, answer)
    low, high = mesh.bounds
    near = ((vertices >= low) & (vertices <= high)).all(axis=1)
    depth = float(-surface.signed_distance(vertices[near]).min()) if near.any() else 0.0
    return SkinJudgement(max(0.0, depth), bool(answer.isCollision()))
