"""Volume, centre and inertia of the solid that a closed mesh encloses, by the divergence theorem.

After Tonon, Explicit exact formulas for the 3-D tetrahedron inertia tensor in terms of its vertex coordinates, 2005.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import MeshError
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import is_closed, merged_vertices

LEAST_FILLED = 1e-6
"""A mesh that encloses less than this share of its longest extent cubed has sides that cancel out."""


class MassProperties(NamedTuple):
    """Volume [m³], centre of mass [m], (3,), in the mesh's frame, and inertia [m⁵], (3, 3), of a solid of density 1.

    The inertia is about the centre, in the mesh's axes; times a density [kg/m³] it is in kg·m².
    """

    volume: float
    center: FloatArray
    inertia: FloatArray


def mass_properties(mesh: Mesh) -> MassProperties:
    """Compute volume, centre and inertia of the inside of a mesh; MeshError if it has none, or is wound inside out."""
    # Corners of equal places are one: a file may have given each triangle its own.
    if not is_closed(merged_vertices(mesh.vertices, mesh.faces)[1]):
        raise MeshError(
            f"{mesh.name}: not closed, so it has no mass; make sheets of its open parts (--thickness), let hhsim close "
            "it (--surface spheres), or let the object stand still"
        )
    if mesh.volume <= LEAST_FILLED * float(mesh.extent.max()) ** 3:
        filled = f"the triangles enclose {1e6 * mesh.volume:.3g} cm³"
        raise MeshError(f"{mesh.name}: {filled}: no mass; a free object needs a solid, wound outward")
    origin = mesh.bounds.mean(axis=0)
    corners = mesh.triangles - origin
    a, b, c = corners.transpose(1, 0, 2)
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    volume = float(volumes.sum())
    sums = corners.sum(axis=1)
    center = volumes @ sums / (4.0 * volume)
    products = np.einsum("t,tci,tcj->ij", volumes, corners, corners) + np.einsum("t,ti,tj->ij", volumes, sums, sums)
    second = products / 20.0 - volume * np.outer(center, center)
    return MassProperties(volume, center + origin, np.trace(second) * np.eye(3) - second)
