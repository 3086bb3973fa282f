"""Distances of the hand to leaf spheres, triangles and the true mesh by the collision library coal.

Coal has no round cones but balls: the cone's distance is the minimum of d(x(s)) − r(s) along its axis, with the
distance d, which is convex for a sphere or a triangle. For a mesh, coal's minimum of d over a piece of the axis gives a
lower bound, its location an upper one; the piece with the lowest bound is halved until they meet.
"""

import heapq
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, MeshError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.verify.contacts import BODIES, PALM
from hhsim.verify.kinematics import rotations

CLOSE = 1e-8
"""Tolerance of the bounds of a phalanx's distance [m]."""
_MOST_PIECES = 200
EXACT = 1e-9
"""Tolerance of a distance [m]."""
NO_AREA = 1e-12
"""Ratio of a triangle's height to its longest side below which it is a line; less than `EXACT` is lost on it."""
NEEDLE = 1e-7
"""Ratio of a triangle's height to its longest side below which it is a line."""
INSIDE = 0.5
"""Winding number of closed triangles above which a point is inside: 1 inside, 0 outside."""

Shape = tuple[Any, Any]
"""Shape of coal and its placement."""


class HandReferee:
    """Distances of hands to one mesh [m], world, as of `TrueSurface`, which says what `open_too` is, and the errors."""

    def __init__(self, mesh: Mesh, *, open_too: bool = False) -> None:
        import coal

        self.surface = TrueSurface(mesh, open_too=open_too)
        self._coal: Any = coal
        self._request, self._answer, self._still = coal.DistanceRequest(), coal.DistanceResult(), coal.Transform3s()
        self._request.gjk_tolerance = 1e-12

    def clearances(self, shape: HandShape, placed: PlacedHand, limit: float) -> FloatArray:
        """Signed distance [m] of each body to the mesh at each tick, at most `limit` [m], shape (T, 16).

        Exact outside. A phalanx whose axis is inside, or passes through the surface, counts as deep as its radius.
        """
        found = np.full((len(placed.joints), BODIES), limit)
        spheres = len(shape.palm_radius)
        # A body is no nearer than its last bound by more than it moved since.
        bound, at = np.full(PALM + spheres, -np.inf), np.zeros((PALM + spheres, 2, 3))
        thinnest = np.concatenate(
            [np.minimum(shape.phalanx_radius[:, :3], shape.phalanx_radius[:, 1:]).ravel(), shape.palm_radius]
        )
        turned = rotations(placed.orientation)[0].as_matrix()
        palms = np.einsum("tij,pj->tpi", turned, shape.palm_center) + placed.position[:, None]
        for tick, (joints, palm) in enumerate(zip(placed.joints, palms)):
            phalanges = np.stack([joints[:, :3], joints[:, 1:]], axis=2).reshape(PALM, 2, 3)
            ends = np.concatenate([phalanges, np.repeat(palm[:, None], 2, axis=1)])
            least = bound - np.sqrt(((ends - at) ** 2).sum(axis=2)).max(axis=1) - CLOSE
            near = np.flatnonzero(~(least >= limit))
            at[near] = ends[near]
            # An axis that moved less than the distance to the surface has stayed outside.
            inside = np.zeros(len(bound), bool)
            unsure = near[~(least[near] + thinnest[near] > 0.0)]
            if unsure.size:
                inside[unsure] = self.surface.signed_distance(ends[unsure].mean(axis=1)) < 0.0
            for body in near[near < PALM].tolist():
                f, k = divmod(body, 3)
                radii = float(shape.phalanx_radius[f, k]), float(shape.phalanx_radius[f, k + 1])
                bound[body] = self._round_cone(joints[f, k], joints[f, k + 1], radii, limit, bool(inside[body]))
                found[tick, body] = min(limit, bound[body])
            of_palm = near[near >= PALM]
            if of_palm.size:
                distance = nearest_on(self.surface.model, ends[of_palm, 0])[0]
                bound[of_palm] = np.where(inside[of_palm], -distance, distance) - thinnest[of_palm]
                found[tick, PALM] = min(limit, float(bound[of_palm].min()))
        return found

    def round_cone(self, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, limit: float) -> float:
        """Signed distance [m] of the hull of two balls to the mesh, or `limit`; see `clearances`."""
        inside = bool(self.surface.signed_distance(0.5 * (a + b)[None])[0] < 0.0)
        return min(limit, self._round_cone(a, b, (radius_a, radius_b), limit, inside))

    def _round_cone(
        self, a: FloatArray, b: FloatArray, radii: tuple[float, float], limit: float, inside: bool
    ) -> float:
        """Signed distance for a known side of the axis's middle; a lower bound from `limit` on."""

        def radius(share: float) -> float:
            return (1.0 - share) * radii[0] + share * radii[1]

        def piece(low: float, high: float) -> tuple[float, float, float]:
            """Lower and upper bound of the axis from share `low` to `high`, and its own distance."""
            first, last = (1.0 - low) * a + low * b, (1.0 - high) * a + high * b
            axis = last - first
            squared = float(axis @ axis)
            self._answer.clear()
            segment = self._coal.Capsule(0.0, math.sqrt(squared))
            place = self._coal.Transform3s(frame_along(axis), 0.5 * (first + last))
            arguments = self.surface.model, self._still, segment, place, self._request, self._answer
            # 0 where the axis passes through the mesh.
            distance = max(0.0, float(self._coal.distance(*arguments)))
            along = float((self._answer.getNearestPoint2() - first) @ axis) / max(squared, 1e-300)
            where = low + (high - low) * min(max(along, 0.0), 1.0)
            reached = radius(where)
            return distance - max(radius(low), radius(high), reached), distance - reached, distance

        bound, best, nearest = piece(0.0, 1.0)
        # A point inside may be farther from the surface than the limit.
        if nearest <= 0.0 or inside:
            return -max(radii)
        if bound >= limit:
            return bound
        pieces = [(bound, 0.0, 1.0)]
        for _ in range(_MOST_PIECES):
            bound, low, high = heapq.heappop(pieces)
            if bound >= min(limit, best - CLOSE):
                return bound if bound >= limit else best
            for half in ((low, 0.5 * (low + high)), (0.5 * (low + high), high)):
                lower, reached, _ = piece(*half)
                best = min(best, reached)
                heapq.heappush(pieces, (lower, *half))
        return best


