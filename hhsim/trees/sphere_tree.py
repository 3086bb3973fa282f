"""A sphere tree: spheres that cover an object, coarse to fine."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import Codes, FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.kernels.sphere_tree import MOST_WAITING, TreeArrays
from hhsim.mesh.mesh import Mesh
from hhsim.reproducible import matmul

ENCLOSING_TOLERANCE = 1e-9
"""Accepted excess of a leaf over an ancestor, relative to the root's radius [-]: rounding, not geometry."""


@dataclass(frozen=True)
class LevelError:
    """Error of the spheres of one level."""

    level: int  # 0 is the root
    spheres: int  # number of spheres
    gap_max: float  # largest distance of the mesh surface outside the spheres [m]; 0 for a complete cover
    gap_mean: float  # mean over the mesh surface [m]
    gap_p99: float  # 99th percentile [m]
    protrusion_max: float  # largest sampled distance of the surface of the union of the spheres outside the mesh [m]
    protrusion_mean: float  # mean over that surface outside the mesh [m]
    protrusion_p99: float  # 99th percentile [m]
    bound: float  # proved upper bound of the protrusion [m]: the largest of (radius − depth of the centre)


LENGTHS = tuple(item.name for item in fields(LevelError) if item.name not in ("level", "spheres"))
"""Fields of a LevelError that are lengths [m]."""


@dataclass(frozen=True, eq=False)
class LevelCover:
    """Spheres that stand for a mesh at one level of a sphere tree.

    Raises InputError for wrong shapes, no sphere, a value not finite, a negative radius or gap.
    """

    center: FloatArray  # [m], shape (n, 3), frame of the mesh
    radius: FloatArray  # [m], shape (n,)
    depth: FloatArray  # depth of each centre inside the mesh, negative outside [m], shape (n,)
    # Largest distance of the surface outside the spheres [m]: grown by this they cover it. 0 for a full cover.
    gap: float
    # Proof that the grown spheres cover each face, as `hhsim.kernels.cover.certify` writes it, shape (m,); empty if
    # nothing is proved.
    proof: Codes

    def __post_init__(self) -> None:
        for name in ("center", "radius", "depth"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64, order="C"))
        object.__setattr__(self, "proof", np.array(self.proof, dtype=np.int32, order="C"))
        object.__setattr__(self, "gap", float(self.gap))
        count = self.radius.size
        shapes = (self.center.shape, self.radius.shape, self.depth.shape, self.proof.ndim)
        if count == 0 or shapes != ((count, 3), (count,), (count,), 1):
            raise InputError(f"cover: center, radius, depth have shapes {shapes[:3]}, expected (n, 3), (n,), (n,)")
        for values in (self.center, self.radius, self.depth, np.float64(self.gap)):
            if not np.isfinite(values).all():
                raise InputError("cover: a centre, radius, depth or gap is not finite")
        if not ((self.radius >= 0.0).all() and self.gap >= 0.0):
            raise InputError("cover: a radius or the gap is negative")

    @property
    def proved(self) -> bool:
        """True if there is a proof; `hhsim.trees.coverage_check` checks it."""
        return self.proof.size > 0

    @property
    def bound(self) -> float:
        """Largest distance of the spheres outside the mesh [m]: the largest of (radius − depth)."""
        return float((self.radius - self.depth).max())

    def reordered(self, order: IntArray) -> "LevelCover":
        """Return the cover and its proof with the spheres in another order, a permutation of shape (n,)."""
        place = np.argsort(order)
        proof = np.where(self.proof >= 0, place[np.maximum(self.proof, 0)], self.proof)
        return LevelCover(self.center[order], self.radius[order], self.depth[order], self.gap, proof)

    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> "LevelCover":
        """Return the cover moved by `rotation @ center + translation`; shapes (3, 3) and (3,) [m].

        A mirror image loses its proof, which depends on the order of the corners of each face.
        """
        matrix = np.asarray(rotation, dtype=np.float64)
        moved = matmul(self.center, matrix.T) + np.asarray(translation, dtype=np.float64)
        proof = self.proof if np.linalg.det(matrix) > 0.0 else np.empty(0, np.int32)
        return LevelCover(moved, self.radius, self.depth, self.gap, proof)

    def scaled(self, factor: float) -> "LevelCover":
        """Return the cover scaled about the origin by a positive factor [-]."""
        return LevelCover(
            self.center * factor, self.radius * factor, self.depth * factor, self.gap * factor, self.proof
        )


