"""Boxes as meshes."""

from collections.abc import Sequence

import numpy as np

from hhsim.mesh.mesh import Mesh

_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
"""Corners of a cube of edge 1 about the origin, and its triangles."""


def box_mesh(edges: Sequence[float], name: str = "") -> Mesh:
    """Return a box about the origin by its edges [m]."""
    return Mesh(_CORNERS * np.asarray(edges, np.float64), _SIDES, name=name, source="box")
