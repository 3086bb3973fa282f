"""Brute-force distances of a hand's bodies to the convex pieces of an object: leaf spheres or triangles.

The judge of stuck ticks uses them. The distance of a triangle to the ball at a point of a phalanx's axis is convex
along the axis, so its slope is bisected. No hierarchy, and none of the kernels.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.hand.fingers import PHALANGES
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.brute_force_distance import palm_spheres, round_cone_distance
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.contacts import ReadyTriangles, away_from_triangles, nearest_share, ready_triangles


class Body(NamedTuple):
    """A phalanx of a hand or a sphere of its palm: axis ends [m], shape (2, 3), and radii there [m], shape (2,)."""

    ends: FloatArray
    radius: FloatArray

    @property
    def is_sphere(self) -> bool:
        """True if both ends are one."""
        return bool((self.ends[0] == self.ends[1]).all())


Pieces: TypeAlias = "Leaves | Triangles"
"""Convex pieces of an object's surface, world."""


def hand_bodies(shape: HandShape, joints: ArrayLike, position: ArrayLike, orientation: ArrayLike) -> list[Body]:
    """Return all bodies of one hand: the 15 phalanges, then the palm's spheres.

    Args:
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
    twice = (np.repeat(values[:, None], 2, axis=1) for values in (centers, shape.palm_radius))
    return phalanges + [Body(*sphere) for sphere in zip(*twice)]


def pieces_of(surface: str, mesh: Mesh | None, tree: SphereTree | None) -> Pieces:
    """Return the pieces of a surface by its name, in the frame of mesh and tree.

    Raises:
        InputError: The object has no such surface.
    """
    if surface == "spheres" and tree is not None:
        return Leaves(np.asarray(tree.leaf_center), np.asarray(tree.leaf_radius))
    if surface == "mesh" and mesh is not None:
        return Triangles(mesh.triangles)
    raise InputError(f"this object has no {surface}")


class Leaves:
    """Leaf spheres: centres [m], shape (N, 3), and radii [m], shape (N,)."""

    def __init__(self, center: FloatArray, radius: FloatArray) -> None:
        self._center, self._radius = center, radius

    def near(self, body: Body, limit: float) -> "Leaves":
        """Return exactly the spheres within the limit."""
        chosen = self._of(body) <= limit
        return Leaves(self._center[chosen], self._radius[chosen])

    def distances(self, places: Sequence[Body]) -> FloatArray:
        """Return signed distances [m] of a body at P places to each sphere, shape (P, N); clear if none is negative."""
        if len(self._radius) == 0:
            return np.zeros((len(places), 0))
        if places[0].is_sphere:
            place, size = (np.stack(values)[:, None, 0] for values in zip(*places))
            return np.asarray(np.linalg.norm(self._center - place, axis=2) - self._radius - size)
        return np.stack([self._of(body) for body in places])

    def _of(self, body: Body) -> FloatArray:
        first, last = body.ends
        size, other = map(float, body.radius)
        if body.is_sphere:
            apart: FloatArray = np.linalg.norm(self._center - first, axis=1) - self._radius - size
            return apart
        return round_cone_distance(self._center, first, last, size, other) - self._radius


class _Axes(NamedTuple):
    """Axes of bodies, one a triangle: start (N, 3), vector to the end (N, 3), radius there and its change (N,) [m]."""

    start: FloatArray
    along: FloatArray
    size: FloatArray
    drop: FloatArray

    @classmethod
    def of(cls, bodies: Sequence[Body], row: IntArray) -> "_Axes":
        ends, radius = (np.stack(values)[row] for values in zip(*bodies))
        return cls(ends[:, 0], ends[:, 1] - ends[:, 0], radius[:, 0], radius[:, 1] - radius[:, 0])

    def ball(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return centres and radii at a fraction of each axis."""
        return self.start + share[:, None] * self.along, self.size + share * self.drop

    def apart(self, share: FloatArray, triangles: ReadyTriangles) -> FloatArray:
        """Return unsigned distances [m] of the balls there to their triangles."""
        place, size = self.ball(share)
        return np.asarray(np.linalg.norm(away_from_triangles(triangles, place.T), axis=0) - size)


class Triangles:
    """Triangles: corners [m], shape (F, 3, 3)."""

    def __init__(self, corners: FloatArray) -> None:
        # A triangle without area lies on its neighbours.
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._corners = corners[(across != 0.0).any(axis=1)]
        self._middle = self._corners.mean(axis=1)
        self._around = np.linalg.norm(self._corners - self._middle[:, None], axis=2).max(axis=1, initial=0.0)

    def near(self, body: Body, limit: float) -> "Triangles":
        """Return the triangles whose bounding ball is within the limit of one around the body."""
        return Triangles(self._corners[self._near(body, limit)])

    def distances(self, places: Sequence[Body]) -> FloatArray:
        """Return signed distances [m] of a body at P places to each triangle, shape (P, F); clear if none is negative.

        Of a phalanx also those of the balls at its ends, shape (P, 3 F): one that lies flat touches along a line, and
        its least distance says nothing of its other end.
        """
        if len(self._corners) == 0:
            return np.zeros((len(places), 0))
        row, face = (number.ravel() for number in np.indices((len(places), len(self._corners))))
        axes, triangles = _Axes.of(places, row), ready_triangles(self._corners).at(face)
        shares = [np.zeros(len(row))]
        if not places[0].is_sphere:
            shares += [np.ones(len(row)), nearest_share(axes.start, axes.along, axes.drop, triangles)]
        return np.concatenate([axes.apart(share, triangles).reshape(len(places), -1) for share in shares], axis=1)

    def _near(self, body: Body, limit: float) -> IntArray:
        middle, half = body.ends.mean(axis=0), 0.5 * np.linalg.norm(body.ends[1] - body.ends[0])
        apart = np.linalg.norm(self._middle - middle, axis=1) - self._around - half - body.radius.max()
        return np.flatnonzero(apart <= limit)
