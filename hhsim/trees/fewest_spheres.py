"""Cover of a mesh by few spheres: a search from many starts, where the greedy cover and its exchanges fall short.

Points of the surface stand for it while the spheres move together. Then places between the points that cost more are
found, join them, and the spheres move on. At last, one at a time, they give up what others cover as well.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.kernels.cover.certify import cut_mesh
from hhsim.kernels.cover.cover_error import lie_outside, reduce_outside
from hhsim.kernels.cover.joint_descent import (
    BLOCK,
    ROUNDING,
    descend_together,
    enclose_blocks,
    find_dearest,
    find_owners,
)
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.system.progress import Progress, silent
from hhsim.system.thread_pool import Workers
from hhsim.trees.options import FEW
from hhsim.trees.surface_cover import CoverInProgress, MeshInFrame, cover_of

_PIECES = 3000, 60
"""Micro-triangles whose corners are the first points: so many, and so many more for each sphere."""
_STARTS = 3, 32
"""Number of starts with the most spheres, and with one or two."""


class _Descent(NamedTuple):
    """Arguments of `hhsim.kernels.cover.joint_descent.descend_together`, in its order."""

    cycles: int
    rounds: int
    longest: float
    shortest: float
    bluntest: float
    sharpest: float
    exchanged: int = 0


_DESCENT = _Descent(40, 15, 0.05, 1e-3, 8.0, 300.0, exchanged=4)
"""Descent from the best starts."""
_FIRST, _GO_ON = _DESCENT._replace(cycles=8), 3
"""Short descent from each start, which tells the best; one of so many goes on, and two at least."""
_POLISHES = _Descent(1, 30, 0.15, 1e-2, 60.0, 300.0), _Descent(1, 30, 0.05, 3e-3, 60.0, 1000.0)
"""Descents with new points, in turn, from the best ends; lengths are shares of the largest cost."""
_TURNS, _PATIENCE = 40, 4
"""Most of these descents, and how many of them may bring nothing one after another."""
_ACTIVE = 0.7
"""Cost of the points that count then, as a share of the largest; steps are too short for the others to matter."""
_DEAR = 0.98
"""Cost of the places whose surroundings become points, as a share of the largest."""
_DOUBT = 0.001
"""Share of the largest cost by which what lies between points may cost more."""
_ENDS = 2, 6
"""Number of the ends that go on with the most spheres, and with one or two."""
_NEAR = 1.05
"""Cost of an end that goes on, as a share of the least."""
_HOPELESS = 2.0
"""Cost of a start or an end that is given up, as a multiple of the greedy cover's."""
_SAME = 1e-3
"""Ends whose costs and mean heights differ by a smaller share are one."""
_DIRECTIONS = 300
"""Number of directions in which a sphere's height over the mesh is looked at."""
_GRID = 24
"""Number of points along each axis of the grid that counts the volume outside."""
_TRIALS = 2400, 50
"""Trials to move a sphere: so many in all, and so many more for each sphere."""
_ALLOWED, _HANDFUL, _ALLOWED_OF_MORE = 1.02, 8, 1.002
"""Largest protrusion after the volume outside was reduced, as a share of that before: of so many spheres; of more."""
_REDUCTIONS, _FINER, _DECISIVE = 3, 3, 0.002
"""Number of reductions; halvings between them of the micro-triangles that a sphere barely reaches; and by what share of
the largest cost it does."""
_HALVINGS, _MOST_PIECES = 24, 30_000
"""Number of halvings until one sphere has each micro-triangle, and of those that are not cut, if the mesh has fewer."""


class _Found(NamedTuple):
    cost: float  # [-], in the mesh's own frame
    mean: float  # mean height of the spheres over the mesh [-]
    cover: CoverInProgress


