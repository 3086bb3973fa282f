"""Surfaces that distances are measured to where the triangles of a mesh are no solid."""

from typing import NamedTuple

from hhsim.arrays import FloatArray, IntArray


class Shell(NamedTuple):
    """Solid and sheets of a mesh whose triangles are covered as a skin, see `hhsim.mesh.own_triangles`."""

    vertices: FloatArray  # of the solid [m], shape (W, 3)
    faces: IntArray  # around the inside, outward, corner indices in these vertices, shape (K, 3), none for no inside
    sheets: IntArray  # triangles that both sides count of, corner indices in the mesh, shape (S, 3)
