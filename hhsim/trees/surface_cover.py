"""Cover of a mesh by spheres that protrude as little as possible."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.cover import greedy_cover as kernel
from hhsim.kernels.cover.certify import MicroTriangles, cut_mesh, halve
from hhsim.kernels.cover.sphere_descent import move_spheres
from hhsim.kernels.kd_tree import subtrees
from hhsim.kernels.mesh.bvh import MeshBvh, face_normals, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.own_triangles import places_in
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.mesh.topology import Shell
from hhsim.reproducible import dot, matmul, norm
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers, ranges

COARSE = 60
"""Micro-triangles per sphere at the start."""
FINE = 220
"""Largest number of micro-triangles per sphere at the end."""
PLENTY = 300_000
"""Largest number of micro-triangles in all, if that is more."""
CYCLES = (3, 12)
"""Cycles of refinement on the coarse micro-triangles, and on ever finer ones."""

ROUNDING = 1e-12
"""Relative margin for rounding: spheres are made this much larger than the arithmetic says."""

_REACH = 0.3
_TRIALS = 6
_EXCHANGED = (0.2, 0.01)
"""Share of the spheres removed and placed anew in the first and in the last cycle."""
_ROUNDS = (2, 2)
"""Rounds of moves and assignments after spheres were removed, and after they were placed."""
_HANDICAP = 0.5
"""Share of a sphere's margin to the worst cost that it gets as an advantage, to take work from the worst one."""
_SLACK = 0.3
"""Largest such margin, as a share of the worst cost."""
_SPLITS = 8
_SPLIT_FROM = 0.8
_FINER_FROM = 0.85
_FINEST = 0.03
"""Edges shorter than this share of the footprint of their sphere are not halved."""
_HIGH = 0.9
"""Quantile of the spheres' costs that stands for all: a few outliers do not count."""
_REPLACEMENTS = 4
"""Number of times that spheres which are nobody's best are placed anew."""
_TRIMS = 4
_TRIM_FROM = 0.95
_THINNEST = 1e-9
_BESIDE = 1e-4
"""Distance from a triangle at which its sides are told from each other, in sizes of the mesh."""
_SUBTREES = 3
"""Depth of the subtrees of micro-triangles that threads share out."""
_SHARES = 16
"""Number of ranges of spheres that threads share out."""


