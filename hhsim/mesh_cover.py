"""Covers a mesh by balls that protrude as little as can be."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import MeshError
from hhsim.kernels.cover import assign, covering_radius, greedy_cover
from hhsim.kernels.cover_refine import group_by_owner, move_balls, removal_cost, spare_balls
from hhsim.kernels.mesh_bvh import MeshBvh, build_mesh_bvh, face_normals
from hhsim.kernels.micro_triangle import MicroTriangles, cut_mesh, edges_for

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

COARSE = 60
"""Micro-triangles for each ball, to begin with."""
FINE = 240
"""Micro-triangles for each ball, to end with …"""
MOST_FINE = 400_000
"""… but not more than this in all, or COARSE for each ball where that is more."""
ROUNDS = (12, 12)
"""Rounds of refinement on each."""

ROUNDING = 1e-12
"""Relative room for rounding: balls are made this much larger than the arithmetic says."""

_REACH = 0.3
_TRIALS = 6
_TELEPORT_EVERY = 3
_TELEPORT_SHARE = 16
_TELEPORT_LIMIT = 1.05
_SPLITS = 8
_SPLIT_FROM = 0.8
_THINNEST = 1e-9


class _Cover:
    """Balls and their micro-triangles, while they are being improved."""

    def __init__(self, bvh: MeshBvh, micro: MicroTriangles, largest: float, balls: int) -> None:
        self.bvh, self.micro, self.largest, self.balls = bvh, micro, largest, balls
        self.center, self.depth, self.step = np.empty((0, 3)), np.empty(0), np.empty(0)
        self._room()

    def _room(self) -> None:
        count = len(self.micro.corner)
        self.owner, self.second_owner = np.empty(count, np.int64), np.empty(count, np.int64)
        self.cost, self.second_cost = np.empty(count), np.empty(count)

    @property
    def worst(self) -> float:
        """Largest cost of a micro-triangle [m]."""
        return float(self.cost.max())

    def assign(self) -> None:
        """Give every micro-triangle to its best ball."""
        assign(self.micro, self.center, self.depth, self.owner, self.cost, self.second_owner, self.second_cost)

    def fill(self) -> None:
        """Place the balls that are missing where the cover is worst."""
        for split in range(_SPLITS + 1):
            here = len(self.depth)
            center, depth = np.empty((self.balls, 3)), np.empty(self.balls)
            center[:here], depth[:here] = self.center, self.depth
            count = greedy_cover(
                self.bvh, self.micro, self.largest, _REACH, 0.0, 2 * _TRIALS, here, center, depth, self.owner, self.cost
            )
            self.center, self.depth = center[:count].copy(), depth[:count].copy()
            self.step = np.concatenate([self.step, np.zeros(count - here)])
            if count == self.balls or split == _SPLITS:
                break
            self._split_worst()

    def _split_worst(self) -> None:
        """Halve the micro-triangles that cost most: no ball alone could cover one of them for less."""
        points = self.micro.corner.reshape(-1, 3, 3)
        longest = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).max(axis=1)
        edge = np.where(self.cost > _SPLIT_FROM * self.worst, 0.5 * longest, np.inf)
        self.micro = cut_mesh(self.micro.corner, self.micro.normal, edge)
        self._room()
        self.assign()

    def move(self) -> None:
        """Move each ball towards less cost."""
        first, order = self._groups()
        move_balls(self.bvh, self.micro, first, order, _TRIALS, self.center, self.depth, self.step)

    def _groups(self) -> tuple[IntArray, IntArray]:
        first, order = np.empty(len(self.depth) + 1, np.int64), np.empty(len(self.owner), np.int64)
        group_by_owner(self.owner, first, order)
        return first, order

    def teleport(self) -> None:
        """Take away balls that are hardly missed, and place them anew."""
        first, order = self._groups()
        cost = np.empty(len(self.depth))
        removal_cost(self.owner, self.second_cost, cost)
        by_cost = np.argsort(cost, kind="stable")
        candidates = by_cost[cost[by_cost] < _TELEPORT_LIMIT * self.worst]
        spared = np.empty(len(self.depth), np.bool_)
        most = max(1, self.balls // _TELEPORT_SHARE)
        spare_balls(candidates, first, order, self.second_owner, most, spared)
        stays = ~spared
        self.center, self.depth, self.step = self.center[stays].copy(), self.depth[stays], self.step[stays]
        self.assign()
        self.fill()

    def recut(self, target: int) -> None:
        """Cut the micro-triangles finer, the more so the smaller the footprint of their ball."""
        footprint = np.sqrt(self.worst * (2.0 * np.maximum(self.depth, 0.0) + self.worst))[self.owner]
        edge = edges_for(self.micro.corner, footprint, target)
        self.micro = cut_mesh(self.micro.corner, self.micro.normal, edge)
        self._room()
        self.assign()


def build_cover(
    vertices: FloatArray,
    faces: IntArray,
    balls: int,
    bvh: MeshBvh | None = None,
    progress: Progress | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Cover a mesh with at most `balls` balls.

    Args:
        vertices: [m], shape (V, 3).
        faces: wound outward, shape (F, 3).
        balls: Most balls.
        bvh: over the mesh; None builds it.
        progress: called with ("cover", rounds done, rounds).

    Returns:
        Centres [m], shape (n, 3), and radii [m], shape (n,).

    Raises:
        MeshError: The mesh encloses no volume.
    """
    corner = np.ascontiguousarray(vertices[faces], np.float64).reshape(-1, 9)
    extent = float(np.ptp(corner.reshape(-1, 3), axis=0).max())
    require_inside(corner, extent)
    bvh = build_mesh_bvh(vertices, faces) if bvh is None else bvh
    micro = cut_mesh(corner, face_normals(vertices, faces), edges_for(corner, np.ones(len(corner)), COARSE * balls))
    cover = _Cover(bvh, micro, 0.5 * extent, balls)
    done, rounds = 0, sum(ROUNDS) + 1
    cover.fill()
    for stage, count in enumerate(ROUNDS):
        if stage:
            cover.recut(max(COARSE * balls, min(FINE * balls, MOST_FINE)))
        cover.assign()
        best = (cover.worst, cover.center.copy(), cover.depth.copy())
        for turn in range(count):
            done += 1
            if progress is not None:
                progress("cover", done, rounds)
            if turn % _TELEPORT_EVERY == 0:
                cover.teleport()
                cover.assign()
            cover.move()
            cover.assign()
            if cover.worst < best[0]:
                best = (cover.worst, cover.center.copy(), cover.depth.copy())
        if len(best[2]) != len(cover.depth):
            cover.step = np.zeros(len(best[2]))
        _, cover.center, cover.depth = best
        cover.assign()
    if progress is not None:
        progress("cover", rounds, rounds)

    radius = np.empty(len(cover.depth))
    covering_radius(cover.micro, cover.center, cover.owner, radius)
    used = radius >= 0.0
    center, radius = np.ascontiguousarray(cover.center[used]), radius[used]
    size = max(float(np.abs(corner).max()), float(np.abs(center).max()))
    return center, radius + ROUNDING * (radius + size)


def require_inside(corner: FloatArray, extent: float) -> None:
    """Raise a MeshError unless faces, shape (F, 9) [m], enclose a volume that is not that of a sheet."""
    a, b, c = (corner[:, k : k + 3] - corner[0, :3] for k in (0, 3, 6))
    normal = np.cross(b - a, c - a)
    volume = float(np.einsum("ij,ij->", a, normal)) / 6.0
    area = 0.5 * float(np.linalg.norm(normal, axis=1).sum())
    if not volume > _THINNEST * area * extent:
        raise MeshError(f"the mesh has no inside: its volume is {volume:.3g} m³; expected it closed and wound outward")
