"""Sphere trees whose grouping is given: the least balls around leaves, and what the levels' own balls cover."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.enclosing_ball import enclosing_ball
from hhsim.kernels.mesh.bvh import MeshBvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.trees.error import prove_cover
from hhsim.trees.level_cover import LevelCover
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import ROUNDING

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OVERLAP = 2e-5


def enclosing_tree(
    covers: Sequence[LevelCover], parents: Sequence[IntArray], cpu_seconds: Sequence[float] = ()
) -> SphereTree:
    """Make a tree of the covers of its levels; each inner node is the least ball around the leaves below it.

    Args:
        covers: Of the levels 0, 1, … to the leaves, each with its balls in the order of the nodes.
        parents: Of the nodes of the levels 1, 2, …: a node of the level above by its place there, ascending.
        cpu_seconds: That each cover took [s].
    """
    center, radius = covers[-1].center, covers[-1].radius
    centers, radii = [center], [radius]
    below, ball = np.arange(len(radius)), np.empty(4)
    for parent in reversed(parents):
        below = parent[below]
        groups = np.split(np.arange(len(radius)), np.searchsorted(below, np.arange(1, parent[-1] + 1)))
        nodes = np.empty((len(groups), 4))
        for node, members in zip(nodes, groups, strict=True):
            enclosing_ball(center, radius, members, ball)
            node[:] = ball
        centers.append(nodes[:, :3])
        radii.append(nodes[:, 3])
    count = [len(each) for each in reversed(radii)]
    start = np.concatenate([[0], np.cumsum(count)])
    links = [np.array([-1]), *(start[depth] + parent for depth, parent in enumerate(parents))]
    tree = SphereTree(
        np.concatenate(centers[::-1]),
        np.concatenate(radii[::-1]),
        np.repeat(np.arange(len(count)), count),
        np.concatenate(links),
    )
    return replace(tree, covers=tuple(covers), cpu_seconds=tuple(cpu_seconds))


def cover_with_proof(mesh: Mesh, bvh: MeshBvh, center: FloatArray, radius: FloatArray) -> LevelCover:
    """Make a cover of balls that are said to contain the whole surface, with the proof if there is one.

    Where there is none, they are made larger by `OVERLAP` of the mesh's longest extent, and it is tried again.

    Args:
        mesh: That they cover.
        bvh: over it.
        center: [m], shape (n, 3).
        radius: [m], shape (n,); they get larger by what rounding may have cost.
    """
    radius = radius + ROUNDING * (radius + float(np.abs(mesh.bounds).max()))
    _, proof = prove_cover(mesh.vertices, mesh.faces, center, radius)
    if not proof.size:
        # Where balls only just meet on the surface, as at the corners of cells, nothing but an overlap can be proved.
        radius = radius + OVERLAP * float(mesh.extent.max())
        _, proof = prove_cover(mesh.vertices, mesh.faces, center, radius)
    return LevelCover(center, radius, -mesh_signed_distance(bvh, center), 0.0, proof)
