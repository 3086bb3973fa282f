"""Contact surface of an object: the leaf spheres of its tree, or the triangles of its mesh."""

from typing import Any, NamedTuple

from hhsim.errors import InputError
from hhsim.mesh.features import mesh_features
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import is_closed, merged_vertices
from hhsim.system.counted import counted
from hhsim.trees.sphere_tree import SphereTree


class ContactSurface(NamedTuple):
    """A surface in the kernels' form, and its origin."""

    arrays: Any  # arrays of a surface of `hhsim.kernels.surfaces`, in the frame of mesh and tree
    notes: tuple[str, ...] = ()  # what of the object cannot be touched or is unknown, a sentence each
    mesh: Mesh | None = None  # source of the arrays; None where the object has none
    tree: SphereTree | None = None


def encloses(mesh: Mesh) -> bool:
    """Return True if the triangles of a mesh enclose something, wound outward."""
    return is_closed(merged_vertices(mesh.vertices, mesh.faces)[1]) and mesh.volume > 0.0


def contact_surface(name: str, mesh: Mesh | None, tree: SphereTree | None) -> ContactSurface:
    """Make the surface `spheres` or `mesh` of an object [m], and its sphere tree in the same frame.

    Raises InputError for a surface that no object has, or not this one, MeshError where no triangle has an area.
    """
    if name not in ("spheres", "mesh"):
        raise InputError(f"no object has the surface '{name}': expected spheres or mesh")
    if name == "spheres" and tree is not None:
        return ContactSurface(tree.arrays(), (), mesh, tree)
    if name == "spheres" or mesh is None:
        raise InputError(f"this object has no {name}")
    closed = encloses(mesh)
    features, repeated = mesh_features(mesh.vertices, mesh.faces, closed=closed)
    notes = []
    if repeated:
        notes.append(f"{counted(repeated, 'triangle')} on the same corners as another one: that one is touched")
    if closed and features.pseudonormal.shape[0] == 0:
        notes.append("the triangles touch or cross each other, or are wound inside out: both sides can be touched")
    if not closed:
        notes.append("the triangles enclose nothing: both sides can be touched, and no hand begins inside")
    return ContactSurface(features, tuple(notes), mesh, tree)
