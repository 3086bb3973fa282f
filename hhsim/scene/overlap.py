"""Depth of meshes in each other: the largest lower bound found of the shortest shift that would take them apart.

Two triangles that cross come apart by no less than the least of the shifts along eleven directions. A point at depths a
and b in two solids leaves one of them after a + b at the earliest, also where their surfaces coincide, or do not meet.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.scene.body import CLEARANCE, Body, Free
from hhsim.trees.contact_surface import encloses
from hhsim.trees.sphere_tree import SphereTree

HALVINGS, MOST_FACES = 12, 200
"""Points behind a face are half, a quarter, ... of the mesh's length away from it; most faces that have some."""
TOGETHER = 64
"""Triangles that lie side by side, whose boxes are compared at once with those of another mesh."""
PARALLEL = 1e-12
"""Sine of the angle of two edges below which they have no direction across."""
MOST_RAISED = 5e-3
"""Largest way [m] by which a body that stands on another one is raised off the spheres of that one."""


class Solid:
    """A mesh in the world [m]: points of its surface and, if it encloses a space, of its inside, with their depths."""

    def __init__(self, mesh: Mesh) -> None:
        self.triangles, self.bounds = mesh.triangles, mesh.bounds
        self.shell = None
        if encloses(mesh):
            self.shell = build_mesh_bvh(mesh.vertices, mesh.faces, by_winding=mesh.shell is not None)
        self.points = np.concatenate([mesh.vertices[np.unique(mesh.faces)], mesh.triangles.mean(axis=1)])
        self.depth = np.zeros(len(self.points))
        if self.shell is not None:
            some = np.unique(np.linspace(0, len(mesh.faces) - 1, MOST_FACES).astype(int))
            behind = float(mesh.extent.max()) * 0.5 ** np.arange(1, HALVINGS + 1)[:, None, None]
            inner = mesh.triangles[some].mean(axis=1) - behind * face_normals(mesh.vertices, mesh.faces[some])
            inner = np.concatenate([inner.reshape(-1, 3), mesh.bounds.mean(axis=0)[None]])
            depth = -mesh_signed_distance(self.shell, inner)
            self.points = np.concatenate([self.points, inner[depth > 0.0]])
            self.depth = np.concatenate([self.depth, depth[depth > 0.0]])

    def depth_of(self, other: "Solid") -> float:
        """Compute how deep another mesh is in this one [m] by its points; 0 outside, or where this encloses nothing."""
        low, high = self.bounds
        at = np.flatnonzero(((other.points > low) & (other.points < high)).all(axis=1))
        if self.shell is None or not len(at):
            return 0.0
        away = mesh_signed_distance(self.shell, other.points[at])
        return float(np.where(away < 0.0, other.depth[at] - away, 0.0).max())


def overlap(one: Solid, two: Solid) -> float:
    """Compute how deep two meshes are in each other [m]; 0 apart."""
    crossings = (_crossing(*pairs).max(initial=0.0) for pairs in _near(one.triangles, two.triangles))
    return max(one.depth_of(two), two.depth_of(one), *map(float, crossings), 0.0)


def _near(one: FloatArray, two: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the triangles whose boxes meet, in pairs, (K, 3, 3) each, of (N, 3, 3) and (M, 3, 3)."""
    (low, high), (there, beyond) = ((corners.min(axis=1), corners.max(axis=1)) for corners in (one, two))
    order = np.argsort(low[:, np.ptp(low, axis=0).argmax()], kind="stable")
    for rows in np.array_split(order, -(-len(one) // TOGETHER)):
        near = (there <= high[rows].max(axis=0)) & (beyond >= low[rows].min(axis=0))
        at = np.flatnonzero(near.all(axis=1))
        meets = (low[rows, None] <= beyond[at]) & (high[rows, None] >= there[at])
        i, j = np.nonzero(meets.all(axis=2))
        yield one[rows[i]], two[at[j]]


def _crossing(one: FloatArray, two: FloatArray) -> FloatArray:
    """Compute the least shift that takes each triangle out of another one [m], (K, 3, 3) each; 0 of those apart."""
    edges = [np.roll(corners, -1, axis=1) - corners for corners in (one, two)]
    pairs = [(each[:, 0], each[:, 1]) for each in edges]
    pairs += [(edges[0][:, i], edges[1][:, j]) for i in range(3) for j in range(3)]
    least = np.full(len(one), np.inf)
    for first, second in pairs:
        axis = np.cross(first, second)
        size = np.linalg.norm(axis, axis=1)
        known = size > PARALLEL * np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
        along = axis / np.where(known, size, 1.0)[:, None]
        here, there = ((corners @ along[:, :, None])[:, :, 0] for corners in (one, two))
        shift = np.minimum(here.max(axis=1) - there.min(axis=1), there.max(axis=1) - here.min(axis=1))
        least = np.minimum(least, np.where(known, shift, np.inf))
    return np.where(np.isfinite(least), least.clip(min=0.0), 0.0)


def raised(bodies: Sequence[Body]) -> tuple[Body, ...]:
    """Return bodies of which free ones that stand on others are raised until their leaf spheres are apart.

    Spheres that cover two solids that touch reach into each other. A body is raised by at most `MOST_RAISED`, and stays
    where it is if it shares a joint.
    """
    joined = {name for body in bodies if body.joint for name in (body.name, body.joint.on)}
    found: dict[str, Body] = {}
    for body in sorted(bodies, key=lambda body: float(body.placed_mesh.bounds[0, 2])):
        motion = body.motion
        if isinstance(motion, Free) and body.name not in joined:
            way = max((_rise(body.placed_tree, one.placed_tree) for one in found.values()), default=0.0)
            if 0.0 < way <= MOST_RAISED:
                (x, y, z), shift = motion.center, np.array([0.0, 0.0, way])
                motion = replace(motion, center=(x, y, z + way))
                body = replace(body, position=body.position + shift, motion=motion)
        found[body.name] = body
    return tuple(found[body.name] for body in bodies)


def _rise(upper: SphereTree, lower: SphereTree) -> float:
    """Return by how much a tree has to rise until none of its leaf spheres is in those of another one [m]."""
    apart = upper.leaf_center[:, None] - lower.leaf_center[None]
    reach = upper.leaf_radius[:, None] + lower.leaf_radius[None] + CLEARANCE
    height = reach**2 - (apart[..., :2] ** 2).sum(axis=-1)
    inside = (apart**2).sum(axis=-1) < (reach - CLEARANCE) ** 2
    if not inside.any():
        return 0.0
    near = height > 0.0
    return float((np.sqrt(height[near]) - apart[near, 2]).max())
