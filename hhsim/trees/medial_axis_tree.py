"""Sphere trees from the medial axis: the best comparison that the literature has.

After Bradshaw and O'Sullivan (2004, "Adaptive medial-axis approximation for sphere-tree construction", ACM Transactions
on Graphics 23(1), 1–26). From the root down, the part of the surface that a node is responsible for is covered by its
children: a medial axis, sampled more densely where its balls stick out, gives many balls, and merging, bursting, or
expanding and selecting reduces them to as many as a node may have, whichever does it best. Each child is responsible
for the pieces of the surface that it was given.

What differs from the published algorithm makes it better, as far as it was measured: the surface is not a set of points
but of triangles that lie in their ball whole, so that the balls leave no gap; a ball's expansion is measured from the
exact depth of its centre; merged balls are chosen among all medial balls; the centres descend at last, where the
authors' program can search by a simplex; and what a child is responsible for is decided one level ahead, by balls as
fine as its children's, so that each child has about as many of them to look after.
"""

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover.greedy_cover import covering_radius, longest_edges
from hhsim.kernels.cover.medial_reduction import assign_to_siblings, piece_costs, reduce_balls
from hhsim.kernels.cover.micro_triangle import MicroTriangles, cut_mesh, edges_for, halve
from hhsim.kernels.cover.refine import group_by_owner, move_balls
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, face_normals
from hhsim.mesh.mesh import Mesh
from hhsim.trees.enclosing_tree import cover_with_proof, enclosing_tree
from hhsim.trees.level_cover import LevelCover
from hhsim.trees.medial_axis import MedialAxis, medial_axis, refined_medial_axis, with_new_samples
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import require_inside

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

PIECES = 40
"""Of the surface, for each ball of a level."""
REGION_BALLS = 250
"""Medial balls for each node whose part of the surface they cover, …"""
MOST_BALLS = 60_000
"""… but not more in all."""
FIRST_SAMPLES = 0.25
"""Samples to begin with, for each medial ball; the rest are added where they are needed."""
MORE_ROUNDS = 1
"""Times that a node that is touched by too few balls gets more samples."""
FEW = 100
"""Balls below which these are too few."""
CANDIDATES, MOST_PIECES = 500, 1500
"""Medial balls that a node chooses from, and pieces that it is judged by, at most."""
START = 1.5
"""Balls that merging and bursting begin with, for each that may be left."""
LOOK_AHEAD = 1
"""Levels by which the balls are finer than the children among which they divide a node's part of the surface."""
DESCENTS = 6
"""Rounds in which the balls of a level move, and exchange pieces with their siblings."""
_TRIALS = 8


class _Pieces:
    """The surface in pieces, and the node of the latest level that each belongs to."""

    def __init__(self, mesh: Mesh) -> None:
        self.corner = np.ascontiguousarray(mesh.triangles.reshape(-1, 9))
        self.normal = face_normals(mesh.vertices, mesh.faces)
        self.micro = self.cut(PIECES)
        self.region = np.zeros(len(self.micro.corner), np.int64)

    def cut(self, count: int) -> MicroTriangles:
        """The whole surface in about as many pieces of about one size."""
        return cut_mesh(self.corner, self.normal, edges_for(self.corner, np.ones(len(self.corner)), count))

    def halve(self, chosen: NDArray[np.bool_]) -> None:
        """Halve some; the halves belong to where the whole did."""
        self.micro, source = halve(self.micro, chosen)
        self.region = self.region[source]

    def refine(self, count: int) -> None:
        """Halve the largest until there are `count`."""
        longest = np.empty(len(self.region))
        longest_edges(self.micro.corner, longest)
        limit = float(longest.max())
        while len(self.region) < count:
            longest = np.empty(len(self.region))
            longest_edges(self.micro.corner, longest)
            limit *= 0.5**0.5
            self.halve(longest > limit)

    def groups(self, owner: IntArray, count: int) -> tuple[IntArray, IntArray]:
        """Pieces by owner: those of j are order[first[j]:first[j + 1]]."""
        first, order = np.empty(count + 1, np.int64), np.empty(len(owner), np.int64)
        group_by_owner(owner, first, order)
        return first, order


