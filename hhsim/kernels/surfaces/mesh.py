"""Contacts with the triangles of the object's mesh: faces, edges and vertices, in closed form.

A row is kept where a feature's witness is a local minimum of the distance, in its normal cone: a row of a neighbour
would allow half of the way to it only, and lift a finger that slides over a fine mesh. The distances of all features
count, and the true distances after the step decide. A phalanx that lies flat has a row at each end.
"""

import math

import numpy as np

from hhsim.kernels.contact.linearise import move_contact
from hhsim.kernels.contact.lists import CAPACITY, FOUND_CAPACITY, Probe, list_fields, put_in_order
from hhsim.kernels.contact.surface import (
    COUNT_NODE_TESTS,
    ContactPoints,
    Surface,
    Walk,
    at_distance,
    cone_contacts,
    cone_distance,
    holds,
    list_pieces,
    measure_pieces,
    record_pieces,
    write_contact,
)
from hhsim.kernels.jit import Array, Indices, Record, Triple, as_int64, jit, jit_inline
from hhsim.kernels.memory import prefetch
from hhsim.kernels.mesh.feature_distance import (
    ELSEWHERE,
    ON,
    above,
    edge_bound,
    edge_distances,
    face_bounds,
    face_distances,
    is_surrounded,
    line_witness,
    triangle_distance,
    vertex_bound,
    vertex_distances,
)
from hhsim.kernels.mesh.features import ALONG, EDGE_FIELDS, FACE_FIELDS, MeshFeatures
from hhsim.kernels.round_cone import RoundCone, sphere_cone
from hhsim.kernels.sphere_tree import TreeArrays, gather_pieces, nearest_piece, piece_distance, tree_of
from hhsim.kernels.triangle import Triangle, closest_on_triangle, triangle_at

FACES, EDGES, VERTICES = 0, 1, 2
"""Kinds of pieces."""
KINDS = 3
BATCH = 32
OWNED = 3 * BATCH
"""Faces that are listed together, and their edges, while memory for the next batch is fetched."""
FACE_BYTES, EDGE_BYTES, VERTEX_BYTES, OWN_BYTES = 8 * FACE_FIELDS, 8 * EDGE_FIELDS, 24, 24
WING_BYTES, SPOKE_BYTES = 48, 128
"""Sizes of a face, an edge, a vertex, what belongs to a face, two wings of an edge and the first spokes of a vertex."""
NEAR_CONE = 0.03
"""Sine of the angle by which a witness may lie outside of its feature's normal cone and still have a row, whose normal
is the cone's nearest: the row is of the face or edge that the witness leans to, if that reaches so far at the same
place of the axis. With its own normal it would hold back what slides towards an edge (docs/methods.md, "Distances")."""
FINDING, LISTING = 1, 2
"""Node tests that a face near a probe counts as, and one of its features that is listed."""
MOST_ACROSS = 64
"""Largest number of faces of one plane that are searched before a point is taken to be on one of them."""
FLAT = np.inf
"""Radius of curvature of a face [m]."""

CANDIDATES = np.dtype(
    [
        *list_fields(KINDS),
        ("face_plane", np.float64, (FACE_FIELDS, CAPACITY)),  # copies of the features, field by field
        ("edge_line", np.float64, (EDGE_FIELDS, CAPACITY)),
        ("vertex_point", np.float64, (3, CAPACITY)),
        ("edge_end", np.float64, (CAPACITY,)),  # signed distance of the nearer end of a phalanx over the edge [m]
    ],
    align=True,
)
"""Gathered features, by their indices in `MeshFeatures`, and their distances; parameters are in metres."""


