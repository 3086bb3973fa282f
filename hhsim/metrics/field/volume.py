"""Intersection volume (IV) of hand and object: exact, by voxels of the object, and by the line of code of the field.

The line is GraspTTA's (Jiang et al. 2021, metric/intersect.py), after ObMan's: trimesh's voxels of the object whose
centres are in the hand. Those voxels are of the surface alone and reach out of it, so that a hand that only touches has
a volume. The voxels of this module's own figure have their centres in the object and in the hand.
"""

from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.kernels.mesh.winding_number import winding_numbers
from hhsim.mesh.content_cache import kept_by_content
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.hands import FieldHands, FieldMetric, FieldPair, largest, mean, object_bvh, of_frames
from hhsim.metrics.field.solid import SEGMENTS, cones_contain, cones_near, hand_solids, manifold_of
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.run_metric import each_with

if TYPE_CHECKING:
    from manifold3d import Manifold

KEPT = 16
"""Meshes whose voxels and solids a process keeps."""


@kept_by_content(KEPT)
def solid_voxels(mesh: Mesh, pitch: float) -> FloatArray:
    """Return the voxels' centres that lie inside a closed mesh [m], shape (n, 3): multiples of the pitch [m]."""
    low, high = np.ceil(mesh.bounds[0] / pitch), np.floor(mesh.bounds[1] / pitch)
    axes = [pitch * np.arange(first, last + 1.0) for first, last in zip(low, high)]
    grid = np.ascontiguousarray(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
    return grid[mesh_signed_distance(object_bvh(mesh), grid) < 0.0] if len(grid) else grid


@kept_by_content(KEPT)
def surface_voxels(mesh: Mesh, pitch: float) -> FloatArray:
    """Return the centres of trimesh's voxels of a mesh [m], shape (n, 3): those that its surface touches."""
    from trimesh import Trimesh

    return np.asarray(Trimesh(mesh.vertices, mesh.faces, process=False).voxelized(pitch).points, dtype=np.float64)


@lru_cache(maxsize=2)
def volumes(hands: FieldHands, pitch: float, most: int = 0) -> FloatArray:
    """Compute three intersection volumes of each frame [m³], shape (T, 3): exact, solid voxels, surface voxels.

    Of `most` frames, spread evenly, and of the deepest one; 0 for all. NaN in the others, in missing ones, without skin
    and cones, and where the skin is no closed surface. Of parts that move the voxels are none of the object: NaN.
    """
    found = np.full((len(hands.time), 3), np.nan)
    solids_of = hand_solids(hands)
    if solids_of is None:
        return found
    from manifold3d import Manifold, OpType

    bodies = hands.bodies
    solids_of_bodies = [_object_solid(mesh) for mesh in bodies.meshes]
    targets = [solid for solid in solids_of_bodies if solid is not None]
    voxels = () if bodies.motions else (solid_voxels(hands.mesh, pitch), surface_voxels(hands.mesh, pitch))
    frames = np.flatnonzero(hands.known)
    if 0 < most < frames.size:
        frames = sampled(frames, most, [frames[int(np.argmin(hands.distance[frames]))]])
    for frame in frames.tolist():
        # Cones that are outside share no volume; the vertices of a skin tell less.
        is_outside = hands.skin is None and bool(hands.distance[frame] >= 0.0)
        solids = [] if is_outside else solids_of(frame)
        if solids is None:
            continue
        if is_outside and len(targets) == len(bodies.meshes):
            found[frame, 0] = 0.0
        elif len(targets) == len(bodies.meshes):
            # Pieces are smaller than the hand, and their union is faster.
            there = [
                target.transform(np.column_stack([rotation_matrix(motion.turn[frame]), motion.shift[frame]]))
                for target, motion in zip(targets, bodies.motions)
            ]
            pieces = [solid ^ target for target in there or targets for solid in solids]
            found[frame, 0] = Manifold.batch_boolean(pieces, OpType.Add).volume()
        if not voxels:
            continue
        if hands.skin is None:
            # A voxel that the surface touches has its centre within a pitch of it.
            cones = cones_near(hands, frame, margin=pitch)
            counts = [int(cones_contain(cones, centres).sum()) for centres in voxels]
        else:
            counts = [_inside(solids[0], centres) for centres in voxels]
        found[frame, 1:] = np.multiply(pitch**3, counts)
    return found


@kept_by_content(KEPT)
def _object_solid(mesh: Mesh) -> "Manifold | None":
    return manifold_of(mesh.vertices, mesh.faces)


def _inside(solid: "Manifold", points: FloatArray) -> int:
    """Count points, shape (n, 3), whose winding number in the surface of a solid is above 1/2."""
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    near = np.ascontiguousarray(points[((points >= low) & (points <= high)).all(axis=1)])
    if not len(near):
        return 0
    surface = solid.to_mesh64()
    vertices = np.asarray(surface.vert_properties, dtype=np.float64)[:, :3]
    winding = np.empty(len(near))
    winding_numbers(np.ascontiguousarray(vertices[np.asarray(surface.tri_verts)]), near, winding)
    return int((winding > 0.5).sum())


def _figures(kind: int, name: str, label: str, parameters: str) -> tuple[FieldMetric, ...]:
    of = partial(of_frames, lambda pair, hands: volumes(hands, pair.pitch, pair.volume_frames)[:, kind])

    def stated(pair: FieldPair) -> str:
        surface = "cones" if pair.recorded.skin is None else "open wrist closed with a fan"
        size = f", pitch {1e3 * pair.pitch:g} mm" if kind else f", {SEGMENTS} edges around a cone"
        known = int(pair.known.sum())
        some = f"; {pair.volume_frames} of {known} frames and the deepest" if 0 < pair.volume_frames < known else ""
        return f"{parameters}{size}; {surface}{some}"

    return each_with(
        FieldMetric(f"{name}_mean", f"IV, {label}, mean of frames", compute=of(mean)),
        FieldMetric(f"{name}_max", f"IV, {label}, max", compute=of(largest)),
        unit="cm³",
        digits=3,
        parameters=stated,
    )


METRICS = (
    *_figures(0, "volume_exact", "exact", "Boolean of meshes"),
    *_figures(1, "volume_voxels", "voxels inside", "centres in object and hand"),
    *_figures(2, "volume_trimesh", "GraspTTA's line", "trimesh's voxelized"),
)
