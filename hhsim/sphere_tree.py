"""A sphere tree: balls that cover an object, coarse to fine."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.errors import InputError
from hhsim.kernels.tree import STACK_SIZE, TreeArrays

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ENCLOSING_TOLERANCE = 1e-9
"""How far a leaf may stick out of an ancestor, relative to the root's radius [-]: rounding, not geometry."""


@dataclass(frozen=True)
class LevelError:
    """How far the spheres of one level are from the mesh.

    Attributes:
        level: 0 is the root.
        spheres: Number of spheres of the level.
        gap_max: Farthest that the mesh surface lies outside the spheres [m]; 0 for a complete cover.
        gap_mean: Mean over the mesh surface [m].
        gap_p99: 99th percentile over the mesh surface [m].
        protrusion_max: Farthest that the surface of the union of the spheres lies outside the mesh [m], sampled.
        protrusion_mean: Mean over that surface, without the part inside the mesh [m].
        protrusion_p99: 99th percentile over the same [m].
        bound: Proved upper bound of the protrusion [m]: the largest of (radius − depth of the centre).
    """

    level: int
    spheres: int
    gap_max: float
    gap_mean: float
    gap_p99: float
    protrusion_max: float
    protrusion_mean: float
    protrusion_p99: float
    bound: float


LENGTHS = tuple(item.name for item in fields(LevelError) if item.name not in ("level", "spheres"))
"""The fields of a LevelError that are lengths [m]."""


