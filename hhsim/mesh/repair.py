"""Checks of a triangle mesh, and the safe repairs: each is named, and what is not safe is refused."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.holes import hole_caps
from hhsim.mesh.repair_log import MeshInRepair
from hhsim.mesh.self_intersection import resolve_overlaps, turn_outward
from hhsim.mesh.topology import (
    alike_wound,
    distinct_rows,
    face_areas,
    merged_vertices,
    part_labels,
    signed_volume,
    undirected_edges,
    used_vertices,
)
from hhsim.system.counted import counted

NEAR_VERTEX = 1e-5
"""Vertices closer than this share of the longest extent are merged where that closes open edges."""

FRAGMENT_AREA = 0.01
"""Loose open fragments may be dropped up to this share of the surface."""

CAP_AREA = 0.4
"""Holes are closed up to this share of caps in the surface; beyond it the surface is called open."""

SHEET_VOLUME = 1e-3
"""A part whose volume with caps is below this share of its area to the power of 3/2 is a sheet, and no cap helps."""

WIDE_HOLE = 0.1
"""A hole wider than this share of the longest extent must be flat to be closed, and gives a warning."""

BENT_HOLE = 0.2
"""Largest distance of a wide hole's edge from its plane, as a share of its width."""


def closed_surface(
    vertices: FloatArray, faces: IntArray, name: str, unit_length: float = 1.0, repair: bool = True
) -> MeshInRepair:
    """Check a mesh and repair it to a closed surface, wound outward, whose winding number is 0 or 1.

    Args:
        vertices: Finite corners [unit of the source, as the surface that is returned], shape (V, 3).
        faces: Valid indices, shape (F, 3), F > 0.
        name: Name of the mesh in messages.
        unit_length: Length of the unit [m].
        repair: False refuses a mesh that needs more than merging vertices at equal places.

    Raises:
        MeshError: No safe repair gives the mesh an inside; or it needs a repair and `repair` is False.
    """
    surface = MeshInRepair(vertices, faces, name, unit_length)
    merge_and_clean(surface)
    _drop_fragments(surface)
    _wind_alike(surface)
    _close_holes(surface)
    _require_closed(surface)
    turn_outward(surface)
    resolve_overlaps(surface)
    surface.vertices, surface.faces = used_vertices(surface.vertices, surface.faces)
    if surface.repairs and not repair:
        raise MeshError(f"{name}: needs repair, which is switched off: {'; '.join(surface.repairs)}")
    return surface


def merge_and_clean(surface: MeshInRepair) -> None:
    """Merge vertices at the same place, drop degenerate and repeated triangles; MeshError if none is left."""
    before = len(surface.vertices)
    surface.vertices, surface.faces = merged_vertices(surface.vertices, surface.faces)
    if len(surface.vertices) < before:
        surface.merged.append(
            f"merged {counted(before, 'vertex')} into {len(surface.vertices)}: equal places, or used by no triangle"
        )
    _drop_useless_faces(surface)
    _merge_near_vertices(surface)


def _drop_useless_faces(surface: MeshInRepair) -> None:
    faces = surface.faces
    a, b, c = faces.T
    degenerate = (a == b) | (b == c) | (c == a)
    if degenerate.any():
        surface.repairs.append(f"removed {counted(int(degenerate.sum()), 'degenerate triangle')}")
        faces = faces[~degenerate]
    keep = _once(faces)
    if not keep.all():
        surface.repairs.append(f"removed {counted(int((~keep).sum()), 'duplicate triangle')}")
        faces = faces[keep]
    if len(faces) == 0:
        raise surface.error("no volume: its triangles are degenerate or cancel each other")
    surface.faces = faces


def _once(faces: IntArray) -> BoolArray:
    """Mark the faces to keep so that none occurs twice, shape (F,).

    A face and its reverse cancel, unless most faces have their reverse: such a file holds both sides of one surface,
        and one of each is kept.
    """
    first = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    sign = np.where(turned[:, 1] < turned[:, 2], 1, -1)
    group = distinct_rows(np.sort(faces, axis=1))[1]
    count = np.bincount(group)
    net = np.bincount(group, weights=sign)
    both_sides = np.abs(net) < count
    if 2 * np.count_nonzero(both_sides) > len(count):
        wanted = np.ones(len(faces), dtype=bool)
    else:
        wanted = np.sign(net[group]) == sign
    keep = np.zeros(len(faces), dtype=bool)
    candidates = np.flatnonzero(wanted)
    keep[candidates[np.unique(group[wanted], return_index=True)[1]]] = True
    return keep