@list_pieces.of(MeshFeatures)
@jit_inline
def _list(
    mesh: MeshFeatures,
    probe: Probe,
    most: int,
    most_found: int,
    reach: float,
    look_out: float,
    candidates: Record,
    walk: Walk,
) -> float:
    (number, cone, start), work = probe, walk.work
    found = walk.scratch[:FOUND_CAPACITY]
    batch_edges, batch_vertices = walk.scratch[FOUND_CAPACITY:], walk.scratch[FOUND_CAPACITY + OWNED :]
    count, slack, tests = gather_pieces(mesh.tree, cone, reach, look_out, walk.stack, found[:most_found])
    work[COUNT_NODE_TESTS] += tests + FINDING * max(count, 0)
    if count < 0:
        return -np.inf
    one_sided = mesh.pseudonormal.shape[0] > 0
    face_out, edge_out, vertex_out = candidates.piece[FACES], candidates.piece[EDGES], candidates.piece[VERTICES]
    near = candidates.distance
    face_near, edge_near, vertex_near = near[FACES], near[EDGES], near[VERTICES]
    face_edge, face_vertex = mesh.face_edge, mesh.face_vertex
    wing_start, spoke_start = mesh.wing_start, mesh.spoke_start
    tolerance = NEAR_CONE * (cone.radius + reach)
    faces, edges, vertices = start, start, start
    for first in range(0, count, BATCH):
        stop = min(first + BATCH, count)
        for i in range(stop, min(stop + BATCH, count)):
            prefetch(mesh.face, found[i], FACE_BYTES)
            prefetch(face_edge, found[i], OWN_BYTES)
            prefetch(face_vertex, found[i], OWN_BYTES)
        # Without branches, which could not be predicted.
        own_edges, own_vertices = 0, 0
        for i in range(first, stop):
            face = found[i]
            triangle, inside = face_bounds(mesh.face, face, cone, one_sided)
            if triangle > reach:
                slack = min(slack, triangle)
                continue
            if faces >= start + most:
                return -np.inf
            listed = inside <= reach
            face_out[faces], face_near[faces] = face, inside
            faces += 1 if listed else 0
            slack = min(slack, np.inf if listed else inside)
            for k in range(KINDS):
                edge, vertex = face_edge[face, k], face_vertex[face, k]
                batch_edges[own_edges] = edge
                own_edges += 1 if edge >= 0 else 0
                batch_vertices[own_vertices] = vertex
                own_vertices += 1 if vertex >= 0 else 0
        for i in range(own_edges):
            prefetch(mesh.edge, batch_edges[i], EDGE_BYTES)
            prefetch(mesh.wing, wing_start[batch_edges[i]], WING_BYTES)
        for i in range(own_vertices):
            prefetch(mesh.vertex, batch_vertices[i], VERTEX_BYTES)
            prefetch(mesh.spoke, spoke_start[batch_vertices[i]], SPOKE_BYTES)
        for i in range(own_edges):
            if edges >= start + most:
                return -np.inf
            edge = batch_edges[i]
            away = edge_bound(mesh, edge, cone, tolerance, reach)
            listed = away <= reach
            edge_out[edges], edge_near[edges] = edge, away
            edges += 1 if listed else 0
            slack = min(slack, np.inf if listed else away)
        for i in range(own_vertices):
            if vertices >= start + most:
                return -np.inf
            vertex = batch_vertices[i]
            away = vertex_bound(mesh, vertex, cone, tolerance)
            listed = away <= reach
            vertex_out[vertices], vertex_near[vertices] = vertex, away
            vertices += 1 if listed else 0
            slack = min(slack, np.inf if listed else away)
    put_in_order(number, as_int64(FACES), start, faces, candidates, found)
    _copy_fields(mesh.face, face_out, start, faces, candidates.face_plane[:].T)
    put_in_order(number, as_int64(EDGES), start, edges, candidates, found)
    _copy_fields(mesh.edge, edge_out, start, edges, candidates.edge_line[:].T)
    put_in_order(number, as_int64(VERTICES), start, vertices, candidates, found)
    _copy_fields(mesh.vertex, vertex_out, start, vertices, candidates.vertex_point[:].T)
    work[COUNT_NODE_TESTS] += LISTING * (faces + edges + vertices - 3 * start)
    return slack


@jit
def _copy_fields(features: Array, index: Indices, start: int, stop: int, fields_out: Array) -> None:
    for i in range(start, stop):
        for m in range(features.shape[1]):
            fields_out[i, m] = features[index[i], m]


@measure_pieces.of(MeshFeatures)
@jit_inline
def _measure(mesh: MeshFeatures, kind: int, cone: RoundCone, start: int, stop: int, candidates: Record) -> None:
    distance, parameter = candidates.distance[kind], candidates.parameter[kind]
    if kind == FACES:
        face_distances(candidates.face_plane[:].T, start, stop, cone, distance)
    elif kind == EDGES:
        edge_distances(candidates.edge_line[:].T, start, stop, cone, distance, parameter, candidates.edge_end[:])
    else:
        vertex_distances(candidates.vertex_point[:].T, start, stop, cone, distance, parameter)


