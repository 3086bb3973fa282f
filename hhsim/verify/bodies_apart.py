"""Claim that no body is in another one, at the poses of the file.

An edge that pierces a triangle is out of it after the least shift to a face of the prism that both span. A point inside
of one body is out of another one after its depths in both, also where their surfaces coincide, or do not meet.
"""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.mesh.mesh import Mesh
from hhsim.result.reader import Result
from hhsim.verify.claim import Claim, judged
from hhsim.verify.kinematics import rotations
from hhsim.verify.mesh_distance import TrueSurface

LOOKED_AT = 1000
"""Ticks in which the bodies are looked for in each other."""
CLEAR = 5e-7
"""Clearance of contacts [m]."""
BEHIND, MOST_FACES = 0.5 ** np.arange(1, 13)[:, None, None], 100
"""Points inside are so far behind a face, in lengths of the body, and about so many faces have some."""


class _Solid:
    """Mesh of a body, its surface, and points on it and in it with their depths [m], in its frame at the start."""

    def __init__(self, mesh: Mesh) -> None:
        self.bounds, self.shell = mesh.bounds, TrueSurface(mesh, open_too=True)
        self.triangles = self.shell.corners
        middle, step = self.triangles.mean(axis=1), max(1, len(self.triangles) // MOST_FACES)
        inner = middle[::step] - float(mesh.extent.max()) * BEHIND * self.shell.normal[::step]
        on, inner = np.concatenate([mesh.vertices[np.unique(mesh.faces)], middle]), inner.reshape(-1, 3)
        depth = -self.shell.signed_distance(inner)
        self.points, self.depth = np.vstack([on, inner[depth > 0.0]]), np.append(np.zeros(len(on)), depth[depth > 0.0])

    def depths_of(self, other: "_Solid", turn: FloatArray, shift: FloatArray) -> FloatArray:
        """Depth of another body [m], by its points and edges, at poses in this one's frame, (T, 3, 3) and (T, 3)."""
        depth, last, room = np.zeros(len(turn)), np.zeros_like(other.points), np.zeros(len(other.points))
        # What is deeper than the clearance is as far within the bounds.
        low, high = self.bounds + [[CLEAR], [-CLEAR]]
        for t, (rotation, place) in enumerate(zip(turn, shift)):
            if t and np.array_equal(place, shift[t - 1]) and np.array_equal(rotation, turn[t - 1]):
                depth[t] = depth[t - 1]
                continue
            seen = other.points @ rotation.T + place
            near = np.flatnonzero(((seen > low) & (seen < high)).all(axis=1))
            # A point that has moved by less than it was away from the surface is still outside.
            near = near[np.linalg.norm(seen[near] - last[near], axis=1) >= room[near]]
            last[near], room[near] = seen[near], self.shell.signed_distance(seen[near])
            near = near[room[near] < 0.0]
            mine, theirs = self._overlapping(other.triangles @ rotation.T + place)
            pierced = _pierced(mine, theirs)
            depth[t] = max((other.depth[near] - room[near]).max(initial=0.0), pierced.max(initial=0.0))
        return depth

    def _overlapping(self, others: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pairs of a triangle and one of `others` (M, 3, 3) whose boxes overlap, (K, 3, 3) each."""
        low, high = others.min(axis=1), others.max(axis=1)
        others = others[((low <= self.bounds[1]) & (high >= self.bounds[0])).all(axis=1)]
        middle = others.mean(axis=1)
        radius = np.linalg.norm(others - middle[:, None], axis=2).max(axis=1)
        row, piece = self.shell.places.within(middle, radius)
        mine, theirs = self.triangles[piece], others[row]
        apart = (mine.min(axis=1) > theirs.max(axis=1)) | (theirs.min(axis=1) > mine.max(axis=1))
        kept = ~apart.any(axis=1)
        return mine[kept], theirs[kept]


def _pierced(corners: FloatArray, other: FloatArray) -> FloatArray:
    """Compute the least shift that takes each edge of other triangles out of a triangle [m], (K, 3, 3) each, (K, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None]
    ends = [_height(across, place - corners[:, :1]) for place in (other, np.roll(other, -1, axis=1))]
    # Of each edge and each side of the triangle.
    a, b, c = (np.roll(corners, -i, axis=1)[:, None] for i in range(3))
    beside = np.cross(b - a, (np.roll(other, -1, axis=1) - other)[:, :, None])
    sides = np.sign((beside * (c - a)).sum(axis=-1)) * _height(beside, other[:, :, None] - a)
    return np.asarray(np.minimum(sides.min(axis=2), np.minimum(np.maximum(*ends), -np.minimum(*ends))))


def _height(normal: FloatArray, vector: FloatArray) -> FloatArray:
    size = np.linalg.norm(normal, axis=-1)
    return np.asarray((normal * vector).sum(axis=-1) / np.where(size > 0.0, size, np.inf))


def bodies_apart_claim(result: Result, pairs: Sequence[tuple[int, int]]) -> Claim:
    """Judge that one body is not in another one, by pairs of their numbers in both orders."""
    ticks = np.unique(np.linspace(0, result.ticks - 1, LOOKED_AT).astype(int))
    bodies = [_Solid(Mesh(body.vertices, body.faces)) for body in result.bodies.values()]
    moved = [(rotations(of.turn[ticks])[0].as_matrix(), of.shift[ticks]) for of in result.meshes_moved()]
    depth = np.zeros(len(ticks))
    for one, other in pairs:
        back, ((_, at), (turn, place)) = moved[one][0].swapaxes(1, 2), (moved[one], moved[other])
        shift = (back @ (place - at)[:, :, None])[:, :, 0]
        depth = np.maximum(depth, bodies[one].depths_of(bodies[other], back @ turn, shift))
    says = f"no body is in another one, by edges and points of both in {len(ticks)} ticks"
    return judged("bodies apart", says, depth, CLEAR, "m", "the clearance", ticks=ticks)
