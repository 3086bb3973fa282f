"""Faces with known answers: planes, ridges, wedges, for a hand that lies at them by construction."""

import numpy as np

from hhsim.bench.robustness.triangle_objects import joined_mesh, sheet_mesh
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.mesh import Mesh

CLEAR = 5e-7
"""What a contact keeps clear [m]."""


def floor(size: float = 0.6) -> Mesh:
    """The plane z = 0, of two triangles."""
    return sheet_mesh(size, size)


def wedge(angle: float) -> Mesh:
    """Two faces that meet in the x axis, each `angle` [rad] above the plane z = 0 on its side: a valley."""
    sides = []
    for sign in (1.0, -1.0):
        half = sheet_mesh(0.6, 0.3).transformed(np.eye(3), (0.0, 0.15 * sign, 0.0))
        sides.append(half.transformed(rotation_matrix(quaternion(np.array([angle * sign, 0.0, 0.0]))), np.zeros(3)))
    return joined_mesh(sides)
