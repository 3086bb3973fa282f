"""The triangles of any mesh as they are, for a sphere tree: which of them enclose something, and which are sheets.

A tree covers triangles; an inside is needed only to say that spheres may fill it. The inside is what the closed parts
enclose by winding number, so that its border lies in triangles. What is open has none, unless its holes are few and
flat: its distance is that of a sheet, to both sides. Sheets are in the mesh once from each side, which closes them
around nothing.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh.bvh import build_mesh_bvh, fast_winding_numbers, mesh_signed_distance
from hhsim.mesh import topology
from hhsim.mesh.repair import (
    BENT_HOLE,
    CAP_AREA,
    NEAR_VERTEX,
    SHEET_VOLUME,
    WIDE_HOLE,
    MeshInRepair,
    closed_surface,
    joined_parts,
    parting_faces,
    turn_outward,
)
from hhsim.mesh.solidify import tell_assumed
from hhsim.reproducible import dot
from hhsim.system.counted import counted

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh

FEWEST_OF_SOLID = 4
"""Parts of fewer triangles enclose nothing."""
DEEP = 0.75
"""Winding number above which a point of a sheet lies inside the solid."""


def own_triangles(mesh: "Mesh", unit_length: float = 1.0) -> "Mesh":
    """Return any mesh, in a unit of so many metres, with each of its triangles once, and a shell unless it is a solid.

    A mesh that a safe repair closes without a change of its triangles becomes that solid. Raises MeshError, which
    begins with the mesh's source, where no triangle has an area.
    """
    name = mesh.source
    vertices, faces = topology.merged_vertices(mesh.vertices, mesh.faces)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    faces = faces[np.unique(topology.distinct_rows(np.sort(faces, axis=1))[1], return_index=True)[1]]
    size = float(np.ptp(vertices, axis=0).max())
    if not len(faces) or not topology.face_areas(vertices, faces).sum() > 1e-12 * size**2:
        raise MeshError(f"{name}: no volume: its triangles have no area; expected a surface mesh")
    warnings = list[str]()
    try:
        surface = closed_surface(mesh.vertices, mesh.faces, name, unit_length)
    except MeshError:
        repairs = list[str]()
        solid, enclosing, is_sheet, is_sound = _solid_parts(MeshInRepair(vertices, faces, name, unit_length), repairs)
        if len(enclosing) and any(topology.unfolded(solid, enclosing)[1:]):
            is_sound = False
            bvh = build_mesh_bvh(solid, enclosing, signed=False, by_winding=True)
            folded = np.append(~parting_faces(bvh, solid, enclosing), False)
            is_sheet |= folded[places_in(vertices, faces, solid, enclosing)]
    else:
        solid, enclosing, is_sound = surface.vertices, surface.faces, True
        is_sheet = places_in(vertices, faces, solid, enclosing) < 0
        if not is_sheet.any():
            tell_assumed(surface, mesh.vertices, mesh.faces)
        repairs, warnings = surface.merged + surface.repairs, surface.warnings
        if not is_sheet.any():
            return replace(mesh, vertices=solid, faces=enclosing, repairs=tuple(repairs), warnings=tuple(warnings))
    sheet = faces[is_sheet]
    if len(enclosing) and len(sheet):
        sheet = sheet[~_inside(solid, enclosing, vertices, sheet, is_sound)]
    if len(sheet):
        repairs.append(f"{counted(len(sheet), 'triangle')} of open parts enclose nothing: spheres cover them as a skin")
    shell = topology.Shell(solid, enclosing, sheet)
    found = replace(mesh, vertices=vertices, faces=faces, shell=shell)
    return replace(found, repairs=tuple(repairs), warnings=tuple(warnings))


def places_in(vertices: FloatArray, faces: IntArray, others: FloatArray, there: IntArray) -> IntArray:
    """Return which of other triangles has the corners of each triangle, shape (F,), -1 for none."""
    both = np.concatenate([there, faces + len(others)])
    merged = topology.merged_vertices(np.concatenate([others, vertices]), both)[1]
    group = topology.distinct_rows(np.sort(merged, axis=1))[1]
    found = np.full(int(group.max()) + 1, -1)
    found[group[: len(there)]] = np.arange(len(there))
    return found[group[len(there) :]]


def _solid_parts(given: MeshInRepair, repairs: list[str]) -> tuple[FloatArray, IntArray, BoolArray, bool]:
    """Return vertices and faces of what encloses something, wound outward, and marks of the faces that do not.

    The last is False if what encloses something crosses itself.
    """
    vertices, faces, size = given.vertices, given.faces, given.size
    nothing = np.empty((0, 3)), np.empty((0, 3), np.int64), np.ones(len(faces), np.bool_), True
    wound = topology.alike_wound(faces)[0]
    label = topology.part_labels(wound)
    # Each part has vertices of its own, so that its edges are shared by its faces alone.
    keys = np.repeat(label, 3) * np.int64(len(vertices)) + wound.reshape(-1)
    place, corner = np.unique(keys, return_inverse=True)
    apart, part_of = vertices[place % len(vertices)], place // len(vertices)
    wound = corner.reshape(-1, 3).astype(np.int64)
    large = np.bincount(label) >= FEWEST_OF_SOLID
    kept = large[label]
    caps = topology.hole_caps(apart, wound[kept])
    loops = topology.boundary_loops(wound[kept])
    of_loop = np.array([part_of[loop[0]] for loop in loops], np.int64)
    all_faces = np.concatenate([wound, caps.faces])
    all_label = np.concatenate([label, part_of[caps.faces[:, 1]]])
    is_cap = np.arange(len(all_faces)) >= len(wound)
    parts = len(large)
    area = topology.face_areas(caps.vertices, all_faces)
    own_area, cap_area = (np.bincount(all_label[one], weights=area[one], minlength=parts) for one in (~is_cap, is_cap))
    a, b, c = (caps.vertices[all_faces] - vertices.mean(axis=0)).transpose(1, 0, 2)
    volume = np.abs(np.bincount(all_label, weights=dot(a, np.cross(b, c)) / 6.0, minlength=parts))
    bent = (caps.width > WIDE_HOLE * size) & (caps.bend > BENT_HOLE * caps.width)
    index, _, balance = topology.undirected_edges(all_faces)
    unbalanced = np.zeros(parts, np.bool_)
    unbalanced[all_label[np.flatnonzero(balance[index] != 0) // 3]] = True
    closes = large & ~unbalanced & (cap_area <= CAP_AREA * own_area)
    whole_area = own_area + cap_area
    closes &= volume >= SHEET_VOLUME * whole_area * np.sqrt(whole_area)
    closes[of_loop[bent]] = False
    surface = MeshInRepair(
        *topology.used_vertices(caps.vertices, all_faces[closes[all_label]]), given.name, given.unit_length
    )
    if not len(surface.faces):
        return nothing
    try:
        turn_outward(surface)
    except MeshError:
        return nothing
    capped = closes[of_loop]
    if capped.any():
        widest = surface.millimetres(float(caps.width[capped].max()))
        repairs.append(f"assumed closed at {counted(int(capped.sum()), 'hole')} up to {widest} wide")
    is_sound = joined_parts(surface)
    repairs += surface.repairs
    return surface.vertices, surface.faces, ~closes[label], is_sound


def _inside(solid: FloatArray, enclosing: IntArray, vertices: FloatArray, sheet: IntArray, is_sound: bool) -> BoolArray:
    """Mark the triangles whose corners and middles lie inside of the solid, or on it: none has to be measured to."""
    bvh = build_mesh_bvh(solid, enclosing, by_winding=not is_sound)
    corner = vertices[sheet]
    middle = corner.mean(axis=1, keepdims=True)
    points = np.ascontiguousarray(np.concatenate([middle, 0.9 * corner + 0.1 * middle], axis=1).reshape(-1, 3))
    if is_sound:
        near = NEAR_VERTEX * float(np.ptp(vertices, axis=0).max())
        return np.asarray((mesh_signed_distance(bvh, points) <= near).reshape(-1, 4).all(axis=1))
    return np.asarray((fast_winding_numbers(bvh, points) > DEEP).reshape(-1, 4).all(axis=1))
