"""The ways to build a sphere tree, in one table."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from hhsim.mesh import Mesh
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
}
"""By name; the first is the default."""