class CoverInProgress:
    """Spheres and their micro-triangles, while they are improved."""

    def __init__(self, bvh: MeshBvh, micro: MicroTriangles, spheres: int, workers: Workers) -> None:
        self.bvh, self.micro, self.spheres, self.workers = bvh, micro, spheres, workers
        self.roots = subtrees(micro.right, _SUBTREES)
        self.center, self.depth, self.step = np.empty((0, 3)), np.empty(0), np.empty(0)
        count = len(micro.corner)
        self.owner, self.second_owner = np.full((2, count), -1)
        self.cost, self.second_cost = np.full((2, count), np.inf)

    def drop(self, stays: BoolArray) -> None:
        """Drop the spheres that do not stay; their micro-triangles have no valid owner then."""
        self.owner = (np.cumsum(stays) - 1)[self.owner]
        self.center, self.depth, self.step = self.center[stays].copy(), self.depth[stays], self.step[stays]

    @property
    def worst(self) -> float:
        """Largest cost of a micro-triangle [m]."""
        return float(self.cost.max())

    def assign(self, depth: FloatArray | None = None) -> None:
        """Give every micro-triangle to its best sphere, by their depths or by other ones."""
        depth = self.depth if depth is None else depth
        self.workers.each(
            lambda root: kernel.assign(
                self.micro, root, self.center, depth, self.owner, self.cost, self.second_owner, self.second_cost
            ),
            ((root,) for root in self.roots),
        )

    def fill(self) -> None:
        """Place spheres, where the cover is worst, until all are there, or another one would gain nothing."""
        for split in range(_SPLITS + 1):
            here = len(self.depth)
            center, depth = np.empty((self.spheres, 3)), np.empty(self.spheres)
            center[:here], depth[:here] = self.center, self.depth
            # In its own frame the mesh has the size 1.
            count = kernel.greedy_cover(
                self.bvh, self.micro, 1.0, _REACH, 2 * _TRIALS, here, center, depth, self.owner, self.cost
            )
            self.center, self.depth = center[:count].copy(), depth[:count].copy()
            self.step = np.concatenate([self.step, np.zeros(count - here)])
            if count == self.spheres or split == _SPLITS:
                break
            # No sphere alone could cover one of the worst micro-triangles for less.
            chosen = self.cost > _SPLIT_FROM * self.worst
            if len(chosen) + int(chosen.sum()) > max(FINE * self.spheres, PLENTY):
                # Where all cost about the same, as around a cylinder, halves of halves would fill the memory.
                break
            self.halve(chosen)

    def halve(self, chosen: BoolArray) -> None:
        """Halve micro-triangles; the halves stay with the spheres that were the best two."""
        self.micro, source = halve(self.micro, chosen)
        self.owner, self.second_owner = self.owner[source], self.second_owner[source]
        self.cost, self.second_cost = (
            self._farthest(owner) - self.depth[owner] for owner in (self.owner, self.second_owner)
        )

    def _farthest(self, owner: IntArray) -> FloatArray:
        """Return the distance [m] of each micro-triangle's farthest corner from its owner's centre, infinite for −1."""
        farthest = np.empty(len(owner))
        kernel.farthest_corners(self.micro, self.center, owner, farthest)
        return farthest

    def refine(self, share: float) -> None:
        """Halve the micro-triangles that cost more than `share` of the worst: they decide the cost of their spheres."""
        longest, own = np.empty(len(self.owner)), self._largest(self.cost)
        kernel.longest_edges(self.micro.corner, longest)
        # A sphere that no other one can stand in for costs infinitely much; between two of those there is no number.
        with np.errstate(invalid="ignore"):
            high = float(np.quantile(own, _HIGH))
        footprint = np.sqrt(high * (2.0 * np.maximum(self.depth, 0.0) + high))
        chosen = (self.cost > share * high) & (longest > _FINEST * footprint[self.owner])
        if len(chosen) + int(chosen.sum()) <= max(FINE * self.spheres, PLENTY):
            self.halve(chosen)

    def move(self, afresh: bool) -> None:
        """Move each sphere towards less cost, with the last step lengths or with new ones."""
        first, order = self._groups()
        if afresh:
            self.step[:] = 0.0

        def move(begin: int, end: int) -> None:
            center, depth, step = self.center[begin:end], self.depth[begin:end], self.step[begin:end]
            move_spheres(self.bvh, self.micro, first[begin : end + 1], order, _TRIALS, center, depth, step)

        self.workers.each(move, ranges(len(self.depth), _SHARES))

    def _groups(self) -> tuple[IntArray, IntArray]:
        """Return micro-triangles in the order of their spheres, and where each sphere's begin and the last's end."""
        first, order = np.empty(len(self.depth) + 1, np.int64), np.empty(len(self.owner), np.int64)
        kernel.group_by_owner(self.owner, first, order)
        return first, order

    def _largest(self, cost: FloatArray) -> FloatArray:
        """Return the largest of these costs among the micro-triangles of each sphere [m]; −inf if it has none."""
        largest = np.full(len(self.depth), -np.inf)
        np.maximum.at(largest, self.owner, cost)
        return largest

    def remove(self, spheres: int) -> None:
        """Remove the most dispensable spheres until there are `spheres`."""
        while len(self.depth) > spheres:
            first, order = self._groups()
            # Without a sphere the cover costs what its micro-triangles cost under their second ones.
            cost = self._largest(self.second_cost)
            spared = np.empty(len(self.depth), np.bool_)
            kernel.spare_spheres(
                np.argsort(cost, kind="stable"), first, order, self.second_owner, len(self.depth) - spheres, spared
            )
            lost = spared[self.owner]
            self.owner[lost], self.cost[lost] = self.second_owner[lost], self.second_cost[lost]
            self.drop(~spared)
            if len(self.depth) > spheres:
                self.assign()

    def relax(self, rounds: int) -> None:
        """Move spheres and assign micro-triangles, so many times."""
        for turn in range(rounds):
            self.move(afresh=turn == 0)
            self.assign()

    def exchange(self, spheres: int) -> None:
        """Remove the `spheres` most dispensable ones, and place as many where the cover is then worst."""
        self.remove(self.spheres - spheres)
        self.relax(_ROUNDS[0])
        self.fill()
        own = self._largest(self.cost)
        most = float(own.max())
        # So that costly spheres have less to cover, and cheap ones more.
        self.assign(self.depth + _HANDICAP * np.clip(most - own, 0.0, _SLACK * most))
        self.relax(_ROUNDS[1])

    def spheres_of(self, mesh: "MeshInFrame") -> tuple[FloatArray, FloatArray]:
        """Return centres [m], shape (n, 3), and radii [m], (n,), that suffice for each micro-triangle's owner."""
        radius = np.full(len(self.depth), -1.0)
        np.maximum.at(radius, self.owner, self._farthest(self.owner))
        used = radius >= 0.0
        center, radius = mesh.frame.out_of(self.center[used]), radius[used] * mesh.frame.size
        size = max(mesh.reach, float(np.abs(center).max()))
        # A vertex was moved by at most half a step of the grid along each axis.
        return center, radius + GRID * mesh.frame.size + ROUNDING * (radius + size)