@dataclass(frozen=True, eq=False)
class SphereTree:
    """Spheres in breadth-first order: node 0 is the root, children are contiguous, the leaves are the last nodes.

    All leaves lie at the same depth, and every node encloses the spheres of the leaves below it.

    Attributes:
        center: [m], shape (N, 3), frame of the mesh.
        radius: [m], shape (N,).
        level: Depth of each node, shape (N,).
        parent: Index of each node's parent, −1 for the root, shape (N,).
        errors: Measured error of each level, coarse to fine; empty if it was not measured.
        mesh_sha256: Content hash of the mesh that the tree was built for; empty if unknown.
        options: How it was built.
    """

    center: FloatArray
    radius: FloatArray
    level: IntArray
    parent: IntArray
    errors: tuple[LevelError, ...] = ()
    mesh_sha256: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Normalise the arrays and check that they are a tree.

        Raises:
            InputError: Wrong shapes or order, a value not finite, a negative radius, or a leaf outside an ancestor.
        """
        for name, kind in (("center", np.float64), ("radius", np.float64), ("level", np.int64), ("parent", np.int64)):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=kind, order="C"))
        self._require_tree()
        sticking_out, node = self._worst_enclosure()
        if sticking_out > ENCLOSING_TOLERANCE * max(float(self.radius[0]), np.finfo(np.float64).tiny):
            raise InputError(
                f"sphere tree: a leaf sticks {sticking_out:.3g} m out of its ancestor, node {node}; "
                "every node must enclose the leaves below it"
            )

    def _require_tree(self) -> None:
        count = len(self.radius)
        shapes = (self.center.shape, self.radius.shape, self.level.shape, self.parent.shape)
        if count == 0 or shapes != ((count, 3), (count,), (count,), (count,)):
            raise InputError(
                f"sphere tree: center, radius, level, parent have shapes {shapes}, expected (N, 3) and (N,)"
            )
        if not (np.isfinite(self.center).all() and np.isfinite(self.radius).all()):
            raise InputError("sphere tree: a centre or radius is not finite")
        if (self.radius < 0.0).any():
            raise InputError(f"sphere tree: node {int(np.argmin(self.radius))} has a negative radius")
        if self.parent[0] != -1 or self.level[0] != 0:
            raise InputError("sphere tree: node 0 must be the root, with parent -1 and level 0")
        rest = self.parent[1:]
        if (rest < 0).any() or (rest >= np.arange(1, count)).any() or (np.diff(rest) < 0).any():
            raise InputError("sphere tree: nodes must be in breadth-first order, children contiguous, parents first")
        if (self.level[1:] != self.level[rest] + 1).any():
            raise InputError("sphere tree: the level of a node must be its parent's plus 1")
        if (np.bincount(rest, minlength=count)[self.level < self.level[-1]] == 0).any():
            raise InputError("sphere tree: all leaves must lie at the same level")

    def _worst_enclosure(self) -> tuple[float, int]:
        """How far a leaf sticks out of an ancestor at most [m], and the ancestor."""
        ancestor = np.arange(self.leaf_start, len(self.radius))
        worst, node = -np.inf, 0
        for _ in range(self.depth):
            ancestor = self.parent[ancestor]
            distance = np.linalg.norm(self.leaf_center - self.center[ancestor], axis=1)
            excess = distance + self.leaf_radius - self.radius[ancestor]
            if excess.max() > worst:
                worst, node = float(excess.max()), int(ancestor[np.argmax(excess)])
        return worst, node

    @property
    def depth(self) -> int:
        """Level of the leaves."""
        return int(self.level[-1])

    @property
    def leaf_start(self) -> int:
        """Index of the first leaf."""
        return int(np.searchsorted(self.level, self.level[-1]))

    @property
    def leaf_count(self) -> int:
        """Number of leaves."""
        return len(self.radius) - self.leaf_start

    @property
    def leaf_center(self) -> FloatArray:
        """Centres of the leaves [m], shape (leaf_count, 3)."""
        return self.center[self.leaf_start :]

    @property
    def leaf_radius(self) -> FloatArray:
        """Radii of the leaves [m], shape (leaf_count,)."""
        return self.radius[self.leaf_start :]

    def arrays(self) -> TreeArrays:
        """Return the tree as the kernels read it, copied.

        Raises:
            InputError: Too wide and deep for a walk of the kernels, which check no bounds.
        """
        child_count = np.bincount(self.parent[1:], minlength=len(self.radius)).astype(np.int64)
        widest = int(child_count.max())
        waiting = max(widest - 1, 0) * self.depth + 1
        if waiting > STACK_SIZE:
            raise InputError(
                f"sphere tree: {self.depth} levels of up to {widest:,} children need {waiting:,} places in a walk of "
                f"{STACK_SIZE:,}: build it with a smaller branching"
            )
        first_child = np.searchsorted(self.parent, np.arange(len(self.radius))).astype(np.int64)
        first_child[child_count == 0] = -1
        x, y, z = (np.ascontiguousarray(self.center[:, k]).copy() for k in range(3))
        return TreeArrays(x, y, z, self.radius.copy(), first_child, child_count, self.leaf_start)

    def truncated(self, depth: int) -> "SphereTree":
        """Return the coarse tree that ends at a level: its spheres cover what the finer ones cover."""
        if not 0 <= depth <= self.depth:
            raise InputError(f"sphere tree: no level {depth}; it has levels 0 to {self.depth}")
        keep = self.level <= depth
        errors = tuple(error for error in self.errors if error.level <= depth)
        # The inner spheres now are leaves: they need not enclose each other, only what was below.
        radius = enclosing_radius(self.center[keep], self.radius[keep], self.level[keep], self.parent[keep])
        return replace(
            self,
            center=self.center[keep],
            radius=radius,
            level=self.level[keep],
            parent=self.parent[keep],
            errors=errors,
        )

    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> "SphereTree":
        """Return the tree moved by `rotation @ center + translation`; shapes (3, 3) and (3,) [m]."""
        matrix = np.asarray(rotation, dtype=np.float64)
        return replace(self, center=self.center @ matrix.T + np.asarray(translation, dtype=np.float64))

    def scaled(self, factor: float) -> "SphereTree":
        """Return the tree, with its errors, scaled about the origin by a positive factor [-]."""
        if not (np.isfinite(factor) and factor > 0.0):
            raise InputError(f"sphere tree: scale {factor}, expected a positive number")
        errors = tuple(
            replace(error, **{name: value * factor for name, value in asdict(error).items() if name in LENGTHS})
            for error in self.errors
        )
        return replace(self, center=self.center * factor, radius=self.radius * factor, errors=errors)

    def save(self, path: str | Path) -> None:
        """Write the hhsim-tree file; see `hhsim.tree_file.save_tree`."""
        from hhsim.tree_file import save_tree

        save_tree(self, path)

    @staticmethod
    def load(path: str | Path) -> "SphereTree":
        """Read an hhsim-tree file; see `hhsim.tree_file.load_tree`."""
        from hhsim.tree_file import load_tree

        return load_tree(path)

    def save_sph(self, path: str | Path) -> None:
        """Write the text format of Bradshaw's toolkit; see `hhsim.sph_format.save_sph`."""
        from hhsim.sph_format import save_sph

        save_sph(self, path)

    @staticmethod
    def load_sph(path: str | Path) -> "SphereTree":
        """Read the text format of Bradshaw's toolkit; see `hhsim.sph_format.load_sph`."""
        from hhsim.sph_format import load_sph

        return load_sph(path)


def enclosing_radius(center: FloatArray, radius: FloatArray, level: IntArray, parent: IntArray) -> FloatArray:
    """Radii [m], shape (N,), grown where needed so that every node encloses the leaves below it; leaves keep theirs."""
    grown = np.array(radius, dtype=np.float64)
    leaves = np.flatnonzero(level == level[-1])
    ancestor = leaves
    for _ in range(int(level[-1])):
        ancestor = parent[ancestor]
        needed = np.linalg.norm(center[leaves] - center[ancestor], axis=1) + radius[leaves]
        np.maximum.at(grown, ancestor, needed * (1.0 + 1e-12))
    return grown
