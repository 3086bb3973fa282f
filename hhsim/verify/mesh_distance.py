"""Distances of points and hands to the true mesh by NumPy and SciPy, apart from the kernels.

The balls around the triangles, in k-d trees, tell which triangles may be nearest; the distances to these are in closed
form, those of a phalanx by bisection on its axis (`hhsim.verify.contacts`).
"""

from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.mesh import Mesh
from hhsim.verify.contacts import BODIES, PALM, Pieces, RoundCones, cones_near_triangles, round_cones
from hhsim.verify.kinematics import rotations

if TYPE_CHECKING:
    from hhsim.hand.forward_kinematics import PlacedHand
    from hhsim.kernels.hand.hand_shape import HandShape

CLOSE = 1e-8
"""Tolerance of a hand's depth in a mesh [m]."""
INSIDE = 0.5
"""Winding number of closed triangles above which a point is inside: 1 inside, 0 outside."""
POINTS, HANDS = 1024, 64
"""Points and hands measured at once, to bound the memory."""
ROUNDING = 1e-12
"""Slack of a bound of distances [m]."""


class TrueSurface:
    """Signed distance to a watertight mesh, with the sign of pseudonormals (Bærentzen and Aanæs 2005).

    Args:
        mesh: [m].
        open_too: Accept a mesh that is not watertight: no distance is negative. If a closed one cuts through itself,
            the winding number has the sign.

    Raises:
        MeshError: The mesh is not watertight.
    """

    def __init__(self, mesh: Mesh, *, open_too: bool = False) -> None:
        import trimesh

        self._as_found = open_too
        self.corners, self.pieces, self._faces = mesh.triangles, Pieces.of_triangles(mesh.triangles), mesh.faces
        self.low, self.high = self.corners.min(axis=(0, 1)), self.corners.max(axis=(0, 1))
        # In millimetres: trimesh's tolerances are of lengths like those.
        found = trimesh.Trimesh(1e3 * mesh.vertices, mesh.faces, process=False)
        self.closed = bool(found.is_volume)
        if not self.closed and not open_too:
            raise MeshError(
                f"{mesh.name}: not watertight and wound outward, so that nothing is outside of it; the referee needs it"
            )
        self.normal, self.vertex_normal = np.array(found.face_normals), np.array(found.vertex_normals)
        self._edge_of = np.array(found.faces_unique_edges)
        self.edge_normal = np.zeros((len(found.edges_unique), 3))
        np.add.at(self.edge_normal, self._edge_of, self.normal[:, None])

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Distances [m] (n,) of points (n, 3) to the triangles, the nearest points (n, 3), and their triangles (n,)."""
        parts = [self._nearest(points[i : i + POINTS]) for i in range(0, max(len(points), 1), POINTS)]
        distance, nearest, face = (np.concatenate(values) for values in zip(*parts))
        return distance, nearest, face

    def _nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        every, bound = np.arange(len(points)), np.full(len(points), np.inf)
        for piece in self.pieces.nearest(points).T:
            away = self.pieces.away(piece, points)
            bound = np.minimum(bound, np.sqrt((away * away).sum(axis=0)))
        bound += ROUNDING
        row, piece = self.pieces.within(points, bound)
        kept = np.linalg.norm(points[row] - self.pieces.center[piece], axis=1) <= bound[row] + self.pieces.radius[piece]
        row, piece = row[kept], piece[kept]
        away = self.pieces.away(piece, points[row]).T
        distance = np.linalg.norm(away, axis=1)
        order = np.lexsort((piece, distance, row))
        first = order[np.searchsorted(row[order], every)]
        return distance[first], points - away[first], piece[first]

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Signed distance [m] of points (n, 3): negative inside a watertight mesh; shape (n,)."""
        distance, nearest, face = self.nearest(points)
        if not self.closed:
            return distance
        outward = ((points - nearest) * self._pseudonormal(nearest, face)).sum(axis=1) >= 0.0
        # Of a mesh that cuts through itself the nearest face may look the other way.
        outward |= ((points < self.low) | (points > self.high)).any(axis=1)
        if self._as_found:
            left = np.flatnonzero(~outward)
            while len(left):
                # Within its distance of a point all are on one side of every face.
                first = left[distance[left].argmax()]
                same = np.linalg.norm(points[left] - points[first], axis=1) < distance[first]
                same[left == first] = True
                outward[left[same]] = winding_number(self.corners, points[first]) < INSIDE
                left = left[~same]
        return np.where(outward, distance, -distance)

    def clearances(self, shape: "HandShape", placed: "PlacedHand", limit: float) -> FloatArray:
        """Signed distance [m] of each body of hands to the mesh at each tick, at most `limit` [m], shape (T, 16).

        Exact outside. No phalanx is deeper than its radius: the larger one where its axis's middle is inside, else that
        where its axis passes through the surface.
        """
        found = np.empty((len(placed.joints), BODIES))
        radius, palm_radius = np.asarray(shape.phalanx_radius), np.asarray(shape.palm_radius)
        for start in range(0, len(found), HANDS):
            joints, position, orientation = placed.at(slice(start, start + HANDS))
            turned = rotations(orientation)[0].as_matrix()
            palm = np.einsum("tij,pj->tpi", turned, shape.palm_center) + position[:, None]
            cones = self.round_cones(round_cones(joints, palm, radius, palm_radius), limit).reshape(len(joints), -1)
            found[start : start + HANDS, :PALM] = cones[:, :PALM]
            found[start : start + HANDS, PALM] = cones[:, PALM:].min(axis=1)
        return found

    def round_cones(self, cones: RoundCones, limit: float) -> FloatArray:
        """Signed distance [m] of round cones to the mesh, at most `limit` [m], shape (N,); see `clearances`."""
        a, b, thick = cones.a, cones.b, cones.thick
        middle, half = 0.5 * (a + b), 0.5 * np.linalg.norm(b - a, axis=1)
        found = np.full(len(a), limit)
        # Nothing is nearer than the box around the mesh.
        box = np.linalg.norm(np.maximum(np.maximum(self.low - middle, middle - self.high), 0.0), axis=1)
        near = np.flatnonzero(box - half - thick < limit)
        of_middle = self.signed_distance(middle[near])
        # A ball is as deep as its centre; an axis has no depth but its radius.
        point = half[near] == 0.0
        found[near[point]] = np.minimum(of_middle - thick[near], limit)[point]
        inside = near[~point & (of_middle < 0.0)]
        found[inside] = -thick[inside]
        near, of_middle = near[~point & (of_middle >= 0.0)], of_middle[~point & (of_middle >= 0.0)]
        some = cones.at(near)
        reach = np.minimum(limit, of_middle - 0.5 * (some.radius_a + some.radius_b))
        row, _, _, distance = cones_near_triangles(some, self.pieces, reach + ROUNDING)
        np.minimum.at(found, near[row], distance)
        return found

    def _pseudonormal(self, nearest: FloatArray, face: IntArray) -> FloatArray:
        """Normal of the face, edge or vertex that a point of a face lies on."""
        a, b, c = self.corners[face].transpose(1, 0, 2)
        area = np.maximum(np.linalg.norm(np.cross(b - a, c - a), axis=1), np.finfo(float).tiny)
        opposite = ((b, c), (c, a), (a, b))
        share = [np.linalg.norm(np.cross(v - u, nearest - u), axis=1) / area for u, v in opposite]
        gone = np.stack(share, axis=1) < 1e-7
        found: FloatArray = self.normal[face]
        for k in range(3):
            # Corner k has no share in a point on the opposite edge.
            on_edge = gone[:, k] & (gone.sum(axis=1) == 1)
            found[on_edge] = self.edge_normal[self._edge_of[face[on_edge], (k + 1) % 3]]
            on_vertex = ~gone[:, k] & (gone.sum(axis=1) >= 2)
            found[on_vertex] = self.vertex_normal[self._faces[face[on_vertex], k]]
        return found


def winding_number(corners: FloatArray, point: FloatArray) -> float:
    """Winding number of triangles (F, 3, 3) around a point (3,), by Van Oosterom & Strackee (1983)."""
    a, b, c = (corners - point).transpose(1, 0, 2)
    x, y, z = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("fi,fi->f", a, np.cross(b, c))
    rest = x * y * z
    rest += np.einsum("fi,fi->f", a, b) * z + np.einsum("fi,fi->f", b, c) * x + np.einsum("fi,fi->f", c, a) * y
    return float(np.arctan2(volume, rest).sum() / (2.0 * np.pi))
