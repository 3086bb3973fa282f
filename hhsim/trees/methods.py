"""The ways to build a sphere tree, in one table."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover import medial_reduction as medial_reduce
from hhsim.kernels.mesh import octree_clipping as cell_pieces
from hhsim.mesh.mesh import Mesh
from hhsim.trees import enclosing_tree, medial_axis
from hhsim.trees import medial_axis_tree as medial_tree
from hhsim.trees import octree as octree_tree
from hhsim.trees.medial_axis_tree import build_medial_tree
from hhsim.trees.octree import build_fitted_octree, build_octree
from hhsim.trees.sphere_tree import SphereTree

FloatArray = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

TreeGrower = Callable[[Mesh, int, int, int | None, Progress | None], SphereTree]
"""Builds a tree from (mesh, level of the leaves, most children, most leaves or None, progress)."""


@dataclass(frozen=True)
class TreeMethod:
    """A way to build a sphere tree.

    Attributes:
        about: What it does, for `--help`.
        grow: Builds the tree; None for `certified`, which `hhsim.trees.builder` builds level by level. The tree need
        not
            be measured, nor know its mesh and options. Where a level has spheres of its own that its nodes, which must
            enclose the leaves below them, had to be grown from, these go into `SphereTree.covers` without a proof.
        sources: Modules that the tree depends on besides those of the tree itself: a change in any of them makes
            cached trees stale.
    """

    about: str
    grow: TreeGrower | None = None
    sources: tuple[ModuleType, ...] = ()


METHODS: dict[str, TreeMethod] = {
    "certified": TreeMethod("every level a proved cover of the mesh that protrudes as little as can be"),
    "medial": TreeMethod(
        "adaptive medial axis, after Bradshaw and O'Sullivan (2004)",
        build_medial_tree,
        (enclosing_tree, medial_axis, medial_reduce, medial_tree),
    ),
    "octree": TreeMethod(
        "balls around the cells of an octree", build_octree, (cell_pieces, enclosing_tree, octree_tree)
    ),
    "octree-fitted": TreeMethod(
        "balls around the surface in the cells of an octree",
        build_fitted_octree,
        (cell_pieces, enclosing_tree, octree_tree),
    ),
}
"""By name; the first is the default."""