@dataclass(frozen=True, eq=False, repr=False)
class SphereTree:
    """Spheres in breadth-first order: node 0 is the root, children are contiguous, the leaves are the last nodes.

    All leaves lie at the same depth, and every node encloses the leaves below it, so that a walk may reject all of them
    at once. Such a node is a poor model of the mesh: each level has a cover of its own for that, with as many spheres,
    as tight as those of a tree that ends there. `at_level` makes that tree. Raises InputError for wrong shapes or
    order, a value not finite, a negative radius, a leaf outside an ancestor, or covers that are not one a level, the
    last of them the leaves.
    """

    center: FloatArray  # [m], shape (N, 3), frame of the mesh
    radius: FloatArray  # [m], shape (N,)
    level: IntArray  # depth of each node, shape (N,)
    parent: IntArray  # index of each node's parent, −1 for the root, shape (N,)
    errors: tuple[LevelError, ...] = ()  # measured error of each level, coarse to fine; empty if it was not measured
    mesh_sha256: str = ""  # content hash of the mesh that the tree was built for; empty if unknown
    options: Mapping[str, Any] = field(default_factory=dict)  # options of the builder
    # Cover of each level, 0 to the leaves', whose spheres are the leaves; empty if there are none.
    covers: tuple[LevelCover, ...] = ()
    # CPU time of each cover's build [s]; empty for a tree from a file, since files hold no times.
    cpu_seconds: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, kind in (("center", np.float64), ("radius", np.float64), ("level", np.int64), ("parent", np.int64)):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=kind, order="C"))
        self._require_tree()
        ancestor, sticking_out, node = np.arange(self.leaf_start, len(self.radius)), -np.inf, 0
        for _ in range(self.depth):
            ancestor = self.parent[ancestor]
            distance = np.linalg.norm(self.leaf_center - self.center[ancestor], axis=1)
            excess = distance + self.leaf_radius - self.radius[ancestor]
            if excess.max() > sticking_out:
                sticking_out, node = float(excess.max()), int(ancestor[np.argmax(excess)])
        if sticking_out > ENCLOSING_TOLERANCE * max(float(self.radius[0]), np.finfo(np.float64).tiny):
            raise InputError(f"sphere tree: a leaf sticks {sticking_out:.3g} m out of its ancestor, node {node}")
        if not self.covers:
            return
        if len(self.covers) != self.depth + 1:
            raise InputError(
                f"sphere tree: {len(self.covers)} covers, expected one for each of {self.depth + 1} levels"
            )
        last = self.covers[-1]
        if not (np.array_equal(last.center, self.leaf_center) and np.array_equal(last.radius, self.leaf_radius)):
            raise InputError("sphere tree: the cover of the last level must be the leaves")

    def __repr__(self) -> str:
        return f"SphereTree({len(self.radius):,} spheres, level {self.depth}: {self.leaf_count:,} leaves)"

    def _require_tree(self) -> None:
        count, rest = len(self.radius), self.parent[1:]
        shapes = (self.center.shape, self.radius.shape, self.level.shape, self.parent.shape)
        if count == 0 or shapes != ((count, 3), (count,), (count,), (count,)):
            raise InputError(f"sphere tree: center, radius, level, parent: {shapes}, expected (N, 3) and (N,)")
        if not (np.isfinite(self.center).all() and np.isfinite(self.radius).all()):
            fault = "a centre or radius is not finite"
        elif (self.radius < 0.0).any():
            fault = f"node {int(np.argmin(self.radius))} has a negative radius"
        elif self.parent[0] != -1 or self.level[0] != 0:
            fault = "node 0 must be the root, with parent -1 and level 0"
        elif (rest < 0).any() or (rest >= np.arange(1, count)).any() or (np.diff(rest) < 0).any():
            fault = "nodes must be in breadth-first order, children contiguous, parents first"
        elif (self.level[1:] != self.level[rest] + 1).any():
            fault = "the level of a node must be its parent's plus 1"
        elif (np.bincount(rest, minlength=count)[self.level < self.level[-1]] == 0).any():
            fault = "all leaves must lie at the same level"
        else:
            return
        raise InputError(f"sphere tree: {fault}")

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

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the axis-aligned box around the leaves [m], shape (2, 3)."""
        radius = self.leaf_radius[:, None]
        return np.stack([(self.leaf_center - radius).min(axis=0), (self.leaf_center + radius).max(axis=0)])

    def arrays(self) -> TreeArrays:
        """Return a copy of the tree in the kernels' form; InputError if it is too wide and deep for a walk."""
        child_count = np.bincount(self.parent[1:], minlength=len(self.radius)).astype(np.int64)
        widest = int(child_count.max())
        waiting = max(widest - 1, 0) * self.depth + 1
        if waiting > MOST_WAITING:
            needed = f"{self.depth} levels of up to {widest:,} children need {waiting:,} places of {MOST_WAITING:,}"
            raise InputError(f"sphere tree: {needed} in a walk: build it with a smaller branching")
        first_child = np.searchsorted(self.parent, np.arange(len(self.radius))).astype(np.int64)
        leaves = np.flatnonzero(child_count == 0)
        first_child[leaves] = -1 - leaves
        x, y, z = (np.ascontiguousarray(self.center[:, k]).copy() for k in range(3))
        return TreeArrays(x, y, z, self.radius.copy(), first_child, child_count)

    def spheres(self, level: int) -> tuple[FloatArray, FloatArray]:
        """Return centres [m], (n, 3), and radii [m], (n,), of the cover of a level, or of its nodes without covers."""
        self.require_level(level)
        if self.covers:
            return self.covers[level].center, self.covers[level].radius
        chosen = self.level == level
        return self.center[chosen], self.radius[chosen]

    def require_level(self, level: int) -> None:
        """Raise InputError where the tree has no such level."""
        if not 0 <= level <= self.depth:
            raise InputError(f"sphere tree: no level {level}; it has levels 0 to {self.depth}")

    def check(self, mesh: Mesh) -> tuple[str, ...]:
        """Return the faults of the tree's covers and their proofs; see `hhsim.trees.coverage_check.faults`."""
        from hhsim.trees.coverage_check import faults

        return faults(mesh, self.covers)

    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> "SphereTree":
        """Return the tree moved by `rotation @ center + translation` [m]; mirrored (determinant −1), without proofs."""
        matrix = np.asarray(rotation, dtype=np.float64)
        center = matmul(self.center, matrix.T) + np.asarray(translation, dtype=np.float64)
        covers = tuple(cover.transformed(rotation, translation) for cover in self.covers)
        return replace(self, center=center, covers=covers)

    def scaled(self, factor: float) -> "SphereTree":
        """Return the tree, with its covers and errors, scaled about the origin by a positive factor [-]."""
        if not (np.isfinite(factor) and factor > 0.0):
            raise InputError(f"sphere tree: scale {factor}, expected a positive number")
        errors = tuple(
            replace(error, **{name: value * factor for name, value in asdict(error).items() if name in LENGTHS})
            for error in self.errors
        )
        covers = tuple(cover.scaled(factor) for cover in self.covers)
        return replace(self, center=self.center * factor, radius=self.radius * factor, errors=errors, covers=covers)


def enclosing_radius(center: FloatArray, radius: FloatArray, level: IntArray, parent: IntArray) -> FloatArray:
    """Grow radii [m], shape (N,), where needed so that every node encloses the leaves below it; leaves keep theirs."""
    grown = np.array(radius, dtype=np.float64)
    leaves = np.flatnonzero(level == level[-1])
    ancestor = leaves
    for _ in range(int(level[-1])):
        ancestor = parent[ancestor]
        needed = np.linalg.norm(center[leaves] - center[ancestor], axis=1) + radius[leaves]
        np.maximum.at(grown, ancestor, needed * (1.0 + 1e-12))
    return grown