def require_coal() -> None:
    """Raise InputError if coal is not installed."""
    try:
        import coal  # noqa: F401
    except ImportError as error:
        raise InputError(
            "distances to the true mesh are measured with coal, which is not installed: pip install 'hhsim[verify]'"
        ) from error


def coal_model(vertices: FloatArray, faces: IntArray) -> Any:
    """Build coal's bounding-volume hierarchy of a mesh."""
    import coal

    model: Any = coal.BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addVertices(np.array(vertices))
    model.addTriangles(np.array(faces))
    model.endModel()
    return model


def sphere_shapes(center: FloatArray, radius: FloatArray) -> Callable[[int], Shape]:
    """Return a function from a sphere's index to its shape; centres [m] (L, 3), radii [m] (L,)."""
    import coal

    return lambda i: (coal.Sphere(float(radius[i])), coal.Transform3s(np.eye(3), np.array(center[i])))


def triangle_shapes(mesh: Mesh) -> Callable[[int], Shape]:
    """Return a function from a triangle's index to its shape: a hierarchy of one triangle, or a line without area.

    Coal has no distance of a lone triangle, and none of one without area.
    """
    import coal

    def shape(i: int) -> Shape:
        corners = mesh.triangles[i]
        sides = np.roll(corners, -1, axis=0) - corners
        square = (sides * sides).sum(axis=1)
        longest = int(square.argmax())
        if np.linalg.norm(np.cross(sides[0], sides[1])) <= NO_AREA * square[longest]:
            middle = corners[longest] + 0.5 * sides[longest]
            length = math.sqrt(square[longest])
            return coal.Capsule(0.0, length), coal.Transform3s(frame_along(sides[longest]), middle)
        return coal_model(corners, np.array([[0, 1, 2]])), coal.Transform3s()

    return shape


def coal_distance(a: FloatArray, b: FloatArray, radius_a: float, radius_b: float, shape: Any, place: Any) -> float:
    """Compute the signed distance [m] of the hull of two balls to a shape of coal, at most `EXACT` too large.

    `a`, `b` are the centres of the balls [m], shape (3,), with their radii [m].
    """
    import coal
    from scipy.optimize import minimize_scalar

    request, answer, ball, there = coal.DistanceRequest(), coal.DistanceResult(), coal.Sphere(0.0), coal.Transform3s()
    request.gjk_tolerance = 1e-12

    def distance(share: float) -> float:
        there.setTranslation(a + share * (b - a))
        answer.clear()
        radius = (1.0 - share) * radius_a + share * radius_b
        return float(coal.distance(shape, place, ball, there, request, answer)) - radius

    ends = min(distance(0.0), distance(1.0))
    if np.array_equal(a, b):
        return ends
    # The search looks between the ends, and does not reach them.
    return min(ends, float(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).fun))


