"""A solid for a mesh that encloses none cleanly: the inside by generalized winding number, or sheets with a thickness.

The triangles are wound alike, and outward as far as possible; the inside is where their winding number exceeds 1/2. The
distance of its closed mesh from the triangles is measured and reported.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance
from hhsim.kernels.mesh.inside_field import SolidField, count_hits
from hhsim.kernels.mesh.winding_number import fast_winding_numbers, winding_moments
from hhsim.mesh import topology
from hhsim.mesh.isosurface import border_distances, is_inside, simplified, solid_mesh
from hhsim.mesh.repair import BESIDE, CAP_AREA, MeshInRepair, closed_surface, merge_and_clean, percent
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

THICKNESS = (2e-3, 0.5)
"""Least and greatest thickness of a sheet, as shares of the longest extent."""

SLABS = 3000
"""Sheets of no more triangles are made of slabs."""

_LEAST_REPORTED = 1e-5

ASSUMED_SOLID = "the guarantee is of the assumed solid"
"""Start of the sentence that says how much of the file's surface lies outside of its solid."""

THICKEN = "pass --thickness to make a sheet of it"

SEED = 20180
ROUND = 8
"""Directions around a rim; the sphere about a corner is the hull of three such rings and two poles."""
RAYS = 60_000
"""Total number of rays, shared out by area."""
LEAST_RAYS = 12
"""Least number of rays from each part."""
CLEAR = 0.1
"""A part is turned where its back sees more by this share of its rays: a few reach a cavity through a hole."""
RAY_SEED = 20131


def solid_surface(
    vertices: FloatArray, faces: IntArray, name: str, unit_length: float = 1.0, thickness: float | None = None
) -> MeshInRepair:
    """Close the surface of a mesh: by a safe repair, else by winding number, or as sheets; repairs state assumptions.

    Arguments as for `hhsim.mesh.repair.closed_surface`; `thickness` [unit of the source] makes sheets of open parts.
    Raises MeshError where the mesh has no inside, or the thickness is out of range.
    """
    if thickness is None:
        return _solid(vertices, faces, name, unit_length)
    surface, origin = _cleaned(vertices, faces, name, unit_length)
    is_open = open_faces(surface.faces)
    if not is_open.any():
        try:
            result = _solid(vertices, faces, name, unit_length)
            result.warnings.append("the thickness is not used: the mesh is closed")
            return result
        except MeshError:
            is_open[:] = True
    _make_sheets(surface, is_open, thickness)
    surface.vertices = surface.vertices + origin
    return surface


def _solid(vertices: FloatArray, faces: IntArray, name: str, unit_length: float) -> MeshInRepair:
    try:
        surface = closed_surface(vertices, faces, name, unit_length)
    except MeshError as error:
        surface, origin = _cleaned(vertices, faces, name, unit_length)
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


