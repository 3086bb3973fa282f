"""The convex pieces of what a hand touches, leaf spheres or triangles, and their distances to its bodies: brute force.

What a run by trees reports is held against it, and the judge of stuck ticks measures by it. A triangle's distance to
the ball at a place of a phalanx's axis is convex along the axis, so its slope is bisected; its nearest point is
trimesh's, and what is inside of triangles is told by their winding number. No hierarchy, and none of the kernels.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.errors import InputError
from hhsim.hand.fingers import PHALANGES
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.brute_force_distance import palm_spheres, round_cone_distance
from hhsim.trees.contact_surface import encloses
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_contacts import away_from_triangles, nearest_share, ready_triangles

Array = NDArray[np.float64]

INSIDE = 0.5
"""Winding number of closed triangles from here on: 1 inside, 0 outside, but for rounding."""


class Body(NamedTuple):
    """A phalanx of a hand, or one of its palm's spheres.

    | field | meaning | shape |
    |---|---|---|
    | ends | of the axis [m], world; a sphere has its centre twice | (2, 3) |
    | radius | there [m] | (2,) |
    """

    ends: Array
    radius: Array

    @property
    def is_sphere(self) -> bool:
        """Whether both ends are one."""
        return bool((self.ends[0] == self.ends[1]).all())


class Pieces(Protocol):
    """Convex pieces of an object's surface, world."""

    def near(self, body: Body, limit: float) -> "Pieces":
        """Those that are no farther than `limit` [m]; one that is can be among them."""

    def distances(self, places: Sequence[Body]) -> Array:
        """Signed distances [m] of one body at several places, and of parts of it, to each piece, shape (P, M).

        It is clear of the pieces where none is negative; M is their number or a multiple of it.
        """

    def least(self, body: Body) -> float:
        """Signed distance of the body to the object [m], negative inside of it; infinite without a piece."""


def hand_bodies(shape: HandShape, joints: ArrayLike, position: ArrayLike, orientation: ArrayLike) -> list[Body]:
    """All bodies of one hand: the 15 phalanges, then the palm's spheres.

    Args:
        shape: Its sizes.
        joints: [m], world, shape (5, 4, 3).
        position: Of the palm [m], world, shape (3,).
        orientation: Palm to world, unit (w, x, y, z), shape (4,).
    """
    joint = np.asarray(joints, np.float64)
    phalanges = [
        Body(joint[finger, k : k + 2], shape.phalanx_radius[finger, k : k + 2])
        for finger in range(len(joint))
        for k in range(PHALANGES)
    ]
    centers = palm_spheres(shape.palm_center, position, orientation)
    return phalanges + [
        Body(np.stack([place] * 2), np.full(2, size)) for place, size in zip(centers, shape.palm_radius)
    ]


def hand_distance(
    pieces: Pieces, shape: HandShape, joints: ArrayLike, position: ArrayLike, orientation: ArrayLike
) -> float:
    """Signed distance of one hand to an object [m], arguments as `hand_bodies`; NaN for a hand that is nowhere."""
    bodies = hand_bodies(shape, joints, position, orientation)
    return float(np.min([pieces.least(body) if np.isfinite(body.ends).all() else np.nan for body in bodies]))


def pieces_of(surface: str, mesh: Mesh | None, tree: SphereTree | None) -> Pieces:
    """The pieces of the surface that an option names, in the frame of mesh and tree.

    Raises:
        InputError: The object has no such surface.
    """
    if surface == "spheres" and tree is not None:
        return Leaves(np.asarray(tree.leaf_center), np.asarray(tree.leaf_radius))
    if surface == "mesh" and mesh is not None:
        return Triangles(mesh.triangles, closed=encloses(mesh))
    raise InputError(f"this object has no {surface}")


class Leaves:
    """Leaf spheres: centres [m], shape (N, 3), and radii [m], shape (N,)."""

    def __init__(self, center: Array, radius: Array) -> None:
        self._center, self._radius = center, radius

    def near(self, body: Body, limit: float) -> "Leaves":
        """Exactly those."""
        chosen = self._of(body) <= limit
        return Leaves(self._center[chosen], self._radius[chosen])

    def distances(self, places: Sequence[Body]) -> Array:
        """One a sphere."""
        return np.stack([self._of(body) for body in places])

    def least(self, body: Body) -> float:
        """Over all spheres."""
        return float(self._of(body).min(initial=np.inf))

    def _of(self, body: Body) -> Array:
        first, last = body.ends
        size, other = map(float, body.radius)
        if body.is_sphere:
            apart: Array = np.linalg.norm(self._center - first, axis=1) - self._radius - size
            return apart
        return round_cone_distance(self._center, first, last, size, other) - self._radius