def _open_edges(faces: IntArray) -> int:
    return int(np.count_nonzero(undirected_edges(faces)[1] == 1))


def _merge_near_vertices(surface: MeshInRepair) -> None:
    before = _open_edges(surface.faces)
    if before == 0:
        return
    distance = NEAR_VERTEX * surface.size
    vertices, faces = merged_vertices(surface.vertices, surface.faces, distance)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) and _open_edges(faces) < before:
        merged = len(surface.vertices) - len(vertices)
        surface.repairs.append(
            f"merged {counted(merged, 'vertex')} closer than {surface.millimetres(distance)} to another"
        )
        surface.vertices, surface.faces = vertices, faces
        _drop_useless_faces(surface)


def _drop_fragments(surface: MeshInRepair) -> None:
    label = part_labels(surface.faces)
    if label.max() == 0:
        return
    area = face_areas(surface.vertices, surface.faces)
    part_area = np.bincount(label, weights=area)
    index, count, _ = undirected_edges(surface.faces)
    # Open: the part has an edge that is not shared by two faces.
    loose = np.zeros(len(part_area), dtype=bool)
    loose[label[np.flatnonzero(count[index] != 2) // 3]] = True
    loose[np.argmax(part_area)] = False
    small = loose & (part_area <= FRAGMENT_AREA * area.sum())
    share = float(part_area[small].sum() / area.sum()) if area.sum() > 0.0 else 0.0
    if not small.any() or share > FRAGMENT_AREA:
        return
    surface.faces = surface.faces[~small[label]]
    surface.repairs.append(
        f"dropped {counted(int(small.sum()), 'loose open fragment')}, {100.0 * share:.2g} % of the surface"
    )


def _wind_alike(surface: MeshInRepair) -> None:
    result = alike_wound(surface.faces)
    if result is None:
        raise surface.error("one-sided like a Möbius strip, so it has no inside")
    surface.faces, turned = result
    if turned:
        surface.repairs.append(f"turned {counted(turned, 'triangle')} wound against the neighbours")


def _close_holes(surface: MeshInRepair) -> None:
    caps = hole_caps(surface.vertices, surface.faces)
    holes = len(caps.width)
    if holes == 0:
        return
    wide = caps.width > WIDE_HOLE * surface.size
    bent = np.flatnonzero(wide & (caps.bend > BENT_HOLE * caps.width))
    if len(bent):
        width, bend = surface.millimetres(caps.width[bent[0]]), surface.millimetres(caps.bend[bent[0]])
        bent_hole = f"a hole {width} wide is bent by {bend}, too much to close safely"
        raise surface.error(f"open: {bent_hole}; close it in a mesh editor")
    widest = surface.millimetres(float(caps.width.max()))
    faces = np.concatenate([surface.faces, caps.faces])
    label = part_labels(faces)
    area = face_areas(caps.vertices, faces)
    is_cap = np.arange(len(faces)) >= len(surface.faces)
    share = float(area[is_cap].sum() / area[~is_cap].sum())
    sheets = 0
    for part in np.unique(label[is_cap]):
        inside = abs(signed_volume(caps.vertices, faces[label == part]))
        sheets += inside < SHEET_VOLUME * float(area[label == part].sum()) ** 1.5
    if share > CAP_AREA or sheets:
        caps_area = f"whose caps would have {100.0 * share:.0f} % of its area; give it a thickness"
        raise surface.error(f"an open surface: {counted(holes, 'hole')} up to {widest} wide, {caps_area}")
    surface.repairs.append(f"closed {counted(holes, 'hole')} up to {widest} wide")
    if wide.any():
        small = holes - int(wide.sum())
        surface.warnings.append(
            f"{counted(int(wide.sum()), 'hole')} up to {widest} wide closed{f', and {small} small' if small else ''}: "
            "it is solid there; if it should be hollow, give the wall a thickness"
        )
    surface.vertices, surface.faces = caps.vertices, faces


def _require_closed(surface: MeshInRepair) -> None:
    _, count, balance = undirected_edges(surface.faces)
    if not np.any(balance):
        return
    fanned = int(np.count_nonzero(count > 2))
    open_edges = int(np.count_nonzero(count == 1))
    faults = [f"{counted(fanned, 'edge')} shared by more than two triangles"] if fanned else []
    what = " and ".join(faults + ([counted(open_edges, "open edge")] if open_edges else []))
    raise surface.error(f"not watertight: {what or 'neighbours wound against each other'}; no safe repair")
