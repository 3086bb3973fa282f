"""Meshes that can be touched from the front of their triangles alone: the boundary of a solid, without folds."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.winding_number import winding_numbers
from hhsim.mesh.topology import face_areas, part_labels

WINDING_WORK = 3.0e7
"""Most pairs of a part and a triangle that winding numbers are computed for, about a third of a second. A mesh of more
parts is taken to be touched from both sides, which is right of any mesh and slower."""
BEHIND = 0.25
"""Least mean of the winding numbers on both sides of a triangle that has a solid behind it: it is 1/2 there, and -1/2
of one that is wound inside out."""


def has_solid_behind(place: FloatArray, corners: IntArray) -> bool:
    """Return True where the winding number is at least 1 behind every triangle.

    Args:
        place: Vertices [m], shape (V, 3).
        corners: Closed triangles that do not touch each other but along their sides, two at each, shape (F, 3). The
            winding number is then the same behind all triangles of a part.
    """
    part = part_labels(corners)
    parts = int(part.max()) + 1
    if parts * len(corners) > WINDING_WORK:
        return False
    # The largest triangle of each part, at whose middle all others are far away.
    order = np.lexsort((-face_areas(place, corners), part))
    largest = order[np.searchsorted(part[order], np.arange(parts))]
    triangles = np.ascontiguousarray(place[corners])
    for i in largest.tolist():
        middle = triangles[i].mean(axis=0)[None]
        whole, own = np.empty(1), np.empty(1)
        winding_numbers(triangles, middle, whole)
        # On the triangle itself its own share is 1/2 or -1/2, by rounding; without it the mean of both sides is left.
        winding_numbers(triangles[i : i + 1], middle, own)
        if not float(whole[0] - own[0]) > BEHIND:
            return False
    return True
