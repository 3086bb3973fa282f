"""A recorded hand beside its object: joints, surface and object in one frame; missing frames, NaN, are not counted."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand, stored_hands
from hhsim.kernels.contact.mesh_distance import hand_tip_distances
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, closest_points, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import RESOLUTION, mesh_clearance
from hhsim.metrics.moving_parts import MovingParts
from hhsim.motion.trajectory import RigidMotion
from hhsim.trees.contact_surface import features_of

TIPS = (4, 8, 12, 16, 20)
"""Places of the fingertips among `hhsim.recordings.joint_names.KEYPOINTS`."""
BONES = tuple((0 if joint % 4 == 1 else joint - 1, joint) for joint in range(1, 21))
"""Joints at both ends of each bone, thumb to little finger; every fourth one ends in a fingertip."""
ON_SURFACE = 1e-9
"""Distance up to which a point lies on the surface [m]."""
NEAR = 6e-3
"""Largest distance of a hand's surface that is looked for [m]: above that of any contact."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Closed meshes that a hand stays out of: an object, or its parts with their motion in the object's frame."""

    meshes: tuple[Mesh, ...]
    motions: tuple[RigidMotion, ...] = ()  # from each part's frame to the object's at T frames; none for one object

    @classmethod
    def of(cls, given: Mesh | MovingParts) -> "Bodies":
        """Return an object's mesh, or the parts of a body."""
        if isinstance(given, Mesh):
            return cls((given,))
        return cls(given.meshes, tuple(given.motion(p) for p in range(len(given.meshes))))

    def at(self, frames: int | slice | IntArray) -> "Bodies":
        """Return the bodies at some frames, or at a single one, T = 1."""
        frames = slice(frames, frames + 1) if isinstance(frames, int) else frames
        return replace(self, motions=tuple(motion.at(frames) for motion in self.motions))

    def seen(self, points: FloatArray) -> list[FloatArray]:
        """Return points of the object's frame [m], shape (T, ..., 3), in the frame of each body."""
        return [motion.seen_points(points) for motion in self.motions] or [points]

    def _hand_seen(self, placed: PlacedHand) -> list[PlacedHand]:
        """Return a hand in the frame of each body."""
        return [motion.seen_hand(placed) for motion in self.motions] or [placed]

    def clearance(self, shape: HandShape, placed: PlacedHand, limit: float = NEAR) -> FloatArray:
        """Compute the least signed distance of each hand to the bodies [m], (T,), as `mesh_clearance`."""
        bodies = zip(self.meshes, self._hand_seen(placed), strict=True)
        found = [mesh_clearance(object_bvh(mesh), shape, hand, limit) for mesh, hand in bodies]
        return np.asarray(np.min(found, axis=0))

    def tip_clearance(self, shape: HandShape, placed: PlacedHand, limit: float = NEAR) -> FloatArray:
        """Compute the signed distance of each distal phalanx to the bodies [m], (T, 5), as `hand_tip_distances`."""
        found = np.full((len(self.meshes), len(placed.joints), 5), limit)
        for mesh, hand, own in zip(self.meshes, self._hand_seen(placed), found, strict=True):
            hand_tip_distances(stored_hands(shape, hand), object_bvh(mesh), limit, RESOLUTION, own)
        return np.asarray(found.min(axis=0))

    def distance(self, points: FloatArray) -> FloatArray:
        """Compute signed distances of points [m], shape (T, ..., 3), to the bodies [m], shape (T, ...)."""
        rows = [np.ascontiguousarray(at.reshape(-1, 3)) for at in self.seen(points)]
        found = [mesh_signed_distance(object_bvh(mesh), at) for mesh, at in zip(self.meshes, rows)]
        return np.asarray(np.min(found, axis=0).reshape(points.shape[:-1]))

    def slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute signed distances of points of one frame [m], shape (n,), and their gradients, shape (n, 3)."""
        distance, slope = np.full(len(points), np.inf), np.zeros(points.shape)
        for p, (mesh, seen) in enumerate(zip(self.meshes, self.seen(points[None]))):
            at, closest, own = np.ascontiguousarray(seen[0]), np.empty(points.shape), np.empty(len(points))
            closest_points(object_bvh(mesh), at, closest, own)
            # On the surface no direction is known.
            known = (np.abs(own) > ON_SURFACE)[:, None]
            away = np.where(known, at - closest, 0.0) / np.where(known, own[:, None], 1.0)
            nearer = own < distance
            distance[nearer] = own[nearer]
            slope[nearer] = (self.motions[p].vectors(away[None])[0] if self.motions else away)[nearer]
        return distance, slope


@dataclass(frozen=True, eq=False)
class FieldHands:
    """Hand at each frame of a recording, in the object's frame.

    The surface of the hand is its skin, or its round cones and palm spheres; without either it is its joints.
    `shape` and `placed` go together, and `skin` and `faces`.
    """

    time: FloatArray  # stamps [s], shape (T,)
    joints: FloatArray  # joint centres in the order of `hhsim.recordings.joint_names.KEYPOINTS` [m], shape (T, 21, 3)
    mesh: Mesh  # closed surface of the object
    shape: HandShape | None = None  # radii of the cones and palm spheres; None without cones
    placed: PlacedHand | None = None  # axes of the cones and the palm's pose; None without cones
    skin: FloatArray | None = None  # vertices of the skin [m], shape (T, V, 3); None without a skin
    faces: IntArray | None = None  # triangles of the skin, shape (F, 3)
    # Joint centres in the world [m], shape (T, 21, 3); None for an object that stands still.
    world: FloatArray | None = None
    parts: MovingParts | None = None  # parts in place of the mesh, which is all of them at the first frame

    @cached_property
    def bodies(self) -> Bodies:
        """The object, or its parts."""
        return Bodies.of(self.parts or self.mesh)

    @cached_property
    def known(self) -> BoolArray:
        """Frames with all joints, shape (T,)."""
        return np.asarray(np.isfinite(self.joints).all(axis=(1, 2)))

    @property
    def world_joints(self) -> FloatArray:
        """Joint centres in the world [m], shape (T, 21, 3)."""
        return self.joints if self.world is None else self.world

    @cached_property
    def joint_distance(self) -> FloatArray:
        """Signed distance of each joint to the object [m], shape (T, 21); NaN in missing frames."""
        return self._distance(self.joints)

    @cached_property
    def skin_distance(self) -> FloatArray | None:
        """Signed distance of each vertex of the skin to the object [m], shape (T, V); None without a skin."""
        return None if self.skin is None else self._distance(self.skin)

    @cached_property
    def cone_distance(self) -> FloatArray | None:
        """Least signed distance of the cones and palm spheres to the object [m], shape (T,); None without cones."""
        if self.shape is None or self.placed is None:
            return None
        return np.where(self.known, self.bodies.clearance(self.shape, self.placed), np.nan)

    @cached_property
    def distance(self) -> FloatArray:
        """Least signed distance of the hand's surface to the object [m], shape (T,)."""
        if self.cone_distance is not None:
            return self.cone_distance
        points = self.joint_distance if self.skin_distance is None else self.skin_distance
        return np.asarray(points.min(axis=1))

    @cached_property
    def finger_distance(self) -> FloatArray:
        """Least signed distance of the surface of each distal phalanx to the object [m], (T, 5); < 0 for one inside."""
        if self.shape is not None and self.placed is not None:
            distal = self.bodies.tip_clearance(self.shape, self.placed)
            return np.where(self.known[:, None], distal, np.nan)
        if self.skin_distance is None:
            return self.joint_distance[:, TIPS]
        # A skin that ends before a fingertip has no vertex there.
        own = [self.skin_distance[:, self._bone_of_vertex == tip - 1] for tip in TIPS]
        return np.stack([part.min(axis=1, initial=np.inf) for part in own], axis=1)

    def _distance(self, points: FloatArray) -> FloatArray:
        distance = np.full(points.shape[:2], np.nan)
        known = self.known & np.isfinite(points).all(axis=(1, 2))
        distance[known] = self.bodies.at(np.flatnonzero(known)).distance(points[known])
        return distance

    @cached_property
    def _bone_of_vertex(self) -> IntArray:
        """Nearest of `BONES` to each vertex of the skin in the first known frame, shape (V,)."""
        assert self.skin is not None
        if not self.known.any():
            return np.zeros(self.skin.shape[1], dtype=np.int64)
        first = int(np.argmax(self.known))
        start, end = (self.joints[first, [bone[side] for bone in BONES]] for side in (0, 1))
        along, offset = end - start, self.skin[first][:, None] - start
        share = np.clip((offset * along).sum(axis=2) / np.maximum((along * along).sum(axis=1), 1e-18), 0.0, 1.0)
        return np.asarray(np.linalg.norm(offset - share[..., None] * along, axis=2).argmin(axis=1))


@dataclass(frozen=True, eq=False)
class FieldPair:
    """Recorded hand and its repair at the same frames beside the same object, and what the figures of both need."""

    recorded: FieldHands  # hand before
    repaired: FieldHands  # hand after, at the same frames
    force: FloatArray | None = None  # force of each finger after the repair [N], shape (T, 5); None if unknown
    volume_frames: int = 0  # frames whose intersection volume is computed, spread evenly; 0 for all

    @property
    def both(self) -> tuple[FieldHands, FieldHands]:
        """Recorded and repaired hand."""
        return self.recorded, self.repaired

    @cached_property
    def known(self) -> BoolArray:
        """Frames that both hands have, shape (T,)."""
        return self.recorded.known & self.repaired.known


@lru_cache(maxsize=8)
def object_bvh(mesh: Mesh) -> MeshBvh:
    """Return the hierarchy over the triangles of a closed mesh, whose sign holds also where they cross."""
    features, _ = features_of(mesh, True)
    return build_mesh_bvh(mesh.vertices, mesh.faces, by_winding=len(features.pseudonormal) == 0)