@jit_inline
def _lean(mesh: MeshFeatures, f: int, dx: float, dy: float, dz: float) -> float:
    face = mesh.face
    return dx * face[f, 0] + dy * face[f, 1] + dz * face[f, 2]


@holds.of(MeshFeatures)
@jit_inline
def _holds(mesh: MeshFeatures, probe: Probe, candidates: Record) -> bool:
    # By the normals at the nearest feature.
    number, cone, start = probe
    measured, lean, least = candidates.measured[number], 1.0, ELSEWHERE
    distance, piece = candidates.distance, candidates.piece
    for i in range(start, start + measured[FACES]):
        if distance[FACES, i] < least:
            f, least = piece[FACES, i], distance[FACES, i]
            lean = _lean(mesh, f, cone.x, cone.y, cone.z) - mesh.face[f, 3]
    for i in range(start, start + measured[EDGES]):
        if distance[EDGES, i] < least:
            e, least = piece[EDGES, i], distance[EDGES, i]
            dx, dy, dz = cone.x - mesh.edge[e, 0], cone.y - mesh.edge[e, 1], cone.z - mesh.edge[e, 2]
            lean = 0.0
            for w in range(mesh.wing_start[e], mesh.wing_start[e + 1]):
                lean += _lean(mesh, mesh.wing_face[w], dx, dy, dz)
    for i in range(start, start + measured[VERTICES]):
        if distance[VERTICES, i] < least:
            v, least = piece[VERTICES, i], distance[VERTICES, i]
            dx, dy, dz = cone.x - mesh.vertex[v, 0], cone.y - mesh.vertex[v, 1], cone.z - mesh.vertex[v, 2]
            lean = 0.0
            for k in range(mesh.spoke_start[v], mesh.spoke_start[v + 1]):
                e = mesh.spoke_edge[k]
                for w in range(mesh.wing_start[e], mesh.wing_start[e + 1]):
                    lean += _lean(mesh, mesh.wing_face[w], dx, dy, dz)
    return lean < 0.0


@jit_inline
def _first_key(mesh: MeshFeatures, which: int) -> int:
    return 3 * (mesh.face.shape[0] + mesh.edge.shape[0] + mesh.vertex.shape[0]) * which


@jit_inline
def _face_rows(mesh: MeshFeatures, candidates: Record, probe: Probe, limit: float, row: int, contacts: Record) -> int:
    number, cone, start = probe
    ends = 2 if cone.length > 0.0 else 1
    face, index, distance = mesh.face, candidates.piece[FACES], candidates.distance[FACES]
    first_key = _first_key(mesh, number)
    for i in range(start, start + candidates.measured[number, FACES]):
        if distance[i] > limit:
            continue
        f = index[i]
        nx, ny, nz = face[f, 0], face[f, 1], face[f, 2]
        for end in range(ends):
            s = end * cone.length
            x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
            radius = cone.radius - end * cone.drop
            height = nx * x + ny * y + nz * z - face[f, 3]
            if abs(height) - radius > limit or not above(face, f, x, y, z):
                continue
            if row >= contacts.key.shape[0]:
                return -1
            side = 1.0 if height >= 0.0 else -1.0
            normal = (side * nx, side * ny, side * nz)
            point, radii = at_distance((x, y, z), normal, -radius), (radius, FLAT)
            write_contact(contacts, row, point, normal, abs(height) - radius, radii, first_key + 3 * f + end)
            row += 1
    return row


@jit_inline
def _into_cone(directions: Array, start: int, stop: int, nx: float, ny: float, nz: float) -> tuple[bool, int, Triple]:
    """Bring a unit vector just beyond a side of a normal cone into it; return success, that side or -1, the vector."""
    side, over = -1, 0.0
    for w in range(start, stop):
        lean = nx * directions[w, 0] + ny * directions[w, 1] + nz * directions[w, 2]
        if lean > NEAR_CONE or (lean > ALONG and side >= 0):
            return False, side, (nx, ny, nz)
        # A normal brought to the border by the last step stays there: rounding must not choose its curvature.
        if lean > ALONG:
            side, over = w, lean
    if side >= 0:
        nx, ny, nz = nx - over * directions[side, 0], ny - over * directions[side, 1], nz - over * directions[side, 2]
        scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = scale * nx, scale * ny, scale * nz
        for w in range(start, stop):
            if nx * directions[w, 0] + ny * directions[w, 1] + nz * directions[w, 2] > ALONG:
                return False, side, (nx, ny, nz)
    return True, side, (nx, ny, nz)


