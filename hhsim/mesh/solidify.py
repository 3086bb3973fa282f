"""A solid for a mesh that encloses none cleanly: the inside by generalized winding number.

The triangles are wound alike, and outward as far as possible; the inside is where their winding number exceeds 1/2. The
distance of its closed mesh from the triangles is measured and reported.
"""

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, mesh_signed_distance
from hhsim.mesh import topology
from hhsim.mesh.isosurface import border_distances, simplified, solid_mesh
from hhsim.mesh.repair import (
    BESIDE,
    CAP_AREA,
    Border,
    MeshInRepair,
    closed_surface,
    lie_within,
    merge_and_clean,
    percent,
    windings_beside,
)
from hhsim.reproducible import dot
from hhsim.system.counted import counted

TOLERANCE = 5e-4
"""Wanted distance of the new mesh from the triangles of the file, as a share of the longest extent."""

SAMPLES = 60_000
"""Number of points that measure a surface."""

LOOSE = 0.25
"""Mean winding number of its sides below which a triangle encloses nothing."""

LOST_AREA = 0.05
"""Triangles that enclose nothing are dropped up to this share of the surface."""

FARTHEST = 0.02
"""Largest accepted distance of a new mesh from its source, as a share of the longest extent."""

_LEAST_REPORTED = 1e-5

ASSUMED_SOLID = "the guarantee is of the assumed solid"
"""Start of the sentence that says how much of the file's surface lies outside of its solid."""

THICKEN = "give it a thickness in a mesh editor"

SEED = 20180
FLAT = 1e-3
"""A part is flat whose volume about its middle is a smaller share of its area to the power of 3/2."""


def solid_surface(vertices: FloatArray, faces: IntArray, name: str, unit_length: float = 1.0) -> MeshInRepair:
    """Close the surface of a mesh: by a safe repair, else by winding number; repairs state assumptions.

    Arguments as for `hhsim.mesh.repair.closed_surface`. Raises MeshError where the mesh has no inside.
    """
    try:
        surface = closed_surface(vertices, faces, name, unit_length)
    except MeshError as error:
        # About the origin, so that a far place costs no digits.
        corner = vertices[faces].reshape(-1, 3)
        origin = 0.5 * (corner.min(axis=0) + corner.max(axis=0))
        surface = MeshInRepair(vertices - origin, faces, name, unit_length)
        merge_and_clean(surface)
        if not topology.face_areas(surface.vertices, surface.faces).sum() > 1e-12 * surface.size**2:
            raise MeshError(f"{name}: no volume: its triangles have no area; expected a surface mesh") from None
        _fill_winding(surface, str(error).removeprefix(f"{name}: ").partition(";")[0])
        surface.vertices = surface.vertices + origin
        return surface
    tell_assumed(surface, vertices, faces)
    return surface


def tell_assumed(surface: MeshInRepair, vertices: FloatArray, faces: IntArray) -> None:
    """Add to the repairs of a closed surface how much of it is far from the triangles that it was made of."""
    if surface.repairs:
        source = np.ascontiguousarray(vertices[faces])
        share, distance = _assumed(surface, source, TOLERANCE * surface.size)
        _tell_assumed(surface, source, share, distance)