class _Search:
    """Search for the cover of a mesh by so many spheres."""

    def __init__(self, mesh: MeshInFrame, spheres: int) -> None:
        self.mesh, self.spheres = mesh, spheres
        pieces = _PIECES[0] + _PIECES[1] * spheres
        self.micro = cut_mesh(mesh.corner, mesh.normal, pieces)
        points, first = np.unique(self.micro.corner.reshape(-1, 3), axis=0, return_index=True)
        # In the order of the micro-triangles, which is spatial: every so many-th one where the file's are finer.
        points = points[np.argsort(first)][:: -(-len(points) // pieces)]
        self.points = np.ascontiguousarray(points.T)
        direction = np.random.default_rng(2).normal(size=(_DIRECTIONS, 3))
        self.direction = direction / np.linalg.norm(direction, axis=1)[:, None]

    def scaled(self, numbers: tuple[int, int]) -> int:
        """Return a number between that for the most spheres and that for one or two."""
        fewer = (FEW - max(self.spheres, 2)) / (FEW - 2)
        return round(numbers[0] + (numbers[1] - numbers[0]) * fewer * fewer * fewer)

    def depth(self, center: FloatArray) -> FloatArray:
        return -mesh_signed_distance(self.mesh.bvh, center)

    def starts(self) -> list[FloatArray]:
        rng, middle = np.random.default_rng(0), self.points.mean(axis=1)
        rows = (rng.choice(self.points.shape[1], self.spheres) for _ in range(self.scaled(_STARTS)))
        return [np.ascontiguousarray(middle + 0.8 * (self.points.T[row] - middle)) for row in rows]

    def descend(self, points: FloatArray, how: _Descent, center: FloatArray) -> float:
        exchanged = min(how.exchanged, max(1, self.spheres // 4))
        return descend_together(self.mesh.bvh, points, *how._replace(exchanged=exchanged), center)

    def chosen(self, centers: list[FloatArray], costs: list[float]) -> list[FloatArray]:
        """Choose ends of the descent: the best, and those nearly as good that protrude least in the mean."""
        near = [i for i in range(len(costs)) if costs[i] <= _NEAR * min(costs)]
        cost = np.array([costs[i] for i in near])
        mean = np.array([self.mean_height(centers[i], self.needed_radius(centers[i])) for i in near])
        found = [int(np.argmin(cost))]
        for i in np.argsort(mean, kind="stable"):
            alike = (np.abs(cost[found] - cost[i]) < _SAME * cost[i]) & (
                np.abs(mean[found] - mean[i]) < _SAME * mean[i]
            )
            if len(found) < self.scaled(_ENDS) and not alike.any():
                found.append(int(i))
        return [centers[near[i]] for i in found]

    def owners(self, points: FloatArray, center: FloatArray, depth: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the best sphere of each point, columns of shape (3, N), and its cost under that."""
        count = points.shape[1]
        owner, cost, second = np.empty(count, np.int64), np.empty(count), np.empty(count)
        ball = np.empty((-(-count // BLOCK), 4))
        enclose_blocks(points, ball)
        find_owners(points, ball, center, depth, np.empty(len(center)), owner, cost, second)
        return owner, cost

    def needed_radius(self, center: FloatArray) -> FloatArray:
        """Return radii that reach the points which cost least under each sphere, 0 for none, shape (k,)."""
        depth, radius = self.depth(center), np.zeros(len(center))
        owner, cost = self.owners(self.points, center, depth)
        np.maximum.at(radius, owner, cost + depth[owner])
        return radius

    def mean_height(self, center: FloatArray, radius: FloatArray) -> float:
        """Return the mean height over the mesh of the part of the union's surface that is outside of it."""
        points = center[:, None] + radius[:, None, None] * self.direction
        free = np.ones(points.shape[:2], np.bool_)
        for j in range(len(radius)):
            inside = ((points - center[j]) ** 2).sum(axis=2) < radius[j] ** 2
            inside[j] = False
            free &= ~inside
        height = -self.depth(np.ascontiguousarray(points[free]))
        area = np.broadcast_to(radius[:, None] ** 2, free.shape)[free] * (height > 0.0)
        return float((height * area).sum() / area.sum()) if area.any() else 0.0

    def polish(self, center: FloatArray, most_cost: float = np.inf) -> tuple[float, FloatArray]:
        """Move spheres until no place between the points costs more than they do; return the cost and the centres.

        Those that cost more than `most_cost` are given up.
        """
        points, center = self.points, center.copy()
        least, best, stalled = np.inf, center.copy(), 0
        piece, cost = np.empty((len(self.micro.corner), 9)), np.empty(len(self.micro.corner))
        for turn in range(_TURNS):
            now = self.owners(points, center, self.depth(center))[1]
            how, most = _POLISHES[turn % len(_POLISHES)], float(now.max())
            if not most > 0.0:
                break
            how = how._replace(longest=how.longest * most, shortest=how.shortest * most)
            known = self.descend(np.ascontiguousarray(points[:, now > _ACTIVE * most]), how, center)
            depth = self.depth(center)
            worst = find_dearest(self.micro, center, depth, _DOUBT, known, _DEAR * known, piece, cost)
            stalled = 0 if worst < least * (1.0 - _DOUBT) else stalled + 1
            if worst < least:
                least, best = worst, center.copy()
            if stalled == _PATIENCE or least > most_cost:
                break
            if worst > known * (1.0 + _DOUBT):
                new = piece[cost > _DEAR * known].reshape(-1, 3)
                points = np.ascontiguousarray(np.concatenate([points, new.T], axis=1))
        return least, best

    def reduce(self, cost: float, center: FloatArray) -> _Found:
        """Reduce the volume outside of spheres of a cost, which may rise as far as is allowed."""
        center, depth = center.copy(), self.depth(center)
        cover = CoverInProgress(self.mesh.bvh, self.micro, self.spheres, Workers())
        cover.center, cover.depth = center.copy(), depth
        cover.assign()
        for _ in range(_HALVINGS):
            self.halve(cover, cover.cost > cost * (1.0 + 2.0 * _DOUBT))
        allowed = (_ALLOWED if self.spheres <= _HANDFUL else _ALLOWED_OF_MORE) * cost
        # Where micro-triangles could not be cut so fine, they cost more.
        limit = max(allowed, cover.worst)
        radius = np.maximum(depth + limit, 0.0)
        outside, step = self.outside(center, radius, limit)
        rng = np.random.default_rng(1)
        for turn in range(_REDUCTIONS):
            trials = _TRIALS[0] + _TRIALS[1] * self.spheres
            shift = rng.normal(size=(trials if turn == 0 else trials // 4, 3))
            triangles = np.ascontiguousarray(cover.micro.corner.T)
            reduce_outside(self.mesh.bvh, triangles, outside, limit, shift, float(step.max()), center, radius)
            cover.center, cover.depth = center.copy(), radius.copy()
            cover.assign()
            for _ in range(_FINER if turn + 1 < _REDUCTIONS else 0):
                self.halve(cover, cover.cost > -_DECISIVE * cost)
        return _Found(float((radius - self.depth(center)).max()), self.mean_height(center, radius), cover)

    def halve(self, cover: CoverInProgress, chosen: BoolArray) -> None:
        """Halve the chosen micro-triangles of a cover, unless there would be too many."""
        if chosen.any() and len(chosen) + int(chosen.sum()) <= max(_MOST_PIECES, 2 * len(self.micro.corner)):
            cover.halve(chosen)
            cover.assign()

    def outside(self, center: FloatArray, radius: FloatArray, most: float) -> tuple[FloatArray, FloatArray]:
        """Return the points of a grid around spheres that lie out of the mesh, in columns, and its steps, (3,).

        No sphere that protrudes by `most` or less reaches those farther out, which are left out.
        """
        low, high = (center - radius[:, None]).min(axis=0), (center + radius[:, None]).max(axis=0)
        axes = [low[k] + (high[k] - low[k]) * (np.arange(_GRID) + 0.5) / _GRID for k in range(3)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        outside = np.empty(len(grid), np.bool_)
        lie_outside(self.mesh.bvh, grid, most + ROUNDING, outside)
        return np.ascontiguousarray(grid[outside].T), (high - low) / _GRID


def fewest_spheres(
    mesh: MeshInFrame, spheres: int, progress: Progress = silent, workers: Workers | None = None
) -> tuple[FloatArray, FloatArray]:
    """Cover a mesh with at most `spheres` spheres, as `hhsim.trees.surface_cover.cover_of`, which is for many.

    With the least protrusion: among covers within 5 % of the least that was found, the one that loses least against the
    best there is in both its largest and its mean one.
    """
    workers = workers or Workers()
    search = _Search(mesh, spheres)
    starts = search.starts()
    # So that no cover is worse than the greedy one.
    greedy = mesh.frame.into(cover_of(mesh, spheres)[0])
    hopeless = _HOPELESS * float(search.owners(search.points, greedy, search.depth(greedy))[1].max())

    def descend(how: _Descent) -> list[float]:
        return workers.each(lambda center: search.descend(search.points, how, center), ((one,) for one in starts))

    first = descend(_FIRST)
    best = np.argsort(first, kind="stable")[: max(2, len(starts) // _GO_ON)]
    starts = [starts[i] for i in best if first[i] <= hopeless]
    costs = descend(_DESCENT)
    progress("cover", 1, 3)
    ends = [search.polish(greedy)]
    most = _HOPELESS * ends[0][0]
    hopeful = search.chosen(starts, costs) if starts else []
    ends += workers.each(search.polish, ((center, most) for center in hopeful))
    progress("cover", 2, 3)
    limit = _NEAR * min(cost for cost, _ in ends)
    found = workers.each(search.reduce, (end for end in ends if end[0] <= limit))
    progress("cover", 3, 3)
    figures = np.array([(one.cost, one.mean) for one in found])
    with np.errstate(invalid="ignore"):
        loss = (figures / figures.min(axis=0)).max(axis=1)
    return found[int(np.argmin(loss))].cover.spheres_of(mesh)
