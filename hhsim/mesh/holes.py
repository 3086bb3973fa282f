"""Caps for the holes of an open surface."""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.topology import boundary_loops


class HoleCaps(NamedTuple):
    """Triangles that close every boundary loop of a surface.

    Attributes:
        vertices: The surface's vertices, then the centres of fans, shape (V + fans, 3).
        faces: The caps alone, wound as the faces around them, shape (C, 3).
        width: Longest extent of each hole in its plane, shape (H,).
        bend: Largest distance of each hole's edge from its plane, shape (H,).
    """

    vertices: FloatArray
    faces: IntArray
    width: FloatArray
    bend: FloatArray


def hole_caps(vertices: FloatArray, faces: IntArray) -> HoleCaps:
    """Cap each boundary loop of vertices (V, 3) and faces (F, 3).

    A cap is a fan about the loop's centroid where that folds nowhere in the loop's plane, else it is cut into ears.
    """
    caps, centers, widths, bends = list[IntArray](), list[FloatArray](), list[float](), list[float]()
    for loop in boundary_loops(faces):
        ring = vertices[loop]
        center = ring.mean(axis=0)
        offset = ring - center
        # The plane of least squares: the first two right singular vectors span it, the third is its normal.
        axes = np.linalg.svd(offset, full_matrices=False)[2]
        flat = offset @ axes[:2].T
        widths.append(float(np.ptp(flat[:, 0])))
        bends.append(float(np.abs(offset @ axes[2]).max()))
        if len(loop) == 3:
            caps.append(loop[::-1][None])
        elif _sees_all(flat):
            index = len(vertices) + len(centers)
            caps.append(np.stack([np.full(len(loop), index), np.roll(loop, -1), loop], axis=1))
            centers.append(center)
        else:
            caps.append(_ears(loop, flat))
    return HoleCaps(
        np.concatenate([vertices, np.array(centers).reshape(-1, 3)]),
        np.concatenate([np.empty((0, 3), dtype=np.int64), *caps]),
        np.array(widths),
        np.array(bends),
    )


def _sees_all(flat: FloatArray) -> bool:
    """True if the centroid of a polygon about the origin, shape (n, 2), sees each edge from the same side."""
    following = np.roll(flat, -1, axis=0)
    turn = flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]
    return bool((turn > 0.0).all() or (turn < 0.0).all())


def _ears(loop: IntArray, flat: FloatArray) -> IntArray:
    """Triangles between a loop's own vertices, wound against the loop."""
    from manifold3d import triangulate

    following = np.roll(flat, -1, axis=0)
    forward = float((flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]).sum()) > 0.0
    order = np.arange(len(loop)) if forward else np.arange(len(loop))[::-1]
    triangles = loop[order][np.asarray(triangulate([np.ascontiguousarray(flat[order])]), dtype=np.int64)]
    return triangles[:, ::-1] if forward else triangles
