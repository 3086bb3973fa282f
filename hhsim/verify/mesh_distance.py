"""Distances of the graphic hand to the true mesh by the library coal.

A phalanx is the union of balls with centre x(s) and radius r(s); its distance is the minimum of d(x(s)) − r(s), with
the mesh's distance d. Coal's minimum of d over a piece of the axis gives a lower bound, its location an upper one; the
piece with the lowest bound is halved until they meet.
"""

import heapq
import math
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.verify.coal_distance import frame_along
from hhsim.verify.contacts import BODIES, PALM
from hhsim.verify.kinematics import rotations
from hhsim.verify.tree_checks import TrueSurface, nearest_on

EXACT = 1e-8
"""Tolerance of the bounds of a phalanx's distance [m]."""
_MOST_PIECES = 200


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
            least = bound - np.sqrt(((ends - at) ** 2).sum(axis=2)).max(axis=1) - EXACT
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
            if bound >= min(limit, best - EXACT):
                return bound if bound >= limit else best
            for half in ((low, 0.5 * (low + high)), (0.5 * (low + high), high)):
                lower, reached, _ = piece(*half)
                best = min(best, reached)
                heapq.heappush(pieces, (lower, *half))
        return best