def _fill_winding(surface: MeshInRepair, refusal: str) -> None:
    """Replace a surface by that of its inside by winding number; `refusal` says why no safe repair closes it."""
    source = np.ascontiguousarray(surface.vertices[surface.faces])
    size = surface.size
    surface.repairs.insert(0, f"{refusal}: its inside is taken to be where the winding number exceeds 1/2")
    surface.warnings.append("no safe repair gives it an inside: it is assumed by winding number")
    surface.faces, turned = turned_outward(surface.vertices, surface.faces)
    if turned:
        surface.repairs.append(f"turned {counted(turned, 'triangle')} to face outward")
    bvh, border = _by_winding(surface)
    loose = border.turns < LOOSE
    lost = border.share(loose)
    if lost > LOST_AREA:
        raise surface.error(
            f"{refusal}; and {percent(lost)} of its surface encloses nothing by winding number; {THICKEN}"
        )
    if lost > 0.0:
        surface.repairs.append(f"left out {100.0 * lost:.2g} % of the surface, which encloses nothing")
        kept = np.bincount(border.face[~loose], minlength=len(surface.faces)) > 0
        surface.faces = surface.faces[kept]
        bvh, border = _by_winding(surface)
    hidden = border.share(border.turns > 1.0 - LOOSE)
    if hidden > _LEAST_REPORTED:
        surface.repairs.append(f"left out {100.0 * hidden:.2g} % of the surface, which lies inside")
    # Between inside and outside, without films beside loose triangles.
    parts = ((border.front > 0.5) != (border.back > 0.5)) & (np.abs(border.turns - 0.5) <= 0.5 - LOOSE)
    if not parts.any():
        raise surface.error(f"{refusal}; and it has no inside by winding number; {THICKEN}")
    parting, tolerance = border.point[parts], TOLERANCE * size
    corner = surface.vertices[surface.faces].reshape(-1, 3)
    vertices, faces = solid_mesh(bvh, parting, corner.min(axis=0), corner.max(axis=0), tolerance)
    if len(faces) == 0:
        raise surface.error(f"no volume: it encloses nothing as large as {surface.millimetres(tolerance)}")
    vertices, faces = simplified(vertices, faces, parting, tolerance)
    out, buried = border_distances(vertices, faces, parting)
    # Without the triangles that were left out it may be smaller than `size`.
    if out > FARTHEST * surface.size:
        raise surface.error(f"too thin in places: {surface.millimetres(out)} outside of the finest mesh; {THICKEN}")
    surface.vertices, surface.faces = topology.in_fixed_order(*topology.used_vertices(vertices, faces))
    surface.repairs.append(
        f"meshed anew: what parts inside from outside is at most {surface.millimetres(out)} outside of the mesh "
        f"and {surface.millimetres(buried)} inside it"
    )
    share, reach = _assumed(surface, source, max(tolerance, out))
    if share > CAP_AREA / (1.0 + CAP_AREA):
        raise surface.error(f"{refusal}; and {100.0 * share:.0f} % of its surface would have to be assumed; {THICKEN}")
    _tell_assumed(surface, source, share, reach)


def _tell_assumed(surface: MeshInRepair, source: FloatArray, share: float, distance: float) -> None:
    """Report the share of the surface that is assumed, and what of the file's surface lies outside of it."""
    if share > _LEAST_REPORTED:
        assumed = f"{100.0 * share:.2g} % of the surface is assumed"
        surface.repairs.append(f"{assumed}, up to {surface.millimetres(distance)} from any triangle")
    corners = np.arange(3 * len(source)).reshape(-1, 3)
    point, _, area = topology.face_samples(source.reshape(-1, 3), corners, SAMPLES, np.random.default_rng(SEED))
    outside = mesh_signed_distance(build_mesh_bvh(surface.vertices, surface.faces), point)
    # Points nearer to it are on it.
    out = outside > BESIDE * surface.size
    bare, farthest = area[out].sum() / area.sum(), outside.max()
    if bare > _LEAST_REPORTED:
        surface.repairs.append(
            f"{ASSUMED_SOLID}: {100.0 * bare:.2g} % of the surface, up to {surface.millimetres(farthest)}, "
            "lies outside it"
        )


def turned_outward(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """Wind neighbours alike, and each part so that the volume about its own middle is positive; also count the turned.

    A part that lies within the others keeps its winding: it may be a cavity or a solid within a solid, and only the
    author of the file knows. So does one that is flat.
    """
    result = topology.alike_wound(faces)[0].copy()
    label = topology.part_labels(result)
    corner = vertices[result]
    count = np.bincount(label)
    middle = np.stack([np.bincount(label, weights=each) / count for each in corner.mean(axis=1).T], axis=1)
    a, b, c = (corner - middle[label][:, None]).transpose(1, 0, 2)
    volume = np.bincount(label, weights=dot(a, np.cross(b, c)))
    area = np.bincount(label, weights=topology.face_areas(vertices, result))
    inward = volume < -FLAT * area * np.sqrt(area)
    for part in np.flatnonzero(inward):
        inward[part] = not lie_within(vertices, result[label == part], result[label != part])
    result[inward[label]] = result[inward[label]][:, ::-1]
    return result, int(np.count_nonzero((result != faces).any(axis=1)))


def _by_winding(surface: MeshInRepair) -> tuple[MeshBvh, Border]:
    bvh = build_mesh_bvh(surface.vertices, surface.faces, signed=False, by_winding=True)
    return bvh, windings_beside(bvh, surface.vertices, surface.faces, SAMPLES, SEED)


def _assumed(surface: MeshInRepair, source: FloatArray, tolerance: float) -> tuple[float, float]:
    """Share of a surface farther than a tolerance from the triangles of the file, (F, 3, 3), and that distance."""
    bvh = build_mesh_bvh(source.reshape(-1, 3), np.arange(3 * len(source)).reshape(-1, 3), signed=False)
    point, _, area = topology.face_samples(surface.vertices, surface.faces, SAMPLES, np.random.default_rng(SEED))
    distance = np.abs(mesh_signed_distance(bvh, point))
    far = distance > 2.0 * tolerance
    return float(area[far].sum() / area.sum()), float(distance.max())