@jit_inline
def _goes_on(mesh: MeshFeatures, first: int, x: float, y: float, z: float) -> bool:
    """Return True if a point is above or below a face, or one of those that continue its plane."""
    face, f = mesh.face, first
    for _ in range(MOST_ACROSS):
        if above(face, f, x, y, z):
            return True
        across, most = as_int64(-1), 0.0
        for k in range(3):
            i = 4 + 4 * k
            out = face[f, i + 3] - face[f, i] * x - face[f, i + 1] * y - face[f, i + 2] * z
            if out > most and mesh.face_across[f, k] >= 0:
                across, most = mesh.face_across[f, k], out
        if across < 0:
            return False
        f = across
    return True


@jit_inline
def _edge_rows(mesh: MeshFeatures, candidates: Record, probe: Probe, limit: float, row: int, contacts: Record) -> int:
    number, cone, start = probe
    tries = 3 if cone.length > 0.0 else 1
    edge, index, distance = mesh.edge, candidates.piece[EDGES], candidates.distance[EDGES]
    parameter, end_distance = candidates.parameter[EDGES], candidates.edge_end
    slope = cone.drop * cone.inverse_length
    first_key = _first_key(mesh, number) + 3 * mesh.face.shape[0]
    for i in range(start, start + candidates.measured[number, EDGES]):
        # If the nearest point of the axis is beyond the edge, an end of the axis may still be over it.
        if distance[i] > limit and end_distance[i] > limit:
            continue
        e = index[i]
        wx, wy, wz = edge[e, 3], edge[e, 4], edge[e, 5]
        for which in range(tries):
            s = parameter[i]
            if which == 0 and distance[i] == ELSEWHERE:
                continue
            if which > 0:
                # The ends of a phalanx that lies along the edge.
                end = (which - 1) * cone.length
                if s == end:
                    continue
                s = end
            x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
            dx, dy, dz = x - edge[e, 0], y - edge[e, 1], z - edge[e, 2]
            foot = dx * wx + dy * wy + dz * wz
            if which > 0 and not -ON <= foot <= edge[e, 6] + ON:
                continue
            dx, dy, dz = dx - foot * wx, dy - foot * wy, dz - foot * wz
            size = math.sqrt(dx * dx + dy * dy + dz * dz)
            radius = cone.radius - slope * s
            if which > 0 and size - radius > limit:
                continue
            if size > 0.0:
                scale = 1.0 / size
                normal = (dx * scale, dy * scale, dz * scale)
            else:
                normal = _across(wx, wy, wz)
            inside, side, normal = _into_cone(mesh.wing, mesh.wing_start[e], mesh.wing_start[e + 1], *normal)
            if not inside:
                continue
            # Beyond the far side of a narrow face its plane is in the air, and would hold the body off the mesh.
            if side >= 0 and not _goes_on(mesh, mesh.wing_face[side], x, y, z):
                continue
            if row >= contacts.key.shape[0]:
                return -1
            away = size if side < 0 else dx * normal[0] + dy * normal[1] + dz * normal[2]
            key = first_key + 3 * e + which
            point, curvature = at_distance((x, y, z), normal, -radius), 0.0 if side < 0 else FLAT
            write_contact(contacts, row, point, normal, away - radius, (radius, curvature), key)
            if side < 0:
                contacts.straight[0, row] = wx
                contacts.straight[1, row] = wy
                contacts.straight[2, row] = wz
                contacts.slides[row] = 1 if which == 0 and 0.0 < s < cone.length else 0
            row += 1
    return row


@jit_inline
def _across(wx: float, wy: float, wz: float) -> Triple:
    """Return a unit vector across w: where an axis meets an edge every direction is as good."""
    if abs(wx) <= abs(wy):
        scale = 1.0 / math.sqrt(wy * wy + wz * wz)
        return (0.0, wz * scale, -wy * scale)
    scale = 1.0 / math.sqrt(wx * wx + wz * wz)
    return (-wz * scale, 0.0, wx * scale)


