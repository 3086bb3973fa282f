"""Object as the shapes that engines collide fastest: a ball, a box, or convex parts by CoACD, kept in the cache.

CoACD: Wei, Liu, Ling & Su, "Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and Tree
Search", ACM Transactions on Graphics 41(4), 2022.
"""

import hashlib
import io
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from zipfile import BadZipFile

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import OutputError
from hhsim.kernels.cache_folder import cache_root
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import is_closed
from hhsim.system.atomic_write import write_atomically

COARSE, FINE = 0.02, 0.01
"""CoACD's thresholds over the object's half size: the lower end of its range (0.01 to 1), since parts fill hollows."""
SEED = 0
CONVEX = 1e-6
"""Largest share of its hull that a convex mesh leaves empty."""
ROUND = 2e-3
"""Largest relative difference of the distances of a ball's vertices from its centre."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball, world [m]."""

    center: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class Box:
    """A box along the axes of the world [m]."""

    center: FloatArray
    half: FloatArray


@dataclass(frozen=True, eq=False)
class Hull:
    """Convex hull of points, world [m], shape (V, 3)."""

    points: FloatArray


Part = Ball | Box | Hull


def convex_parts(mesh: Mesh, concavity: float = COARSE) -> list[Part]:
    """Return the parts of a mesh [m], world; one if it is convex, else those of CoACD's threshold `concavity`."""
    simple = _simple(mesh)
    return [simple] if simple is not None else [Hull(points) for points in _decomposition(mesh, concavity)]


def _simple(mesh: Mesh) -> Part | None:
    from scipy.spatial import ConvexHull

    points = mesh.vertices
    low, high = points.min(axis=0), points.max(axis=0)
    center = 0.5 * (low + high)
    hull = ConvexHull(points)
    if abs(mesh.volume - hull.volume) > CONVEX * hull.volume:
        return None
    if abs(hull.volume - float(np.prod(high - low))) <= CONVEX * hull.volume:
        return Box(center, 0.5 * (high - low))
    away = np.linalg.norm(points[hull.vertices] - center, axis=1)
    if len(hull.vertices) > 100 and np.ptp(away) <= ROUND * away.max():
        # A ball of the same volume: as far out at the corners as in at the faces.
        return Ball(center, float((0.75 * hull.volume / np.pi) ** (1.0 / 3.0)))
    return Hull(points[hull.vertices])


def _decomposition(mesh: Mesh, concavity: float) -> list[FloatArray]:
    digest = hashlib.sha256(f"{mesh.sha256} {concavity} {_preparation(mesh)} {SEED}".encode()).hexdigest()
    path = cache_root() / "convex-parts" / f"{digest[:32]}.npz"
    with suppress(OSError, ValueError, BadZipFile), np.load(path) as kept:
        return [kept[name] for name in kept.files]
    parts = _decompose(mesh, concavity)
    image = io.BytesIO()
    kept_parts: dict[str, Any] = {f"part{i:04d}": part for i, part in enumerate(parts)}
    np.savez(image, **kept_parts)
    with suppress(OSError, OutputError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, image.getvalue())
    return parts


def _decompose(mesh: Mesh, concavity: float) -> list[FloatArray]:
    import coacd

    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces), threshold=concavity, preprocess_mode=_preparation(mesh), seed=SEED
    )
    return [np.array(points, np.float64) for points, _ in found]


def _preparation(mesh: Mesh) -> str:
    """CoACD's preprocessing: by default it remeshes a mesh whose triangles touch, 0.6 mm too large."""
    return "off" if is_closed(mesh.faces) else "auto"
