"""Random solids that are made of convex pieces, and the distance of two of them along separating axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import RigidMotion

STRAIGHT = 1e-9
"""Cross products of edges that are shorter are no axis."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Convex piece: corners [m], (n, 3); normals of its faces and directions of its edges, (m, 3)."""

    corners: FloatArray
    normals: FloatArray
    edges: FloatArray

    def transformed(self, turn: FloatArray, shift: FloatArray) -> "Piece":
        """Return the piece turned by a matrix and shifted [m]."""
        return Piece(self.corners @ turn.T + shift, self.normals @ turn.T, self.edges @ turn.T)


@dataclass(frozen=True, eq=False)
class Solid:
    """Closed mesh [m], and the convex pieces that it is made of."""

    mesh: Mesh
    pieces: tuple[Piece, ...]

    def transformed(self, turn: FloatArray, shift: FloatArray) -> "Solid":
        """Return the solid turned by a matrix and shifted [m]."""
        pieces = tuple(piece.transformed(turn, shift) for piece in self.pieces)
        return Solid(self.mesh.transformed(turn, shift), pieces)


def prism(corners: Any, height: float, convex: Sequence[Sequence[int]] = ()) -> Solid:
    """Return the solid over a polygon (n, 2) [m], counter-clockwise, of a height, about its middle.

    `convex` has the corners of the convex polygons that it is made of, one of all if there are none; they meet at
    corners alone.
    """
    flat = np.asarray(corners, np.float64)
    flat = flat - 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    count, parts = len(flat), convex or [range(len(flat))]
    points = np.concatenate([np.column_stack([flat, np.full(count, z)]) for z in (-0.5 * height, 0.5 * height)])
    faces = []
    for i in range(count):
        j = (i + 1) % count
        faces += [[i, j, count + j], [i, count + j, count + i]]
    pieces = []
    for part in parts:
        ring = list(part)
        for a, b in pairwise(ring[1:]):
            faces += [[ring[0], b, a], [count + ring[0], count + a, count + b]]
        sides = np.roll(flat[ring], -1, axis=0) - flat[ring]
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        up, level = np.array([[0.0, 0.0, 1.0]]), np.zeros((len(ring), 1))
        normals = np.concatenate([np.column_stack([sides[:, 1], -sides[:, 0], level]), up])
        edges = np.concatenate([np.column_stack([sides, level]), up])
        pieces.append(Piece(points[ring + [count + i for i in ring]], normals, edges))
    return Solid(Mesh(points, np.array(faces)), tuple(pieces))


def box(edges: Sequence[float]) -> Solid:
    """Return a box of these edges [m] about its middle."""
    x, y, z = edges
    return prism([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]], z)


def random_solid(rng: np.random.Generator, least: float = 0.01, most: float = 0.06) -> Solid:
    """Return a box, a prism of three to eight sides, an angle or a channel, each size between two [m]."""
    x, y, z = rng.uniform(least, most, 3)
    kind = rng.choice(["box", "box", "prism", "angle", "channel"])
    if kind == "box":
        return box((x, y, z))
    if kind == "prism":
        sides = int(rng.integers(3, 9))
        angle = 2.0 * np.pi * np.arange(sides) / sides
        return prism(0.5 * x * np.column_stack([np.cos(angle), np.sin(angle)]), z)
    x, y = max(x, 0.03), max(y, 0.03)
    thick = rng.uniform(0.2, 0.35) * min(x, y)
    if kind == "angle":
        ring = [[0.0, 0.0], [x, 0.0], [x, thick], [thick, thick], [thick, y], [0.0, y]]
        return prism(ring, z, [(0, 1, 2, 3), (0, 3, 4, 5)])
    outer, inner = [[0.0, 0.0], [x, 0.0], [x, y], [x - thick, y]], [[x - thick, thick], [thick, thick], [thick, y]]
    return prism([*outer, *inner, [0.0, y]], z, [(0, 1, 4, 5), (1, 2, 3, 4), (0, 5, 6, 7)])


def separation(one: Solid, two: Solid, first: RigidMotion, second: RigidMotion) -> FloatArray:
    """Return the least distance [m] of two solids' pieces along separating axes at each tick, negative inside."""
    found = np.full(len(first.shift), np.inf)
    turns, shifts = [rotation_matrix(of.turn) for of in (first, second)], [of.shift for of in (first, second)]
    for a in one.pieces:
        for b in two.pieces:
            placed = [p.corners @ r.transpose(0, 2, 1) + s[:, None] for p, r, s in zip((a, b), turns, shifts)]
            normals = [p.normals @ r.transpose(0, 2, 1) for p, r in zip((a, b), turns)]
            edges = [p.edges @ r.transpose(0, 2, 1) for p, r in zip((a, b), turns)]
            cross = np.cross(edges[0][:, :, None], edges[1][:, None]).reshape(len(found), -1, 3)
            length = np.linalg.norm(cross, axis=2, keepdims=True)
            # Parallel edges: any axis that is there already.
            cross = np.where(length > STRAIGHT, cross / np.maximum(length, STRAIGHT), normals[0][:, :1])
            axes = np.concatenate([*normals, cross], axis=1)
            low, high = (np.einsum("tai,tci->tac", axes, corners) for corners in placed)
            gap = np.maximum(low.min(axis=2) - high.max(axis=2), high.min(axis=2) - low.max(axis=2))
            found = np.minimum(found, gap.max(axis=1))
    return found