def build_medial_tree(
    mesh: Mesh, level: int, branching: int, leaves: int | None = None, progress: Progress | None = None
) -> SphereTree:
    """Build the tree.

    The balls of each level cover the surface; every inner node is the smallest ball around the leaves below it.

    Args:
        mesh: Watertight and wound outward.
        level: Of the leaves.
        branching: Most children of a node.
        leaves: Most leaves; None for branching ** level.
        progress: called with ("cover", levels done, levels).

    Returns:
        The tree with the cover of each level, not measured.

    Raises:
        MeshError: The mesh encloses no volume.
    """
    started = [time.process_time()]
    pieces = _Pieces(mesh)
    require_inside(pieces.corner, float(mesh.extent.max()))
    bvh = build_mesh_bvh(mesh.vertices, mesh.faces)
    limit = branching**level if leaves is None else min(leaves, branching**level)
    parents: list[IntArray] = []
    covers: list[LevelCover] = []
    axis: MedialAxis | None = None
    for depth in range(1, level + 1):
        regions = int(pieces.region.max()) + 1
        ahead = min(depth + LOOK_AHEAD, level)
        most = min(branching**ahead, limit)
        pieces.refine(PIECES * most)
        if axis is None or depth + LOOK_AHEAD <= level:
            axis = _axis(bvh, pieces, min(REGION_BALLS * branching ** (ahead - 1), MOST_BALLS))
        axis = _enough_everywhere(bvh, pieces, axis, regions)
        if depth == 1:
            covers.append(cover_with_proof(mesh, bvh, *_covered(bvh, pieces, axis, np.ones(1, np.int64))[:2]))
            started.append(time.process_time())
        room = np.minimum(most // regions + (np.arange(regions) < most % regions), branching ** (ahead - depth + 1))
        center, radius, of, owner = _covered(bvh, pieces, axis, room)
        if depth < level:
            of = _divided(pieces, of, owner, branching)
            center, radius = _covered(bvh, pieces, axis, np.ones(len(of), np.int64))[:2]
        parents.append(of)
        covers.append(cover_with_proof(mesh, bvh, center, radius))
        started.append(time.process_time())
        if progress is not None:
            progress("cover", depth, level)
    return enclosing_tree(covers, parents, np.diff(started).tolist())


def _covered(
    bvh: MeshBvh, pieces: _Pieces, axis: MedialAxis, room: IntArray
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Cover each region by its own medial balls, at most `room` of them.

    Returns:
        Centres [m], shape (n, 3), radii [m], shape (n,), the region of each, shape (n,), and the ball of each piece.
    """
    first, order = pieces.groups(pieces.region, len(room))
    offered = _candidates(pieces, axis, len(room))
    chosen = [
        _reduced(pieces, order[first[region] : first[region + 1]], axis, offered[region], int(room[region]))
        for region in range(len(room))
    ]
    ball, of = np.concatenate(chosen), np.repeat(np.arange(len(room)), [len(each) for each in chosen])
    center, depth, step = axis.center[ball].copy(), axis.depth[ball].copy(), np.zeros(len(ball))
    owner, cost = np.empty(len(pieces.region), np.int64), np.empty(len(pieces.region))
    first_ball = np.searchsorted(of, np.arange(len(room) + 1))
    for turn in range(DESCENTS + 1):
        assign_to_siblings(pieces.micro.corner, pieces.region, first_ball, center, depth, owner, cost)
        if turn < DESCENTS:
            by_ball = pieces.groups(owner, len(ball))
            move_balls(bvh, pieces.micro, *by_ball, _TRIALS, center, depth, step)
    radius = np.empty(len(ball))
    covering_radius(pieces.micro, center, owner, radius)
    used = radius >= 0.0
    return center[used], radius[used], of[used], (np.cumsum(used) - 1)[owner]


def _divided(pieces: _Pieces, of: IntArray, owner: IntArray, branching: int) -> IntArray:
    """Divide each region among at most `branching` children, so that their shares of its balls are about equal.

    Args:
        pieces: of the surface; their regions become the children.
        of: the region of each ball, shape (n,).
        owner: the ball of each piece.
        branching: most children.

    Returns:
        The region of each child.
    """
    middle = middles(pieces.micro.corner)
    weight = triangle_areas(pieces.micro.corner)
    moment = np.column_stack([np.bincount(owner, weight * middle[:, k]) for k in range(3)])
    place = np.asarray(moment / np.bincount(owner, weight)[:, None], np.float64)
    child = np.empty(len(of), np.int64)
    parent: list[int] = []
    for region, balls in enumerate(np.split(np.arange(len(of)), np.searchsorted(of, np.arange(1, of[-1] + 1)))):
        for group in _halved(place, balls, min(branching, len(balls))):
            child[group] = len(parent)
            parent.append(region)
    pieces.region = child[owner]
    return np.array(parent)


def _halved(place: FloatArray, members: IntArray, groups: int) -> list[IntArray]:
    """Halve along the principal axis until there are `groups` groups of nearly equal size."""
    if groups == 1:
        return [members]
    left = groups // 2
    points = place[members] - place[members].mean(axis=0)
    _, axes = np.linalg.eigh(points.T @ points)
    order = np.argsort(points @ axes[:, 2], kind="stable")
    cut = round(len(members) * left / groups)
    return _halved(place, members[order[:cut]], left) + _halved(place, members[order[cut:]], groups - left)


def _axis(bvh: MeshBvh, pieces: _Pieces, wanted: int) -> MedialAxis:
    """A medial axis of about `wanted` balls."""
    count = int(FIRST_SAMPLES * wanted)
    coarse = pieces.cut(count).corner
    return refined_medial_axis(bvh, points_in(coarse[spread_by_area(coarse, count)]), wanted)


def _enough_everywhere(bvh: MeshBvh, pieces: _Pieces, axis: MedialAxis, regions: int) -> MedialAxis:
    """The medial axis with more samples in those regions that are touched by too few balls to choose from."""
    for _ in range(MORE_ROUNDS):
        offered = np.array([len(each) for each in _candidates(pieces, axis, regions)])
        lacking = np.maximum(FEW - offered, 0)
        if not lacking.any():
            break
        first, order = pieces.groups(pieces.region, regions)
        more = []
        for region in np.flatnonzero(lacking):
            corner = pieces.micro.corner[order[first[region] : first[region + 1]]]
            more.append(points_in(corner[spread_by_area(corner, math.ceil(FIRST_SAMPLES * lacking[region]))]))
        axis = medial_axis(bvh, with_new_samples(axis.sample, np.concatenate(more)))
    return axis


def _candidates(pieces: _Pieces, axis: MedialAxis, regions: int) -> list[IntArray]:
    """The medial balls that touch the surface in each region."""
    from scipy.spatial import cKDTree

    of_sample = pieces.region[cKDTree(middles(pieces.micro.corner)).query(axis.sample)[1]]
    pairs = np.unique(np.column_stack([of_sample[axis.touching[:, 0]], axis.touching[:, 1]]), axis=0)
    return np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, regions)))


def _reduced(pieces: _Pieces, members: IntArray, axis: MedialAxis, offered: IntArray, most: int) -> IntArray:
    """At most `most` of the medial balls, for the pieces `members`."""
    if not len(offered):
        offered = np.array([int(np.argmax(axis.depth))])
    if len(offered) > CANDIDATES:
        offered = offered[np.linspace(0, len(offered) - 1, CANDIDATES).astype(np.int64)]
    # Those left out here are assigned afterwards all the same.
    members = members[spread_by_area(pieces.micro.corner[members], MOST_PIECES)]
    cost = np.empty((len(offered), len(members)))
    piece_costs(pieces.micro.corner, members, axis.center[offered], axis.depth[offered], cost)
    weight = triangle_areas(pieces.micro.corner[members])
    best, owner = np.empty(most, np.int64), np.empty(len(members), np.int64)
    count = reduce_balls(cost, weight, False, math.ceil(START * most), most, best, owner)
    return np.asarray(offered[np.unique(best[:count])])


def middles(corner: FloatArray) -> FloatArray:
    """Centroids [m], shape (n, 3), of triangles a, b, c [m], shape (n, 9)."""
    return np.asarray(corner.reshape(-1, 3, 3).mean(axis=1))


def points_in(corner: FloatArray) -> FloatArray:
    """A point [m] in each of the triangles a, b, c [m], shapes (n, 3) and (n, 9); the same whenever it is asked for.

    Not the centroids: those of a regular mesh lie on common spheres, and then Voronoi vertices coincide.
    """
    u, v = np.random.default_rng(len(corner)).random((2, len(corner)))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    weight = np.column_stack([1.0 - u - v, u, v])
    return np.asarray(np.einsum("nk,nki->ni", weight, corner.reshape(-1, 3, 3)))


def triangle_areas(corner: FloatArray) -> FloatArray:
    """Areas [m²], shape (n,), of triangles a, b, c [m], shape (n, 9); those without area count a little."""
    ab, ac = corner[:, 3:6] - corner[:, :3], corner[:, 6:] - corner[:, :3]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    return np.asarray(np.maximum(area, 1e-9 * area.mean() + np.finfo(np.float64).tiny))


def spread_by_area(corner: FloatArray, count: int) -> IntArray:
    """Which triangles to take, in their order, so that about `count` are left and they lie equally dense."""
    if len(corner) <= count:
        return np.arange(len(corner))
    reached = np.cumsum(triangle_areas(corner))
    return np.unique(np.searchsorted(reached, (np.arange(count) + 0.5) * (reached[-1] / count)))