@jit_inline
def _is_of_edge(mesh: MeshFeatures, e: int, cone: RoundCone, x: float, y: float, z: float) -> bool:
    """Return True if an axis point is beside an edge, none between both ends nearer (which had a row of its own)."""
    edge = mesh.edge
    wx, wy, wz, extent = edge[e, 3], edge[e, 4], edge[e, 5], edge[e, 6]
    bx, by, bz = edge[e, 0], edge[e, 1], edge[e, 2]
    if not -ON <= (x - bx) * wx + (y - by) * wy + (z - bz) * wz <= extent + ON:
        return False
    _, s, foot = line_witness(cone, cone.x - bx, cone.y - by, cone.z - bz, wx, wy, wz)
    return not (0.0 < s < cone.length and 0.0 < foot < extent)


@jit_inline
def _vertex_rows(mesh: MeshFeatures, candidates: Record, probe: Probe, limit: float, row: int, contacts: Record) -> int:
    number, cone, start = probe
    vertex, index = mesh.vertex, candidates.piece[VERTICES]
    distance, parameter = candidates.distance[VERTICES], candidates.parameter[VERTICES]
    slope = cone.drop * cone.inverse_length
    first_key = _first_key(mesh, number) + 3 * (mesh.face.shape[0] + mesh.edge.shape[0])
    for i in range(start, start + candidates.measured[number, VERTICES]):
        if distance[i] > limit:
            continue
        s, v = parameter[i], index[i]
        x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
        dx, dy, dz = x - vertex[v, 0], y - vertex[v, 1], z - vertex[v, 2]
        size = math.sqrt(dx * dx + dy * dy + dz * dz)
        if size > 0.0:
            scale = 1.0 / size
            normal = (dx * scale, dy * scale, dz * scale)
        else:
            normal = _across(cone.ux, cone.uy, 1.0 if cone.length == 0.0 else cone.uz)
        inside, side, normal = _into_cone(mesh.spoke, mesh.spoke_start[v], mesh.spoke_start[v + 1], *normal)
        if not inside:
            continue
        if side >= 0 and not _is_of_edge(mesh, mesh.spoke_edge[side], cone, x, y, z):
            continue
        if row >= contacts.key.shape[0]:
            return -1
        radius = cone.radius - slope * s
        away = size if side < 0 else dx * normal[0] + dy * normal[1] + dz * normal[2]
        point = at_distance((x, y, z), normal, -radius)
        write_contact(contacts, row, point, normal, away - radius, (radius, 0.0), first_key + 3 * v)
        if side < 0:
            contacts.slides[row] = 1 if 0.0 < s < cone.length else 0
        else:
            # There the object is the edge along that spoke.
            for j in range(3):
                contacts.straight[j, row] = mesh.spoke[side, j]
        row += 1
    return row


@record_pieces.of(MeshFeatures)
@jit_inline
def _record(
    mesh: MeshFeatures, probe: Probe, pose: Record, candidates: Record, limit: float, row: int, contacts: Record
) -> int:
    begin = row
    row = _face_rows(mesh, candidates, probe, limit, row, contacts)
    if row >= 0:
        row = _edge_rows(mesh, candidates, probe, limit, row, contacts)
    if row >= 0:
        row = _vertex_rows(mesh, candidates, probe, limit, row, contacts)
    if row > begin and candidates.least[probe.number] < 0.0 and probe.cone.radius == 0.0:
        # Of a point inside the nearest one is the way out.
        best = begin
        for i in range(begin, row):
            best = i if contacts.distance[i] < contacts.distance[best] else best
        move_contact(contacts, best, begin)
        contacts.distance[begin] = -contacts.distance[begin]
        for j in range(3):
            contacts.normal[j, begin] = -contacts.normal[j, begin]
        return begin + 1
    return row


@jit
def _contact(triangle: Triangle, cone: RoundCone, s: float, limit: float, row: int, pairs_out: ContactPoints) -> int:
    """Write the pair of a triangle and the ball at s of the axis; return the row after it, -1 if they do not fit."""
    x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
    px, py, pz, square, _ = closest_on_triangle(x, y, z, triangle)
    radius, away = cone.radius - cone.drop * cone.inverse_length * s, math.sqrt(square)
    if away - radius > limit:
        return row
    if row >= pairs_out.tick.shape[0]:
        return -1
    inverse = 1.0 / away if away > 0.0 else 0.0
    normal = (inverse * (x - px), inverse * (y - py), inverse * (z - pz))
    for j in range(3):
        pairs_out.normal[row, j] = normal[j]
        pairs_out.point[row, j] = (x, y, z)[j] - radius * normal[j]
    return row + 1


