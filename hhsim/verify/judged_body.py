"""Bodies that a hand touches, and the hand as each of them sees it.

A pose p, q of an object that began at P, Q maps x to q Q⁻¹ (x − P) + p; this is inverted, by scipy's rotations.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ObjectMotion
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.reader import TURNS, Result
from hhsim.verify.contacts import Pairs, Places, ReadyTriangles, ball_places, ready_triangles, triangle_places
from hhsim.verify.cover_checks import leaves
from hhsim.verify.kinematics import Posed, rotations


@dataclass(frozen=True, eq=False)
class JudgedBody:
    """Mesh and leaf spheres in a frame of their own, and where that is at n ticks."""

    mesh: Mesh  # in the body's frame [m]
    center: FloatArray  # leaf spheres [m], shapes (L, 3) and (L,)
    radius: FloatArray
    first: int  # number of its first sphere or triangle among those of all bodies
    on_mesh: bool  # True if the hand touched triangles
    # Rotation matrix (n, 3, 3) and translation [m] (n, 3) to the judge's frame; None: the body stands still there.
    turn: FloatArray | None
    shift: FloatArray

    @cached_property
    def triangles(self) -> ReadyTriangles:
        """Triangles of the mesh."""
        return ready_triangles(self.mesh.triangles)

    @cached_property
    def pieces(self) -> Places:
        """Spheres or triangles, whichever the hand touches."""
        return triangle_places(self.mesh.triangles) if self.on_mesh else ball_places(self.center, self.radius)

    def of(self, pairs: Pairs) -> IntArray:
        """Return the pairs that are with this body."""
        count = len(self.mesh.faces) if self.on_mesh else len(self.radius)
        return np.flatnonzero((pairs.leaf >= self.first) & (pairs.leaf < self.first + count))

    def seen_points(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return points [m], shape (m, ..., 3), at the ticks of these rows as the body sees them."""
        if self.turn is None:
            return points
        flat = points.reshape(len(points), math.prod(points.shape[1:-1]), 3) - self.shift[rows][:, None]
        return np.asarray(np.einsum("tji,tkj->tki", self.turn[rows], flat).reshape(points.shape))

    def seen(self, posed: Posed, rows: IntArray) -> Posed:
        """Return the hands of these rows as the body sees them."""
        here = posed.at(rows)
        if self.turn is None:
            return here
        axes = np.einsum("tji,tfj->tfi", self.turn[rows], here.axes)
        joints, palm, position = (self.seen_points(points, rows) for points in (here.joints, here.palm, here.position))
        return Posed(joints, axes, palm, position)

    def seen_hand(self, posed: Posed, orientation: FloatArray, rows: IntArray) -> PlacedHand:
        """Return the hands of these rows as the body sees them; orientations (n, 4) are those of all rows."""
        if self.turn is None:
            return PlacedHand(posed.joints[rows], posed.position[rows], orientation[rows])
        from scipy.spatial.transform import Rotation

        turned = (Rotation.from_matrix(self.turn[rows]).inv() * rotations(orientation[rows])[0]).as_quat()
        joints, position = (self.seen_points(points[rows], rows) for points in (posed.joints, posed.position))
        return PlacedHand(joints, position, turned[:, [3, 0, 1, 2]])

    def placed(self, pairs: Pairs, rows: IntArray) -> Pairs:
        """Return pairs that the body sees, of ticks that are places in these rows, in the judge's frame."""
        pairs = pairs._replace(leaf=pairs.leaf + self.first)
        if self.turn is None:
            return pairs
        at = rows[pairs.tick]
        point, normal = (np.einsum("nij,nj->ni", self.turn[at], of) for of in (pairs.point, pairs.normal))
        return pairs._replace(point=point + self.shift[at], normal=normal)


def judged_bodies(result: Result, ticks: IntArray) -> tuple[JudgedBody, ...]:
    """Return the bodies of a result at some ticks; one alone stands still in its frame."""
    on_mesh, found, first = result.surface == "mesh", list[JudgedBody](), 0
    moved_bodies = result.meshes_moved()
    if not moved_bodies:
        return (JudgedBody(stored_mesh(result.body), *leaves(result.body), 0, on_mesh, None, np.zeros((0, 3))),)
    for body, moved in zip(result.bodies.values(), moved_bodies, strict=True):
        mesh = Mesh(np.array(body.vertices), np.array(body.faces), name=body.group)
        turn = rotations(moved.turn[ticks])[0].as_matrix()
        found.append(JudgedBody(mesh, *leaves(body), first, on_mesh, turn, moved.shift[ticks]))
        first += len(mesh.faces) if on_mesh else len(found[-1].radius)
    return tuple(found)


def seen_by_referee(name: str, values: AnyArray, now: ObjectMotion, first: ObjectMotion) -> AnyArray:
    """Transform rows of a /tick dataset from the world to the object's frame, as `hhsim.result.reader.View`."""
    here, none = rotations(now.orientation)
    there = rotations(first.orientation[None])[0]
    back = there * here.inv()
    if TURNS[name] == "orientation":
        turned, neither = rotations(values)
        seen = (back * turned).as_quat()[:, [3, 0, 1, 2]]
        none |= neither
    else:
        rows = np.asarray(values, np.float64).reshape(len(values), -1, 3)
        matrix = back.as_matrix()
        at_point = TURNS[name] == "point"
        moved = rows - now.position[:, None] if at_point else rows
        seen = np.einsum("tij,tnj->tni", matrix, moved) + (first.position if at_point else 0.0)
    seen[none] = np.nan
    return np.asarray(seen.reshape(values.shape))
