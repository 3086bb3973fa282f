"""The ways to build a sphere tree, in one table."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from hhsim import enclosing_tree, medial_axis, medial_tree, octree_tree
from hhsim.kernels import cell_pieces, medial_reduce
from hhsim.medial_tree import build_medial_tree
from hhsim.mesh import Mesh
from hhsim.octree_tree import build_fitted_octree, build_octree
from hhsim.sphere_tree import SphereTree

FloatArray = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

TreeGrower = Callable[[Mesh, int, int, int | None, Progress | None], SphereTree]
"""Builds a tree from (mesh, level of the leaves, most children, most leaves or None, progress)."""


@dataclass(frozen=True)
class TreeMethod:
    """A way to build a sphere tree.

    Attributes:
        about: What it does, for `--help`.
        grow: Builds the tree; None for `certified`, which `hhsim.tree_builder` builds level by level. The tree need not
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