def frame_along(axis: FloatArray) -> FloatArray:
    """Return a rotation that turns z along an axis [m], shape (3, 3), by Duff et al. (2017); the identity for none."""
    x, y, z = axis.tolist()
    length = math.hypot(x, y, z)
    if length == 0.0:
        return np.eye(3)
    x, y, z = x / length, y / length, z / length
    sign = math.copysign(1.0, z)
    slope = -1.0 / (sign + z)
    both = x * y * slope
    return np.array([[1.0 + sign * x * x * slope, both, x], [sign * both, sign + y * y * slope, y], [-sign * x, -y, z]])


class TrueSurface:
    """Signed distance to a watertight mesh: coal's, with the sign of pseudonormals (Bærentzen and Aanæs 2005).

    Args:
        mesh: [m].
        open_too: Accept a mesh that is not watertight: no distance is negative, and triangles below `NEEDLE`, of which
            coal has no distances, are left out. If a closed one cuts through itself, the winding number has the sign.

    Raises:
        InputError: coal is not installed.
        MeshError: The mesh is not watertight.
    """

    def __init__(self, mesh: Mesh, *, open_too: bool = False) -> None:
        import trimesh

        require_coal()
        self._as_found = open_too
        if open_too:
            a, b, c = mesh.triangles.transpose(1, 0, 2)
            longest = np.linalg.norm(np.stack([b - a, c - b, a - c]), axis=2).max(axis=0)
            high = np.linalg.norm(np.cross(b - a, c - a), axis=1) > NEEDLE * longest
            mesh = replace(mesh, faces=mesh.faces[high]) if high.any() and not high.all() else mesh
        self.triangles = mesh.triangles
        self.model = coal_model(mesh.vertices, mesh.faces)
        self._faces = mesh.faces
        self._low, self._high = self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))
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

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Signed distance [m] of points (n, 3): negative inside a watertight mesh; shape (n,)."""
        distance, nearest, face = nearest_on(self.model, points)
        if not self.closed:
            return distance
        outward = ((points - nearest) * self._pseudonormal(nearest, face)).sum(axis=1) >= 0.0
        # Of a mesh that cuts through itself the nearest face may look the other way.
        outward |= ((points < self._low) | (points > self._high)).any(axis=1)
        if self._as_found:
            left = np.flatnonzero(~outward)
            while len(left):
                # Within its distance of a point all are on one side of every face.
                first = left[distance[left].argmax()]
                same = np.linalg.norm(points[left] - points[first], axis=1) < distance[first]
                same[left == first] = True
                outward[left[same]] = winding_number(self.triangles, points[first]) < INSIDE
                left = left[~same]
        return np.where(outward, distance, -distance)

    def _pseudonormal(self, nearest: FloatArray, face: IntArray) -> FloatArray:
        """Normal of the face, edge or vertex that a point of a face lies on."""
        a, b, c = self.triangles[face].transpose(1, 0, 2)
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


def nearest_on(model: Any, points: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Distances [m] (n,) of points (n, 3) to coal's model of a mesh, its nearest points (n, 3), their faces (n,)."""
    import coal

    point, still, place = coal.Sphere(0.0), coal.Transform3s(), coal.Transform3s()
    request, answer = coal.DistanceRequest(), coal.DistanceResult()
    distance, nearest, face = np.empty(len(points)), np.empty((len(points), 3)), np.empty(len(points), np.int64)
    for i, p in enumerate(points):
        place.setTranslation(p)
        answer.clear()
        distance[i] = coal.distance(model, still, point, place, request, answer)
        nearest[i], face[i] = answer.getNearestPoint1(), answer.b1
    return distance, nearest, face


def winding_number(corners: FloatArray, point: FloatArray) -> float:
    """Winding number of triangles (F, 3, 3) around a point (3,), by Van Oosterom & Strackee (1983)."""
    a, b, c = (corners - point).transpose(1, 0, 2)
    x, y, z = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("fi,fi->f", a, np.cross(b, c))
    rest = x * y * z
    rest += np.einsum("fi,fi->f", a, b) * z + np.einsum("fi,fi->f", b, c) * x + np.einsum("fi,fi->f", c, a) * y
    return float(np.arctan2(volume, rest).sum() / (2.0 * np.pi))