class Triangles:
    """Triangles: corners [m], shape (F, 3, 3); `closed` where they enclose something."""

    def __init__(self, corners: Array, closed: bool = False) -> None:
        # What has no area has neighbours that it lies on.
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._corners = corners[(across != 0.0).any(axis=1)]
        self._closed = closed
        self._middle = self._corners.mean(axis=1)
        self._around = np.linalg.norm(self._corners - self._middle[:, None], axis=2).max(axis=1, initial=0.0)

    def near(self, body: Body, limit: float) -> "Triangles":
        """Those whose ball reaches a ball around the body within the limit."""
        return Triangles(self._corners[self._bounds(body) <= limit], self._closed)

    def distances(self, places: Sequence[Body]) -> Array:
        """Of a sphere one a triangle; of a phalanx three: its least, and those of the balls at its ends.

        A phalanx that lies flat touches along a line, and what is least of it says nothing of its other end.
        """
        ends = (0.0,) if places[0].is_sphere else (0.0, 1.0)
        parts = [self._at(places, np.full((len(places), len(self._corners)), end)) for end in ends]
        if not places[0].is_sphere:
            parts.append(self._at(places, self._share(places)))
        return np.concatenate(parts, axis=1)

    def least(self, body: Body) -> float:
        """Over all triangles; where the place of the body that is nearest to one is inside, on the other side of it."""
        if len(self._corners) == 0:
            return np.inf
        # A triangle is no farther than its middle is from the ball at an end.
        most = float((np.linalg.norm(self._middle - body.ends[0], axis=1) - body.radius[0]).min())
        near = self.near(body, most)
        share = np.zeros((1, len(near._corners))) if body.is_sphere else near._share([body])
        share, distance = share[0], near._at([body], share)[0]
        nearest = int(distance.argmin())
        size = float(body.radius[0] + share[nearest] * (body.radius[1] - body.radius[0]))
        place = body.ends[0] + share[nearest] * (body.ends[1] - body.ends[0])
        outside = not self._closed or winding_number(self._corners, place) < INSIDE
        return float(distance[nearest] if outside else -distance[nearest] - 2.0 * size)

    def _bounds(self, body: Body) -> Array:
        middle, half = body.ends.mean(axis=0), 0.5 * np.linalg.norm(body.ends[1] - body.ends[0])
        return np.asarray(np.linalg.norm(self._middle - middle, axis=1) - self._around - half - body.radius.max())

    def _share(self, places: Sequence[Body]) -> Array:
        first, axis, _, drop = self._paired(places)
        ready = ready_triangles(self._corners).at(np.tile(np.arange(len(self._corners)), len(places)))
        found: Array = nearest_share(first, axis, drop, ready).reshape(len(places), -1)
        return found

    def _at(self, places: Sequence[Body], share: Array) -> Array:
        first, axis, size, drop = self._paired(places)
        along = share.ravel()
        place = first + along[:, None] * axis
        ready = ready_triangles(self._corners).at(np.tile(np.arange(len(self._corners)), len(places)))
        apart = np.linalg.norm(away_from_triangles(ready, place.T), axis=0) - size - along * drop
        found: Array = apart.reshape(share.shape)
        return found

    def _paired(self, places: Sequence[Body]) -> tuple[Array, Array, Array, Array]:
        # Start, axis, radius at the start, and what it is more at the end: of every place with every triangle.
        ends = np.repeat(np.stack([body.ends for body in places]), len(self._corners), axis=0)
        radius = np.repeat(np.stack([body.radius for body in places]), len(self._corners), axis=0)
        return ends[:, 0], ends[:, 1] - ends[:, 0], radius[:, 0], radius[:, 1] - radius[:, 0]


def winding_number(corners: Array, point: Array) -> float:
    """How often triangles go around a point: the sum of their solid angles over 4π (Van Oosterom & Strackee, 1983).

    Args:
        corners: [m], shape (F, 3, 3).
        point: [m], shape (3,).
    """
    a, b, c = (corners - point).transpose(1, 0, 2)
    x, y, z = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("fi,fi->f", a, np.cross(b, c))
    rest = x * y * z
    rest += np.einsum("fi,fi->f", a, b) * z + np.einsum("fi,fi->f", b, c) * x + np.einsum("fi,fi->f", c, a) * y
    return float(np.arctan2(volume, rest).sum() / (2.0 * np.pi))