GRID = 2.0**-30
"""Step of the coordinates in the frame [-]: coarser than the rounding of a motion, which it removes."""

_TIE = 1e-6


@dataclass(frozen=True)
class CanonicalFrame:
    """A similarity: a point p [m] has the coordinates rotation @ (p − origin) / size."""

    origin: FloatArray  # mean of the vertices [m], shape (3,)
    rotation: FloatArray  # rows are the axes of the frame, shape (3, 3)
    size: float  # distance of the farthest vertex from the origin [m]

    def into(self, points: FloatArray) -> FloatArray:
        """Return the coordinates of points [m], shape (n, 3), on the grid."""
        inside = matmul(points - self.origin, self.rotation.T) / self.size
        return np.ascontiguousarray(np.round(inside / GRID) * GRID)

    def out_of(self, points: FloatArray) -> FloatArray:
        """Return the points [m] of coordinates, shape (n, 3)."""
        return np.ascontiguousarray(matmul(points, self.rotation) * self.size + self.origin)


def canonical_frame(vertices: FloatArray) -> CanonicalFrame:
    """Compute the frame of vertices [m], shape (V, 3).

    Its axes lead to the farthest vertex and to the one that is then farthest off the axis. Of those equally far the
    first counts: a symmetric mesh, whose principal axes would be arbitrary, has a frame too.
    """
    origin = vertices.mean(axis=0)
    arm = vertices - origin
    distance = np.linalg.norm(arm, axis=1)
    size = float(distance.max())
    if not size > 0.0:
        return CanonicalFrame(origin, np.eye(3), 1.0)
    first = arm[np.argmax(distance >= (1.0 - _TIE) * size)]
    x = first / norm(first)
    across = arm - np.outer(matmul(arm, x), x)
    distance = np.linalg.norm(across, axis=1)
    if not distance.max() > _TIE * size:
        across = np.eye(3) - np.outer(x, x)
        distance = np.linalg.norm(across, axis=1)
    second = across[np.argmax(distance >= (1.0 - _TIE) * distance.max())]
    y = second / norm(second)
    return CanonicalFrame(origin, np.stack([x, y, np.cross(x, y)]), size)


class MeshInFrame(NamedTuple):
    """A mesh prepared for covers of any number of spheres, in its own frame.

    corner: (F, 9) in the frame, of the triangles to be covered; normal: (F, 3), away from the inner side, 0 of a sheet;
        bvh: signed, over those that distances are measured to; frame: back to the mesh's place; reach: largest
        coordinate of the mesh [m].
    """

    corner: FloatArray
    normal: FloatArray
    bvh: MeshBvh
    frame: CanonicalFrame
    reach: float