def open_faces(faces: IntArray) -> BoolArray:
    """Mark the faces of open parts, shape (F,): without them no edge has a single face."""
    result = np.zeros(len(faces), dtype=bool)
    while not result.all():
        rest = np.flatnonzero(~result)
        label = topology.part_labels(faces[rest])
        index, count, _ = topology.undirected_edges(faces[rest])
        open_parts = label[np.flatnonzero(count[index] == 1) // 3]
        if len(open_parts) == 0:
            break
        result[rest[np.isin(label, open_parts)]] = True
    return result


class _Border(NamedTuple):
    """Points (n, 3) on triangles (n,), the area of each, and the solid beside them.

    `front` and `back` mark points with the solid in front of the triangle and behind it; `turns` is the mean winding
    number of both sides: 1/2 between inside and outside, 0 where nothing is enclosed.
    """

    point: FloatArray
    face: IntArray
    area: FloatArray
    front: BoolArray
    back: BoolArray
    turns: FloatArray

    @property
    def parting(self) -> FloatArray:
        """Points between inside and outside, shape (m, 3), without films beside loose triangles."""
        parts = (self.front != self.back) & (np.abs(self.turns - 0.5) <= 0.5 - LOOSE)
        return np.asarray(self.point[parts])

    @property
    def loose(self) -> BoolArray:
        return np.asarray(self.turns < LOOSE)

    def share(self, chosen: BoolArray) -> float:
        return float(self.area[chosen].sum() / self.area.sum())


def _fill_winding(surface: MeshInRepair, refusal: str) -> None:
    """Replace a surface by that of its inside by winding number; `refusal` says why no safe repair closes it."""
    source = np.ascontiguousarray(surface.vertices[surface.faces])
    size = surface.size
    surface.repairs.insert(0, f"{refusal}: its inside is taken to be where the winding number exceeds 1/2")
    surface.warnings.append("no safe repair gives it an inside: it is assumed by winding number")
    surface.faces, turned = turned_outward(surface.vertices, surface.faces, BESIDE * size)
    if turned:
        surface.repairs.append(f"turned {counted(turned, 'triangle')} to face outward")
    field = _field(surface.vertices, surface.faces)
    border = _border(surface, field)
    lost = border.share(border.loose)
    if lost > LOST_AREA:
        raise surface.error(
            f"{refusal}; and {percent(lost)} of its surface encloses nothing by winding number; {THICKEN}"
        )
    if lost > 0.0:
        surface.repairs.append(f"left out {100.0 * lost:.2g} % of the surface, which encloses nothing")
        kept = np.bincount(border.face[~border.loose], minlength=len(surface.faces)) > 0
        surface.faces = surface.faces[kept]
        field = _field(surface.vertices, surface.faces)
        border = _border(surface, field)
    hidden = border.share(border.turns > 1.0 - LOOSE)
    if hidden > _LEAST_REPORTED:
        surface.repairs.append(f"left out {100.0 * hidden:.2g} % of the surface, which lies inside")
    if not len(border.parting):
        raise surface.error(f"{refusal}; and it has no inside by winding number; {THICKEN}")
    out, buried = _mesh_anew(surface, field, border.parting, TOLERANCE * size)
    surface.repairs.append(_distances(surface, "what parts inside from outside", out, buried))
    share, reach = _assumed(surface, source, max(TOLERANCE * size, out))
    if share > CAP_AREA / (1.0 + CAP_AREA):
        raise surface.error(f"{refusal}; and {100.0 * share:.0f} % of its surface would have to be assumed; {THICKEN}")
    _tell_assumed(surface, source, share, reach)


def _tell_assumed(surface: MeshInRepair, source: FloatArray, share: float, distance: float) -> None:
    """Report the share of the surface that is assumed, and what of the file's surface lies outside of it."""
    if share > _LEAST_REPORTED:
        assumed = f"{100.0 * share:.2g} % of the surface is assumed"
        surface.repairs.append(f"{assumed}, up to {surface.millimetres(distance)} from any triangle")
    bare, farthest = outside_solid(surface, source)
    if bare > _LEAST_REPORTED:
        surface.repairs.append(
            f"{ASSUMED_SOLID}: {100.0 * bare:.2g} % of the surface, up to {surface.millimetres(farthest)}, "
            "lies outside it"
        )


def outside_solid(surface: MeshInRepair, source: FloatArray) -> tuple[float, float]:
    """Sampled share of the triangles of the file (F, 3, 3) outside of a closed surface, and its largest distance.

    Points nearer to it than `BESIDE` of its size are on it.
    """
    bvh = build_mesh_bvh(surface.vertices, surface.faces)
    corners = np.arange(3 * len(source)).reshape(-1, 3)
    point, _, area = topology.face_samples(source.reshape(-1, 3), corners, SAMPLES, np.random.default_rng(SEED))
    distance = mesh_signed_distance(bvh, point)
    out = distance > BESIDE * surface.size
    return float(area[out].sum() / area.sum()), float(np.max(distance, where=out, initial=0.0))


def _make_sheets(surface: MeshInRepair, sheet: BoolArray, thickness: float) -> None:
    """Replace a surface by all within half the thickness of the faces `sheet`, and what the others enclose."""
    size = surface.size
    least, most = (share * size for share in THICKNESS)
    if not least <= thickness <= most:
        given, low, high, longest = (surface.millimetres(length) for length in (thickness, least, most, size))
        raise surface.error(f"a sheet {given} thick; expected {low} to {high} for a mesh {longest} long")
    parts = int(topology.part_labels(surface.faces[sheet]).max()) + 1
    surface.repairs.append(
        f"made {counted(parts, 'open part')} a sheet {surface.millimetres(thickness)} thick"
        + ("" if sheet.all() else "; what the closed parts enclose is solid")
    )
    surface.faces, _ = turned_outward(surface.vertices, surface.faces, BESIDE * size)
    half = 0.5 * thickness
    field = _field(surface.vertices, surface.faces[~sheet])._replace(
        sheet=build_mesh_bvh(surface.vertices, surface.faces[sheet], signed=False), half=half
    )
    border = _border(surface, field)
    thick = sheet[border.face]
    normal = face_normals(surface.vertices, surface.faces)[border.face[thick]]
    # To both sides; and to any, which finds the rims.
    ways = np.concatenate([normal, -normal, np.random.default_rng(SEED).normal(size=normal.shape)])
    ways *= half / np.linalg.norm(ways, axis=1)[:, None]
    middle = np.tile(border.point[thick], (3, 1))
    places = np.concatenate([(middle + ways)[~is_inside(field, middle + 1.0001 * ways)], border.parting])
    tolerance = min(TOLERANCE * size, 0.05 * thickness)
    slabs = None
    if sheet.sum() <= SLABS:
        slabs = slab_union(surface.vertices, surface.faces[sheet], half, surface.faces[~sheet], 0.2 * tolerance)
    if slabs is not None and topology.is_closed(slabs[1]):
        surface.vertices, surface.faces = topology.in_fixed_order(*topology.used_vertices(*slabs))
        out, buried = border_distances(surface.vertices, surface.faces, places)
    else:
        out, buried = _mesh_anew(surface, field, places, tolerance)
    surface.repairs.append(_distances(surface, "the sheet", out, buried))


def turned_outward(vertices: FloatArray, faces: IntArray, start: float) -> tuple[IntArray, int]:
    """Wind neighbours alike, and each part so that its front sees more of the far away; also return the number turned.

    After Takayama, Jacobson, Kavan and Sorkine-Hornung, "A simple method for correcting facet orientations in polygon
    meshes based on ray-casting" (2014): rays from both sides of each part; those that meet nothing count. A part that
    sees hardly anything from either side keeps its winding: it may be a cavity or a solid within a solid, and only the
    author of the file knows. Rays begin at a distance `start` from the triangle [unit of the vertices]; the faces are
    wound in any way, shape (F, 3).
    """
    result = topology.alike_wound(faces)[0].copy()
    label = topology.part_labels(result)
    parts = int(label.max()) + 1
    area = topology.face_areas(vertices, result)
    a, b, c = vertices[result].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(2.0 * area, np.finfo(np.float64).tiny)[:, None]
    part_area = np.bincount(label, weights=area, minlength=parts)
    number = np.maximum(LEAST_RAYS, np.ceil(RAYS * part_area / max(part_area.sum(), np.finfo(np.float64).tiny)))
    rng = np.random.default_rng(RAY_SEED)
    # Random faces, by area within each part.
    order = np.argsort(label, kind="stable")
    reached = np.cumsum(area[order])
    end = reached[np.searchsorted(label[order], np.arange(parts), side="right") - 1]
    begin = np.concatenate([[0.0], end[:-1]])
    part = np.repeat(np.arange(parts), number.astype(np.int64))
    at = np.searchsorted(reached, begin[part] + rng.random(len(part)) * (end - begin)[part], side="right")
    face = order[np.clip(at, 0, len(order) - 1)]
    place = topology.random_points(vertices[result[face]], rng)
    direction = rng.normal(size=(len(face), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    up = normal[face]
    # The same ray from both sides, mirrored.
    direction *= np.sign(np.einsum("ij,ij->i", direction, up))[:, None]
    reach = 4.0 * float(np.ptp(vertices, axis=0).max())
    bvh = build_mesh_bvh(vertices, faces, signed=False)
    score = np.zeros(parts)
    for side in (1.0, -1.0):
        along = side * reach * direction
        hits = np.empty(len(face), np.int64)
        count_hits(bvh, np.ascontiguousarray(place + side * start * up), np.ascontiguousarray(along), hits)
        score += side * np.bincount(label[face], weights=hits == 0, minlength=parts)
    inward = (score < -CLEAR * number)[label]
    result[inward] = result[inward][:, ::-1]
    return result, int(np.count_nonzero((result != faces).any(axis=1)))


def slab_union(
    vertices: FloatArray, faces: IntArray, half: float, closed: IntArray, tolerance: float
) -> tuple[FloatArray, IntArray] | None:
    """Compute the surface of all within a distance of faces, joined with closed parts; None if these are no manifold.

    Along the faces (F, 3) of the sheets the distance, `half`, is exact; around rims and creases it is up to 15 % less,
    where hulls replace spheres. The `closed` parts (G, 3), G may be 0, are wound outward; the result is simplified to a
    tolerance.
    """
    from manifold3d import Error, Manifold, Mesh64, OpType

    normal = face_normals(vertices, faces)
    parts = []
    if len(closed):
        solid = Manifold(Mesh64(vertices, closed.astype(np.uint64)))
        if solid.status() != Error.NoError:
            return None
        parts.append(solid)
    angle = 2.0 * np.pi * np.arange(ROUND) / ROUND
    for corner, up in zip(vertices[faces], normal):
        longest = max((corner[(k + 1) % 3] - corner[k] for k in range(3)), key=lambda edge: float(edge @ edge))
        if not float(up @ up) > 0.5:
            continue
        x = longest / np.linalg.norm(longest)
        ring = np.outer(np.cos(angle), x) + np.outer(np.sin(angle), np.cross(up, x))
        tilted = [np.cos(tilt) * ring + np.sin(tilt) * up for tilt in (-np.pi / 4.0, 0.0, np.pi / 4.0)]
        sphere = half * np.concatenate([*tilted, up[None], -up[None]])
        parts.append(Manifold.hull_points((corner[:, None] + sphere).reshape(-1, 3)))
    whole = Manifold.batch_boolean(parts, OpType.Add)
    if whole.status() != Error.NoError:
        return None
    result = whole.simplify(tolerance).to_mesh64()
    points = np.ascontiguousarray(np.asarray(result.vert_properties, dtype=np.float64)[:, :3])
    triangles = np.asarray(result.tri_verts).astype(np.int64)
    return (points, triangles) if len(triangles) else None


def _cleaned(vertices: FloatArray, faces: IntArray, name: str, unit_length: float) -> tuple[MeshInRepair, FloatArray]:
    """Mesh about the origin, so that a far place costs no digits, and its original middle."""
    corner = vertices[faces].reshape(-1, 3)
    origin = 0.5 * (corner.min(axis=0) + corner.max(axis=0))
    surface = MeshInRepair(vertices - origin, faces, name, unit_length)
    merge_and_clean(surface)
    if not topology.face_areas(surface.vertices, surface.faces).sum() > 1e-12 * surface.size**2:
        raise MeshError(f"{name}: no volume: its triangles have no area; expected a surface mesh")
    return surface, origin


def _field(vertices: FloatArray, faces: IntArray) -> SolidField:
    nowhere = build_mesh_bvh(np.zeros((1, 3)), np.zeros((1, 3), np.int64), signed=False)
    bvh = build_mesh_bvh(vertices, faces, signed=False) if len(faces) else nowhere
    return SolidField(bvh, winding_moments(bvh), nowhere, -1.0)


def _border(surface: MeshInRepair, field: SolidField) -> _Border:
    point, face, area = topology.face_samples(surface.vertices, surface.faces, SAMPLES, np.random.default_rng(SEED))
    beside = BESIDE * surface.size * face_normals(surface.vertices, surface.faces)[face]
    turns = [np.empty(len(point)), np.empty(len(point))]
    sides = [point + beside, point - beside]
    for side, out in zip(sides, turns):
        fast_winding_numbers(field.bvh, field.moments, side, out)
    within = [is_inside(field, side) if field.half > 0.0 else out > 0.5 for side, out in zip(sides, turns)]
    return _Border(point, face, area, within[0], within[1], 0.5 * (turns[0] + turns[1]))


def _mesh_anew(surface: MeshInRepair, field: SolidField, border: FloatArray, tolerance: float) -> tuple[float, float]:
    """Replace a surface by the mesh of the field; return the border's largest distance outside of it, and inside."""
    size = surface.size
    grown = max(field.half, 0.0)
    corner = surface.vertices[surface.faces].reshape(-1, 3)
    vertices, faces = solid_mesh(field, border, corner.min(axis=0) - grown, corner.max(axis=0) + grown, tolerance)
    if len(faces) == 0:
        raise surface.error(f"no volume: it encloses nothing as large as {surface.millimetres(tolerance)}")
    vertices, faces = simplified(vertices, faces, border, tolerance)
    out, buried = border_distances(vertices, faces, border)
    if out > FARTHEST * size:
        advice = "pass more --thickness" if grown else THICKEN
        raise surface.error(f"too thin in places: {surface.millimetres(out)} outside of the finest mesh; {advice}")
    surface.vertices, surface.faces = topology.in_fixed_order(*topology.used_vertices(vertices, faces))
    return out, buried


def _distances(surface: MeshInRepair, what: str, out: float, buried: float) -> str:
    return (
        f"meshed anew: {what} is at most {surface.millimetres(out)} outside of the mesh "
        f"and {surface.millimetres(buried)} inside it"
    )


def _assumed(surface: MeshInRepair, source: FloatArray, tolerance: float) -> tuple[float, float]:
    """Share of a surface farther than a tolerance from the triangles of the file, (F, 3, 3), and that distance."""
    bvh = build_mesh_bvh(source.reshape(-1, 3), np.arange(3 * len(source)).reshape(-1, 3), signed=False)
    point, _, area = topology.face_samples(surface.vertices, surface.faces, SAMPLES, np.random.default_rng(SEED))
    distance = np.abs(mesh_signed_distance(bvh, point))
    far = distance > 2.0 * tolerance
    return float(area[far].sum() / area.sum()), float(distance.max())
