"""The medial axis of a solid, approximated by balls: Voronoi vertices of samples of its surface.

Each Voronoi vertex that lies inside is the centre of a ball that touches four or more samples and holds none (Hubbard
1996). Where such a ball sticks out, the samples are too far apart: the surface point that it sticks out of farthest is
sampled too (Bradshaw and O'Sullivan 2004, "Adaptive medial-axis approximation for sphere-tree construction", ACM
Transactions on Graphics 23(1), 1–26).
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.mesh.bvh import MeshBvh, closest_points

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ROUNDS = 20
_WORST = (0.08, 0.25)
"""Share of the balls, the worst ones, whose closest surface points become samples in a round: at least and at most."""
_ENOUGH = 0.95
"""Share of the wanted balls that is near enough."""
_APART = 1e-6
"""Samples nearer to each other than this share of the surface's extent are one."""
_SAME = 1e-4
"""Balls whose centres lie in one cell of a grid with this share of the extent are one: where many samples lie on one
sphere, as on a cylinder's, rounding makes many vertices of one."""


@dataclass(frozen=True, eq=False)
class MedialAxis:
    """Balls that stand for the medial axis.

    Attributes:
        sample: Points of the surface [m], shape (n, 3).
        center: Centres inside the solid [m], shape (m, 3).
        radius: Distance of each centre from its nearest samples [m], shape (m,).
        depth: Its distance from the surface [m], positive and at most the radius, shape (m,).
        closest: The surface point nearest to it [m], shape (m, 3).
        touching: Sample and ball of each pair that touches, shape (pairs, 2).
    """

    sample: FloatArray
    center: FloatArray
    radius: FloatArray
    depth: FloatArray
    closest: FloatArray
    touching: IntArray

    @property
    def error(self) -> FloatArray:
        """How far each ball sticks out at most [m], shape (m,)."""
        return np.asarray(self.radius - self.depth)


def medial_axis(bvh: MeshBvh, sample: FloatArray) -> MedialAxis:
    """The medial balls of samples.

    Args:
        bvh: over the mesh, wound outward.
        sample: points of its surface [m], shape (n, 3), n ≥ 5, not all in one plane.
    """
    from scipy.spatial import Voronoi

    diagram = Voronoi(sample)
    regions = [diagram.regions[k] for k in diagram.point_region]
    vertex = np.fromiter(chain.from_iterable(regions), np.int64)
    touching = np.column_stack([np.repeat(np.arange(len(regions)), [len(region) for region in regions]), vertex])
    # −1 stands for infinity.
    touching = touching[touching[:, 1] >= 0]
    center = np.ascontiguousarray(diagram.vertices)
    closest, signed = np.empty_like(center), np.empty(len(center))
    # Far away, beyond any place inside, it would only cost time.
    low, high = sample.min(axis=0), sample.max(axis=0)
    near = ((center >= low) & (center <= high)).all(axis=1)
    signed[~near] = np.inf
    found, distance = np.empty((int(near.sum()), 3)), np.empty(int(near.sum()))
    closest_points(bvh, np.ascontiguousarray(center[near]), found, distance)
    closest[near], signed[near] = found, distance
    radius = np.full(len(center), np.inf)
    distances = np.linalg.norm(sample[touching[:, 0]] - center[touching[:, 1]], axis=1)
    np.minimum.at(radius, touching[:, 1], distances)

    inside = np.flatnonzero(signed < 0.0)
    cell = np.floor((center[inside] - low) / (_SAME * float((high - low).max()))).astype(np.int64)
    _, first, same = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    kept = inside[first]
    ball = np.full(len(center), -1)
    ball[inside] = same.ravel()
    touching = np.column_stack([touching[:, 0], ball[touching[:, 1]]])
    touching = np.unique(touching[touching[:, 1] >= 0], axis=0)
    return MedialAxis(sample, np.ascontiguousarray(center[kept]), radius[kept], -signed[kept], closest[kept], touching)


def refined_medial_axis(bvh: MeshBvh, sample: FloatArray, balls: int) -> MedialAxis:
    """The medial axis of samples to which more are added, where its balls stick out farthest.

    Args:
        bvh: over the mesh.
        sample: where to begin, as for `medial_axis`.
        balls: Enough of them.
    """
    axis = medial_axis(bvh, sample)
    for _ in range(_ROUNDS):
        here = len(axis.depth)
        if here >= _ENOUGH * balls:
            break
        # A new sample makes about three balls.
        count = np.clip((balls - here) // 3, max(8, int(_WORST[0] * here)), max(8, int(_WORST[1] * here)))
        worst = np.argsort(-axis.error, kind="stable")[: int(count)]
        grown = with_new_samples(axis.sample, axis.closest[worst])
        if len(grown) == len(axis.sample):
            break
        axis = medial_axis(bvh, grown)
    return axis


def with_new_samples(sample: FloatArray, more: FloatArray) -> FloatArray:
    """Samples and those of `more` that are not there yet."""
    from scipy.spatial import cKDTree

    apart = _APART * float(np.ptp(sample, axis=0).max())
    more = more[cKDTree(sample).query(more)[0] > apart]
    twice = cKDTree(more).query_pairs(apart, output_type="ndarray") if len(more) else np.empty((0, 2), np.int64)
    more = np.delete(more, np.unique(twice[:, 1]), axis=0)
    return np.concatenate([sample, more])
