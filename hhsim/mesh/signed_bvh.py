"""Hierarchy over a mesh that is a solid, or a skin with a shell."""

from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh
from hhsim.mesh.mesh import Mesh


def signed_bvh(mesh: Mesh) -> MeshBvh:
    """Build the hierarchy over a mesh, or its shell, that tells how deep a point lies inside [m]."""
    shell = mesh.shell or mesh
    return build_mesh_bvh(shell.vertices, shell.faces, by_winding=mesh.shell is not None)
