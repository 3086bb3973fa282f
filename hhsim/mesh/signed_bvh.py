"""Hierarchy over a mesh that is a solid, or over the solid and the sheets of a skin."""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.bvh import MeshBvh, WindingMoments, build_mesh_bvh
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import part_labels


def signed_bvh(mesh: Mesh) -> MeshBvh:
    """Build the hierarchy over a mesh [m], or its shell, that tells how deep a point lies inside."""
    shell = mesh.shell
    if shell is None:
        # Where parts touch, the closest face of a point in one of them may be the other's, which it is outside of.
        has_parts = bool(part_labels(mesh.faces).any())
        return build_mesh_bvh(mesh.vertices, mesh.faces, signed=not has_parts, by_winding=has_parts)
    if not len(shell.faces):
        return _sheets(mesh.vertices, shell.sheets)
    solid = build_mesh_bvh(shell.vertices, shell.faces, signed=False, by_winding=True)
    return _joined(solid, _sheets(mesh.vertices, shell.sheets)) if len(shell.sheets) else solid


def _sheets(vertices: FloatArray, faces: IntArray) -> MeshBvh:
    """Build the hierarchy over triangles that enclose nothing: none of its nodes adds to a winding number."""
    bvh = build_mesh_bvh(vertices, faces, signed=False)
    nodes = len(bvh.start)
    # A node without a radius is far away from everything but its centre.
    aside = bvh.bound[0, 3:6] + 1e3 * (bvh.bound[0, 3:6] - bvh.bound[0, :3]).max()
    moments = WindingMoments(np.tile(aside, (nodes, 1)), np.zeros(nodes), np.zeros((nodes, 12)))
    return bvh._replace(moments=moments)


def _joined(one: MeshBvh, other: MeshBvh) -> MeshBvh:
    """Put a root over two hierarchies, of which only the first adds to the winding number."""
    root = np.zeros((1, one.bound.shape[1]))
    # Its slab, of no normal, is everywhere.
    root[0, :3], root[0, 3:6] = (
        np.minimum(one.bound[0, :3], other.bound[0, :3]),
        np.maximum(one.bound[0, 3:6], other.bound[0, 3:6]),
    )
    triangles, nodes = len(one.face), len(one.start)

    def down(right: IntArray, by: int) -> IntArray:
        return np.where(right < 0, right, right + by)

    moments = WindingMoments(*(np.concatenate([a[:1], a, b]) for a, b in zip(one.moments, other.moments)))
    return MeshBvh(
        np.concatenate([one.corner, other.corner]),
        np.concatenate([one.pseudonormal, other.pseudonormal]),
        np.concatenate([one.face, other.face + triangles]),
        np.concatenate([root, one.bound, other.bound]),
        np.concatenate([[0], one.start, other.start + triangles]),
        np.concatenate([[triangles + len(other.face)], one.end, other.end + triangles]),
        np.concatenate([[1 + nodes], down(one.right, 1), down(other.right, 1 + nodes)]),
        moments,
    )