@cone_contacts.of(MeshFeatures)
@jit
def _cone_contacts(
    mesh: MeshFeatures, cone: RoundCone, limit: float, walk: Walk, row: int, pairs_out: ContactPoints
) -> tuple[int, float]:
    # Each triangle counts where it is nearest to the axis, and at the ends of a phalanx, which may lie flat on it.
    count, clearance, _ = gather_pieces(mesh.tree, cone, limit, limit, walk.stack, walk.scratch)
    for i in range(count):
        face = walk.scratch[i]
        distance, s = triangle_distance(mesh.corner, mesh.face, face, cone)
        if distance > limit:
            clearance = min(clearance, distance)
            continue
        triangle = triangle_at(mesh.corner, face)
        row = _contact(triangle, cone, s, limit, row, pairs_out)
        for end in (0.0, cone.length):
            if row >= 0 and end != s and cone.length > 0.0:
                row = _contact(triangle, cone, end, limit, row, pairs_out)
        if row < 0:
            return -1, 0.0
    return row if count >= 0 else -1, clearance


@tree_of.of(MeshFeatures)
@jit_inline
def _tree_of(mesh: MeshFeatures) -> TreeArrays:
    return mesh.tree


@piece_distance.of(MeshFeatures)
@jit_inline
def _face_distance(mesh: MeshFeatures, face: int, cone: RoundCone) -> tuple[float, float]:
    return triangle_distance(mesh.corner, mesh.face, face, cone)


@jit
def _from_triangle(
    mesh: MeshFeatures, found: int, x: float, y: float, z: float, stack: Indices
) -> tuple[bool, float, float, float, float]:
    """Return whether a point is in the solid, its distance from its nearest triangle, and the way from there to it."""
    px, py, pz, square, feature = closest_on_triangle(x, y, z, triangle_at(mesh.corner, found))
    behind = True
    # The nearest triangle tells the side only on the boundary of a solid.
    if mesh.pseudonormal.shape[0] > 0:
        n = mesh.pseudonormal[found, feature]
        behind = n[0] * (x - px) + n[1] * (y - py) + n[2] * (z - pz) < 0.0
    inside = behind and is_surrounded(mesh.tree, mesh.corner, mesh.multiplicity, x, y, z, stack)
    return inside, math.sqrt(square), x - px, y - py, z - pz


@cone_distance.of(MeshFeatures)
@jit
def _cone_distance(mesh: MeshFeatures, cone: RoundCone, limit: float, stack: Indices) -> float:
    # If there is an inside, the nearest triangle is searched at any distance: its side decides.
    signed = mesh.multiplicity.shape[0] > 0
    best, found, s = nearest_piece(mesh, cone, np.inf if signed else limit, stack)
    if signed and found >= 0:
        x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
        inside, away, _, _, _ = _from_triangle(mesh, found, x, y, z, stack)
        if inside:
            best -= 2.0 * away
    return min(best, limit)


@jit
def way_out(mesh: MeshFeatures, x: float, y: float, z: float, stack: Indices) -> tuple[float, float, float, float]:
    """Compute a point's signed distance from a solid [m], negative inside, and the outward normal at the nearest point.

    The distance is infinite if the surface has no inside.
    """
    _, found, _ = nearest_piece(mesh, sphere_cone(x, y, z, 0.0), np.inf, stack)
    if found < 0 or mesh.multiplicity.shape[0] == 0:
        return (np.inf, 0.0, 0.0, 0.0)
    inside, away, dx, dy, dz = _from_triangle(mesh, found, x, y, z, stack)
    if away == 0.0:
        return (0.0, mesh.face[found, 0], mesh.face[found, 1], mesh.face[found, 2])
    height = -away if inside else away
    return (height, dx / height, dy / height, dz / height)


def _center(mesh: MeshFeatures) -> Array:
    return mesh.corner.reshape(-1, 3).mean(axis=0)


SURFACE = Surface(
    summary="the triangles of the object's mesh",
    arrays=MeshFeatures,
    candidates=CANDIDATES,
    center=_center,
    coarser="a mesh of fewer triangles",
    lists_margin=False,
)