def in_own_frame(mesh: Mesh) -> MeshInFrame:
    """Prepare a mesh for covers; MeshError if one that has to be a solid encloses no volume."""
    vertices, faces, corner = mesh.vertices, mesh.faces, mesh.triangles.reshape(-1, 9)
    if mesh.shell is None:
        _require_volume(corner)
    frame = canonical_frame(vertices[np.unique(faces)])
    inside = frame.into(vertices)
    normal = face_normals(inside, faces)
    shell = mesh.shell and mesh.shell._replace(vertices=frame.into(mesh.shell.vertices))
    bvh = signed_bvh(replace(mesh, vertices=inside, shell=shell))
    if shell is not None:
        normal = _inner_sides(inside, faces, normal, shell, bvh)
    return MeshInFrame(
        np.ascontiguousarray(inside[faces]).reshape(-1, 9), normal, bvh, frame, float(np.abs(corner).max())
    )


def _inner_sides(vertices: FloatArray, faces: IntArray, normal: FloatArray, shell: Shell, bvh: MeshBvh) -> FloatArray:
    """Turn the normals of a skin's triangles, (F, 3), away from the inner side of its solid; those of sheets are 0.

    A sphere for a sheet begins in it, any other one on the inner side. A triangle that the solid has not is in it, or
    cut in it: its inner side is where it is deeper.
    """
    of_sheet = (
        places_in(vertices, faces, vertices, shell.sheets) >= 0 if len(shell.sheets) else np.zeros(len(faces), bool)
    )
    found = np.where(of_sheet[:, None], 0.0, normal)
    if not len(shell.faces):
        return found
    place = places_in(vertices, faces, shell.vertices, shell.faces)
    has = (place >= 0) & ~of_sheet
    found[has] = face_normals(shell.vertices, shell.faces)[place[has]]
    left = np.flatnonzero((place < 0) & ~of_sheet)
    middle, away = vertices[faces[left]].mean(axis=1), _BESIDE * normal[left]
    found[left[mesh_signed_distance(bvh, middle + away) < mesh_signed_distance(bvh, middle - away)]] *= -1.0
    return found


def _require_volume(corner: FloatArray) -> None:
    a, b, c = (corner[:, k : k + 3] - corner[0, :3] for k in (0, 3, 6))
    normal = np.cross(b - a, c - a)
    volume = float(dot(a, normal).sum()) / 6.0
    area = 0.5 * float(np.linalg.norm(normal, axis=1).sum())
    # A sheet has a volume too, by rounding.
    if not volume > _THINNEST * area * float(np.ptp(corner.reshape(-1, 3), axis=0).max()):
        raise MeshError(f"the mesh has no inside: its volume is {volume:.3g} m³; expected it closed and wound outward")


def cover_of(
    mesh: MeshInFrame, spheres: int, progress: Progress = silent, workers: Workers | None = None
) -> tuple[FloatArray, FloatArray]:
    """Cover a mesh with at most `spheres` spheres; its place, rotation and size make no difference.

    `progress` is called with ("cover", cycles done, cycles); `workers` are threads to build with, None the calling one:
    the bytes do not depend on them. Returns centres [m], shape (n, 3), and radii [m], shape (n,).
    """
    micro = cut_mesh(mesh.corner, mesh.normal, COARSE * spheres)
    cover = CoverInProgress(mesh.bvh, micro, spheres, workers or Workers())
    cover.fill()
    cover.assign()
    least, best = cover.worst, (cover.center.copy(), cover.depth.copy())
    cycles = sum(CYCLES)
    for turn in range(cycles):
        if turn >= CYCLES[0]:
            cover.refine(_FINER_FROM)
        share = _EXCHANGED[0] * (_EXCHANGED[1] / _EXCHANGED[0]) ** (turn / max(cycles - 1, 1))
        cover.exchange(min(max(1, math.floor(share * spheres)), spheres // 2))
        if cover.worst < least:
            least, best = cover.worst, (cover.center.copy(), cover.depth.copy())
        progress("cover", turn + 1, cycles + 1)
    cover.center, cover.depth = best
    # There were more spheres, or fewer, in the last turn than in the best one.
    cover.step = np.zeros(len(cover.depth))
    cover.assign()
    for _ in range(_TRIMS):
        cover.refine(_TRIM_FROM)
        cover.assign()
    for _ in range(_REPLACEMENTS):
        cover.drop(np.bincount(cover.owner, minlength=len(cover.depth)) > 0)
        if len(cover.depth) == spheres:
            break
        cover.fill()
        cover.assign()
    progress("cover", cycles + 1, cycles + 1)

    return cover.spheres_of(mesh)
