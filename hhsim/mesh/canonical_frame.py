"""A frame that moves with a mesh: what is computed in it does not depend on the mesh's place, rotation and size."""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray

GRID = 2.0**-30
"""Step of the coordinates in the frame [-]: coarser than the rounding of a motion, which it removes."""

_TIE = 1e-6


@dataclass(frozen=True)
class CanonicalFrame:
    """A similarity: a point p [m] has the coordinates rotation @ (p − origin) / size.

    Attributes:
        origin: Mean of the vertices [m], shape (3,).
        rotation: Rows are the axes of the frame, shape (3, 3).
        size: Distance of the farthest vertex from the origin [m].
    """

    origin: FloatArray
    rotation: FloatArray
    size: float

    def into(self, points: FloatArray) -> FloatArray:
        """Return the coordinates of points [m], shape (n, 3), on the grid."""
        inside = (points - self.origin) @ self.rotation.T / self.size
        return np.ascontiguousarray(np.round(inside / GRID) * GRID)

    def out_of(self, points: FloatArray) -> FloatArray:
        """Return the points [m] of coordinates, shape (n, 3)."""
        return np.ascontiguousarray(points @ self.rotation * self.size + self.origin)


def canonical_frame(vertices: FloatArray) -> CanonicalFrame:
    """Compute the frame of vertices [m], shape (V, 3).

    Its axes lead to the farthest vertex and to the one that is then farthest off the axis. Of those equally far the
    first
    counts: a symmetric mesh, whose principal axes would be arbitrary, has a frame too.
    """
    origin = vertices.mean(axis=0)
    arm = vertices - origin
    distance = np.linalg.norm(arm, axis=1)
    size = float(distance.max())
    if not size > 0.0:
        return CanonicalFrame(origin, np.eye(3), 1.0)
    first = arm[np.argmax(distance >= (1.0 - _TIE) * size)]
    x = first / np.linalg.norm(first)
    across = arm - np.outer(arm @ x, x)
    distance = np.linalg.norm(across, axis=1)
    if not distance.max() > _TIE * size:
        across = np.eye(3) - np.outer(x, x)
        distance = np.linalg.norm(across, axis=1)
    second = across[np.argmax(distance >= (1.0 - _TIE) * distance.max())]
    y = second / np.linalg.norm(second)
    return CanonicalFrame(origin, np.stack([x, y, np.cross(x, y)]), size)
