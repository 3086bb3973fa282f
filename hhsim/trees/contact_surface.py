"""Contact surface of an object or several parts: the leaf spheres of its tree, or the triangles of its mesh."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.kernels.by_reference import write_rows
from hhsim.kernels.contact.surface import seen_as
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.parts.surface import JointedSurface, PartsMotion, part_dtype
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.surfaces.mesh import SURFACE as MESH
from hhsim.kernels.surfaces.spheres import SURFACE as SPHERES
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
    features, repeated = features_of(mesh, closed)
    notes = []
    if repeated:
        notes.append(f"{counted(repeated, 'triangle')} on the same corners as another one: that one is touched")
    if closed and features.pseudonormal.shape[0] == 0:
        notes.append("the triangles touch or cross each other, or are wound inside out: both sides can be touched")
    if not closed:
        notes.append("the triangles enclose nothing: both sides can be touched, and no hand begins inside")
    return ContactSurface(features, tuple(notes), mesh, tree)


@lru_cache(maxsize=8)
def features_of(mesh: Mesh, closed: bool) -> tuple[MeshFeatures, int]:
    """Return what `hhsim.mesh.features.mesh_features` finds of a mesh; nobody writes there."""
    return mesh_features(mesh.vertices, mesh.faces, closed=closed)


def jointed_surface(parts: Sequence[ContactSurface], path: FloatArray) -> JointedSurface:
    """Put the surfaces of parts, each in its part's frame, together, with the parts where they are at the first tick.

    `path` has position [m] and orientation (w, x, y, z) of each part in the body's frame at each tick, (T, P, 7).
    Raises InputError for parts of different surfaces.
    """
    arrays = [part.arrays for part in parts]
    kinds = {type(each) for each in arrays}
    if kinds not in ({TreeArrays}, {MeshFeatures}):
        raise InputError(f"parts of {', '.join(sorted(kind.__name__ for kind in kinds))}; expected one kind of surface")
    solids = arrays if kinds == {MeshFeatures} else [contact_surface("mesh", part.mesh, None).arrays for part in parts]
    rows = [write_rows(of) for of in (arrays, solids)]
    # The rows only say where the arrays of the parts are, which are kept as long as they.
    for written, of in zip(rows, (arrays, solids)):
        finalize(written, tuple, of)
    sticks_out = np.array([_sticks_out(part) for part in parts])
    no_part = np.empty(0, part_dtype((SPHERES if kinds == {TreeArrays} else MESH).candidates))
    motion = PartsMotion(np.ascontiguousarray(path, np.float64), np.zeros(1, np.int64), no_part)
    return begun(JointedSurface(arrays[0], rows[0], solids[0], rows[1], sticks_out, no_part, motion))


def _sticks_out(part: ContactSurface) -> float:
    """Return how far a part's spheres are outside its mesh at most [m]; 0 of the mesh itself."""
    if not isinstance(part.arrays, TreeArrays) or part.tree is None or not part.tree.covers:
        return 0.0
    return max(0.0, part.tree.covers[-1].bound)


def begun(surface: JointedSurface) -> JointedSurface:
    """Return a surface with lists of its own, its parts where they are at the first tick."""
    count, path = len(surface.written), surface.motion.path
    memory = np.empty(max(count, 2), surface.part.dtype)
    # Written, so that the system allocates the pages now and not in the ticks that are timed.
    memory.view(np.uint8)[:] = 0
    memory["sticks_out"][:count] = surface.sticks_out
    motion = PartsMotion(path, np.zeros(1, np.int64), seen_as(memory, part_dtype()))
    surface = surface._replace(part=memory[:count].view(np.recarray), motion=motion)
    put_parts(surface, path[0])
    return surface


def put_parts(surface: JointedSurface, poses: FloatArray) -> None:
    """Put the parts to poses, as of a tick of `PartsMotion.path`, (P, 7)."""
    for part, pose in zip(surface.part, poses):
        part.position[:], part.orientation[:] = pose[:3], pose[3:]
        rotation = np.empty((3, 3))
        quaternion_to_matrix(np.array(part.orientation), rotation)
        part.rotation[:] = rotation
