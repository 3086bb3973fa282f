"""Cover of one level: spheres that contain the whole surface of a mesh, with the proof that they do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import Codes, FloatArray, IntArray
from hhsim.errors import InputError


@dataclass(frozen=True, eq=False)
class LevelCover:
    """Spheres that stand for a mesh at one level of a sphere tree.

    Attributes:
        center: [m], shape (n, 3), frame of the mesh.
        radius: [m], shape (n,).
        depth: Depth of each centre inside the mesh, negative outside [m], shape (n,).
        gap: Largest distance of the surface outside the spheres [m]: grown by this they cover it. 0 for a full cover.
        proof: Proof that the grown spheres cover each face, as `hhsim.kernels.cover.certify` writes it, shape (m,);
            empty if nothing is proved.

    Raises:
        InputError: Wrong shapes, no sphere, a value not finite, a negative radius or gap.
    """

    center: FloatArray
    radius: FloatArray
    depth: FloatArray
    gap: float
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
        place = np.empty(len(order), np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        proof = np.where(self.proof >= 0, place[np.maximum(self.proof, 0)], self.proof)
        return LevelCover(self.center[order], self.radius[order], self.depth[order], self.gap, proof)

    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> "LevelCover":
        """Return the cover moved by `rotation @ center + translation`; shapes (3, 3) and (3,) [m].

        A mirror image loses its proof, which depends on the order of the corners of each face.
        """
        matrix = np.asarray(rotation, dtype=np.float64)
        moved = self.center @ matrix.T + np.asarray(translation, dtype=np.float64)
        proof = self.proof if np.linalg.det(matrix) > 0.0 else np.empty(0, np.int32)
        return LevelCover(moved, self.radius, self.depth, self.gap, proof)

    def scaled(self, factor: float) -> "LevelCover":
        """Return the cover scaled about the origin by a positive factor [-]."""
        return LevelCover(
            self.center * factor, self.radius * factor, self.depth * factor, self.gap * factor, self.proof
        )
