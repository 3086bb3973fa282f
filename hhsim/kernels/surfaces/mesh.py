"""Contacts with the triangles of the object's mesh: faces, edges and vertices, in closed form.

A row is kept where a feature's witness is a local minimum of the distance, in its normal cone: a row of a neighbour
would allow half of the way to it only, and lift a finger that slides over a fine mesh. The distances of all features
count, and the true distances after the step decide. A phalanx that lies flat has a row at each end.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.contact.detection import COUNT_NODE_TESTS
from hhsim.kernels.contact.linearise import move_contact
from hhsim.kernels.contact.surface import (
    SHARED_CANDIDATES,
    TIERS,
    ContactPoints,
    Surface,
    Walk,
    cone_contacts,
    cone_distance,
    gather_pairs,
    measure_pairs,
    next_tier,
    pairs_within,
    record_pairs,
    start_tiers,
    tier_depth,
    tier_of,
    way_out,
)
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT, HandArrays, phalanx_cone, placed_sphere
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline
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
from hhsim.kernels.round_cone import RoundCone, count_within, least_distance, sphere_cone
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays, gather_pieces, nearest_piece, piece_distance, tree_of
from hhsim.kernels.triangle import Triangle, closest_on_triangle, triangle_at

PALM_SPHERES = 1024
PROBES = PALM_BODY + PALM_SPHERES
"""Number of bodies with lists of their own: the phalanges, then the palm's spheres."""
PHALANX_CAPACITY = 4088
PALM_CAPACITY = 32768
CAPACITY = PALM_BODY * PHALANX_CAPACITY + PALM_CAPACITY
"""Most faces near a phalanx, near the palm, and in all; as many edges, as many vertices. Odd numbers of cache lines,
see `CONTACT_ROWS`."""
FOUND_CAPACITY = 4 * PHALANX_CAPACITY
"""Most faces whose spheres are near a probe: more than faces that are near, if they are small."""
LINE = 8
"""Values in a cache line."""
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
LOOK_OUT = 3.0
"""Multiple of its reach up to which a probe that is near nothing searches, for a slack that lasts."""
FINDING, LISTING = 1, 2
"""Node tests that a face near a probe counts as, and one of its features that is listed."""
SOON = 0.7
"""A sphere of the palm is soon due if its slack exceeds what is needed by less than this share of reach - needed."""
AHEAD_SPHERES = 2
"""Most such spheres that a tick with nothing else to gather gathers ahead of need."""
REACH_RATIO = 2.5
"""Least reach of a list as a multiple of what is needed, so that a fast hand's lasts for some ticks too."""
LONG_LIST = 512
"""Most faces, edges or vertices (each) of a probe's list with a wide skin: gathering stays fast on a fine mesh."""
SKIN_SHARES = (1.0, 0.3, 0.1, 0.03, 0.01)
"""Reaches of a probe's list, tried in turn until it is no longer than LONG_LIST: shares of the way from what is needed
to the full reach. With the last one the list may be as long as fits."""
MOST_FACES = 2 * LONG_LIST
"""Largest number of faces whose spheres are near for which the walk goes on to its end."""
NEEDED_SHARES = (0.25, 0.06, 0.015)
"""Shares of what is needed, tried if even that does not fit; the steps are then as short."""
KINDS = 3
"""Faces, edges, vertices."""
MOST_ACROSS = 64
"""Largest number of faces of one plane that are searched before a point is taken to be on one of them."""
FLAT = np.inf
"""Radius of curvature of a face [m]."""

CANDIDATES = np.dtype(
    [
        *SHARED_CANDIDATES,
        ("face", np.int64, (CAPACITY,)),  # features near the probes, by index in `MeshFeatures`
        ("edge", np.int64, (CAPACITY,)),
        ("vertex", np.int64, (CAPACITY,)),
        ("face_distance", np.float64, (CAPACITY,)),  # signed distances [m]
        ("edge_distance", np.float64, (CAPACITY,)),
        ("vertex_distance", np.float64, (CAPACITY,)),
        ("face_plane", np.float64, (FACE_FIELDS, CAPACITY)),  # copies of the features, field by field
        ("edge_line", np.float64, (EDGE_FIELDS, CAPACITY)),
        ("vertex_point", np.float64, (3, CAPACITY)),
        ("edge_end", np.float64, (CAPACITY,)),  # signed distance of the nearer end of a phalanx over the edge [m]
        ("edge_parameter", np.float64, (CAPACITY,)),  # s of the witness on the axis [m]
        ("vertex_parameter", np.float64, (CAPACITY,)),
        ("faces", np.int64, (PROBES,)),  # number of features of each probe
        ("edges", np.int64, (PROBES,)),
        ("vertices", np.int64, (PROBES,)),
        ("tier_end", np.int64, (PROBES, KINDS, TIERS)),  # number of features up to each tier's end
        ("tier_depth", np.float64, (PROBES,)),  # depth of a tier [m]
        ("measured", np.int64, (PROBES, KINDS)),  # number of features measured: the first ones
        ("own", np.float64, (PROBES,)),  # slack of each probe when it was gathered [m]
        ("extra_slack", np.float64, (PROBES,)),  # slack of each of the palm's spheres beyond that of the palm [m]
        ("least", np.float64, (PROBES,)),  # least distance of each probe [m]
        ("skin_share", np.int64, (PROBES,)),  # index in `SKIN_SHARES` of each probe's last gathering
        ("scratch", np.int64, (FOUND_CAPACITY + 2 * OWNED,)),  # workspace of a walk, as the last
        ("stack", np.int64, (STACK_SIZE,)),
    ],
    align=True,
)
"""Gathered features and their distances; each probe has its own stretch of the arrays."""


class Probe(NamedTuple):
    """A phalanx or a sphere of the palm, for which features are listed."""

    number: int
    cone: RoundCone
    start: int  # of its stretch of the candidates


@jit_inline
def _palm_capacity(hand: HandArrays) -> int:
    return LINE * ((min(PHALANX_CAPACITY, PALM_CAPACITY // hand.palm_radius.shape[0]) // LINE - 1) | 1)


@jit_inline
def _start(hand: HandArrays, probe: int) -> int:
    if probe < PALM_BODY:
        return probe * PHALANX_CAPACITY
    return PALM_BODY * PHALANX_CAPACITY + (probe - PALM_BODY) * _palm_capacity(hand)


@jit_inline
def _probe(hand: HandArrays, pose: Record, index: int) -> Probe:
    start = _start(hand, index)
    if index < PALM_BODY:
        cone = phalanx_cone(hand, pose.joints[:], pose.direction[:], index // PHALANX_COUNT, index % PHALANX_COUNT)
        x, y, z, ux, uy, uz, length, slope, inverse, radius, drop = cone
        length, drop = length if inverse > 0.0 else 0.0, drop if inverse > 0.0 else 0.0
        return Probe(index, RoundCone(x, y, z, ux, uy, uz, length, slope, inverse, radius, drop), start)
    i = index - PALM_BODY
    x, y, z, radius = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i], hand.palm_radius[i]
    return Probe(index, placed_sphere(pose.position[:], pose.rotation[:], x, y, z, radius), start)


@jit_inline
def _pair_count(candidates: Record, which: int) -> int:
    return candidates.faces[which] + candidates.edges[which] + candidates.vertices[which]


@jit_inline
def _measured_count(candidates: Record, which: int) -> int:
    measured = candidates.measured[which]
    return measured[0] + measured[1] + measured[2]


@jit_inline
def _list_features(
    mesh: MeshFeatures, probe: Probe, capacity: int, most_faces: int, reach: float, candidates: Record, walk: Walk
) -> float:
    """List the features of a probe; return its slack [m], a negative infinity if they do not fit."""
    (which, cone, start), work = probe, walk.work
    far = _pair_count(candidates, which) == 0 and candidates.own[which] > reach
    look_out = LOOK_OUT * reach if far else reach
    found = walk.scratch[: walk.scratch.shape[0] - 2 * OWNED]
    batch_edges, batch_vertices = walk.scratch[-2 * OWNED : -OWNED], walk.scratch[-OWNED:]
    count, slack, tests = gather_pieces(mesh.tree, cone, reach, look_out, walk.stack, found[:most_faces])
    work[COUNT_NODE_TESTS] += tests + FINDING * max(count, 0)
    if count < 0:
        return -np.inf
    one_sided = mesh.pseudonormal.shape[0] > 0
    face_out, edge_out, vertex_out = candidates.face, candidates.edge, candidates.vertex
    # Until the lists are sorted, the distances hold the least motion to each feature.
    face_near, edge_near = candidates.face_distance, candidates.edge_distance
    vertex_near = candidates.vertex_distance
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
            if faces >= start + capacity:
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
            if edges >= start + capacity:
                return -np.inf
            edge = batch_edges[i]
            near = edge_bound(mesh, edge, cone, tolerance, reach)
            listed = near <= reach
            edge_out[edges], edge_near[edges] = edge, near
            edges += 1 if listed else 0
            slack = min(slack, np.inf if listed else near)
        for i in range(own_vertices):
            if vertices >= start + capacity:
                return -np.inf
            vertex = batch_vertices[i]
            near = vertex_bound(mesh, vertex, cone, tolerance)
            listed = near <= reach
            vertex_out[vertices], vertex_near[vertices] = vertex, near
            vertices += 1 if listed else 0
            slack = min(slack, np.inf if listed else near)
    depth = tier_depth(reach)
    ends = candidates.tier_end[which]
    _put_in_order(start, faces, depth, face_near[:], ends[0], found, mesh.face, face_out[:], candidates.face_plane[:].T)
    _put_in_order(start, edges, depth, edge_near[:], ends[1], found, mesh.edge, edge_out[:], candidates.edge_line[:].T)
    points = candidates.vertex_point[:].T
    _put_in_order(start, vertices, depth, vertex_near[:], ends[2], found, mesh.vertex, vertex_out[:], points)
    candidates.tier_depth[which] = depth
    candidates.faces[which] = faces - start
    candidates.edges[which] = edges - start
    candidates.vertices[which] = vertices - start
    work[COUNT_NODE_TESTS] += LISTING * _pair_count(candidates, which)
    return slack


@jit
def _put_in_order(
    start: int,
    stop: int,
    depth: float,
    near: Array,
    end_out: Indices,
    scratch: Indices,
    features: Array,
    index: Indices,
    fields_out: Array,
) -> None:
    """Sort the features [start, stop) by tier, and copy their fields."""
    start_tiers(near[start:stop], stop - start, depth, end_out)
    for i in range(start, stop):
        scratch[i - start] = index[i]
    for i in range(start, stop):
        t = tier_of(near[i], depth)
        place, feature = start + end_out[t], scratch[i - start]
        end_out[t] += 1
        index[place] = feature
        for m in range(features.shape[1]):
            fields_out[place, m] = features[feature, m]


@jit_inline
def _gather_probe(
    mesh: MeshFeatures, hand: HandArrays, pose: Record, which: int, reach: float, candidates: Record, walk: Walk
) -> float:
    """List the features of a probe as far as they fit; return its slack [m], a negative infinity if none do."""
    probe = _probe(hand, pose, which)
    capacity = PHALANX_CAPACITY if which < PALM_BODY else _palm_capacity(hand)
    needed, last = candidates.needed, len(SKIN_SHARES) - 1
    reach = max(reach, REACH_RATIO * needed)
    slack = -np.inf
    for k in range(candidates.skin_share[which], len(SKIN_SHARES) + len(NEEDED_SHARES)):
        if k <= last:
            least = needed + SKIN_SHARES[k] * max(reach - needed, 0.0)
        else:
            least = NEEDED_SHARES[k - len(SKIN_SHARES)] * needed
        most, most_faces = (min(LONG_LIST, capacity), MOST_FACES) if k < last else (capacity, FOUND_CAPACITY)
        slack = _list_features(mesh, probe, most, most_faces, least, candidates, walk)
        if slack > -np.inf:
            # After a short list the reach may be longer the next time.
            few = 8 * _pair_count(candidates, which) < LONG_LIST
            candidates.skin_share[which] = max(k - 1, 0) if few else k
            candidates.own[which] = slack
            break
    return slack


@gather_pairs.of(MeshFeatures)
@jit_inline
def _gather(
    mesh: MeshFeatures, hand: HandArrays, pose: Record, body: int, reach: float, candidates: Record, walk: Walk
) -> bool:
    if body < PALM_BODY:
        slack = _gather_probe(mesh, hand, pose, body, reach, candidates, walk)
        if slack == -np.inf:
            return False
        candidates.count[body] = _pair_count(candidates, body)
        candidates.slack[body] = slack
        return True
    # Of the palm's spheres those whose slack is used up, and a few that soon will be: the others' lists stay valid, and
    # all of them at once would take many times another tick.
    spheres = hand.palm_radius.shape[0]
    if spheres > PALM_SPHERES:
        return False
    palm, extra, used = hand.palm_group, candidates.extra_slack, candidates.slack[PALM_BODY]
    needed = candidates.needed
    must = needed - candidates.allowed_deficit
    soon = needed + SOON * (reach - needed)
    ahead = AHEAD_SPHERES if candidates.due[PALM_BODY] == 2 else 0
    total = 0
    slack = np.inf
    for group in range(hand.palm_group_start.shape[0] - 1):
        first, last = PALM_BODY + hand.palm_group_start[group], PALM_BODY + hand.palm_group_start[group + 1]
        due, listed = 0, 0
        for which in range(first, last):
            due += 0 if used + extra[which] > (soon if ahead > 0 else must) else 1
            listed += _pair_count(candidates, which)
        if due > 1 and listed == 0:
            # If the sphere around a group is near nothing, nor is any of them; the walk ends at the first face.
            x, y, z, radius = palm[0, group], palm[1, group], palm[2, group], palm[3, group]
            cone = placed_sphere(pose.position[:], pose.rotation[:], x, y, z, radius)
            none = walk.scratch[:0]
            count, clearance, tests = gather_pieces(mesh.tree, cone, reach, LOOK_OUT * reach, walk.stack, none)
            walk.work[COUNT_NODE_TESTS] += tests
            if count == 0:
                for which in range(first, last):
                    extra[which] = max(used + extra[which], clearance) - used
        for which in range(first, last):
            own = used + extra[which]
            if not own > (soon if ahead > 0 else must):
                ahead -= 1 if own > must else 0
                own = _gather_probe(mesh, hand, pose, which, reach, candidates, walk)
                if own == -np.inf:
                    # Slacks of spheres gathered anew and before are relative to different references.
                    candidates.slack[PALM_BODY] = -np.inf
                    return False
            extra[which] = own
            slack = min(slack, own)
            total += _pair_count(candidates, which)
    for which in range(PALM_BODY, PALM_BODY + spheres):
        extra[which] = extra[which] - slack if extra[which] < np.inf else np.inf
    candidates.count[PALM_BODY] = total
    candidates.slack[PALM_BODY] = slack
    return True


@jit_inline
def _measure_probe(
    mesh: MeshFeatures, hand: HandArrays, pose: Record, which: int, candidates: Record, slack: float
) -> float:
    """Measure tier by tier what may be within what is needed, until nothing else can be nearer; return the least."""
    _, cone, start = _probe(hand, pose, which)
    moved, needed, depth = candidates.own[which] - slack, candidates.needed, candidates.tier_depth[which]
    ends, measured = candidates.tier_end[which], candidates.measured[which]
    face_distance, edge_distance = candidates.face_distance, candidates.edge_distance
    vertex_distance = candidates.vertex_distance
    for kind in range(KINDS):
        measured[kind] = 0
    least, tier = ELSEWHERE, as_int64(0)
    while True:
        after = next_tier(tier, depth, moved, needed, least)
        if after == tier:
            break
        tier = after
        first, stop = start + measured[0], start + ends[0, tier - 1]
        if first < stop:
            face_distances(candidates.face_plane[:].T, first, stop, cone, face_distance[:])
            least = min(least, least_distance(face_distance[:], first, stop))
        first, stop = start + measured[1], start + ends[1, tier - 1]
        if first < stop:
            parameter, end = candidates.edge_parameter[:], candidates.edge_end[:]
            edge_distances(candidates.edge_line[:].T, first, stop, cone, edge_distance[:], parameter, end)
            least = min(least, least_distance(edge_distance[:], first, stop))
        first, stop = start + measured[2], start + ends[2, tier - 1]
        if first < stop:
            parameter = candidates.vertex_parameter[:]
            vertex_distances(candidates.vertex_point[:].T, first, stop, cone, vertex_distance[:], parameter)
            least = min(least, least_distance(vertex_distance[:], first, stop))
        for kind in range(KINDS):
            measured[kind] = ends[kind, tier - 1]
    return least


@jit_inline
def _lean(mesh: MeshFeatures, f: int, dx: float, dy: float, dz: float) -> float:
    face = mesh.face
    return dx * face[f, 0] + dy * face[f, 1] + dz * face[f, 2]


@jit_inline
def _is_inside(mesh: MeshFeatures, candidates: Record, probe: Probe) -> bool:
    """Return whether a point is inside, by the normals at the nearest feature; a body's axis never comes inside."""
    which, cone, start = probe
    measured, lean, least = candidates.measured[which], 1.0, ELSEWHERE
    for i in range(start, start + measured[0]):
        if candidates.face_distance[i] < least:
            f, least = candidates.face[i], candidates.face_distance[i]
            lean = _lean(mesh, f, cone.x, cone.y, cone.z) - mesh.face[f, 3]
    for i in range(start, start + measured[1]):
        if candidates.edge_distance[i] < least:
            e, least = candidates.edge[i], candidates.edge_distance[i]
            dx, dy, dz = cone.x - mesh.edge[e, 0], cone.y - mesh.edge[e, 1], cone.z - mesh.edge[e, 2]
            lean = 0.0
            for w in range(mesh.wing_start[e], mesh.wing_start[e + 1]):
                lean += _lean(mesh, mesh.wing_face[w], dx, dy, dz)
    for i in range(start, start + measured[2]):
        if candidates.vertex_distance[i] < least:
            v, least = candidates.vertex[i], candidates.vertex_distance[i]
            dx, dy, dz = cone.x - mesh.vertex[v, 0], cone.y - mesh.vertex[v, 1], cone.z - mesh.vertex[v, 2]
            lean = 0.0
            for k in range(mesh.spoke_start[v], mesh.spoke_start[v + 1]):
                e = mesh.spoke_edge[k]
                for w in range(mesh.wing_start[e], mesh.wing_start[e + 1]):
                    lean += _lean(mesh, mesh.wing_face[w], dx, dy, dz)
    return lean < 0.0


@jit_inline
def _keep_way_out(contacts: Record, start: int, stop: int) -> int:
    """Keep, of the rows of a point inside, the nearest one, as the way out; returns the row after it."""
    best = start
    for i in range(start, stop):
        if contacts.distance[i] < contacts.distance[best]:
            best = i
    if stop <= start:
        return stop
    move_contact(contacts, best, start)
    contacts.distance[start] = -contacts.distance[start]
    for j in range(3):
        contacts.normal[j, start] = -contacts.normal[j, start]
    return start + 1


@measure_pairs.of(MeshFeatures)
@jit_inline
def _measure(mesh: MeshFeatures, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    slack = candidates.slack[body]
    if body < PALM_BODY:
        candidates.least[body] = _measure_probe(mesh, hand, pose, body, candidates, slack)
        candidates.count[body] = _measured_count(candidates, body)
        return float(candidates.least[body])
    least, count = np.inf, 0
    for which in range(PALM_BODY, PALM_BODY + hand.palm_radius.shape[0]):
        candidates.least[which] = np.inf
        if _pair_count(candidates, which) > 0:
            candidates.least[which] = _measure_probe(
                mesh, hand, pose, which, candidates, slack + candidates.extra_slack[which]
            )
            if hand.palm_radius[which - PALM_BODY] == 0.0 and _is_inside(mesh, candidates, _probe(hand, pose, which)):
                candidates.least[which] = -candidates.least[which]
            count += _measured_count(candidates, which)
            least = min(least, candidates.least[which])
    candidates.count[PALM_BODY] = count
    return least


@jit_inline
def _probes(hand: HandArrays, body: int) -> tuple[int, int]:
    """Return the first probe of a body, and the one after its last."""
    return body, (body + 1 if body < PALM_BODY else PALM_BODY + hand.palm_radius.shape[0])


@pairs_within.of(MeshFeatures)
@jit_inline
def _within(mesh: MeshFeatures, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    within = 0
    first, last = _probes(hand, body)
    for which in range(first, last):
        if candidates.least[which] <= limit:
            start, measured = _start(hand, which), candidates.measured[which]
            within += count_within(candidates.face_distance[:], start, start + measured[0], limit)
            within += count_within(candidates.edge_distance[:], start, start + measured[1], limit)
            within += count_within(candidates.vertex_distance[:], start, start + measured[2], limit)
    return within


@jit_inline
def _write(
    contacts: Record,
    row: int,
    place: tuple[float, float, float],
    normal: tuple[float, float, float],
    radius: float,
    distance: float,
    object_radius: float,
    key: int,
) -> None:
    # The rows' body is written once, in `_record`.
    contacts.key[row] = key
    for j in range(3):
        contacts.normal[j, row] = normal[j]
        contacts.point[j, row] = place[j] - radius * normal[j]
        contacts.straight[j, row] = 0.0
    contacts.hand_radius[row] = radius
    contacts.distance[row] = distance
    contacts.object_radius[row] = object_radius
    contacts.slides[row] = 0


@jit_inline
def _first_key(mesh: MeshFeatures, which: int) -> int:
    return 3 * (mesh.face.shape[0] + mesh.edge.shape[0] + mesh.vertex.shape[0]) * which


@jit_inline
def _face_rows(mesh: MeshFeatures, candidates: Record, probe: Probe, limit: float, row: int, contacts: Record) -> int:
    _, cone, start = probe
    ends = 2 if cone.length > 0.0 else 1
    face, index, distance = mesh.face, candidates.face, candidates.face_distance
    first_key = _first_key(mesh, probe.number)
    for i in range(start, start + candidates.measured[probe.number, 0]):
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
            _write(contacts, row, (x, y, z), normal, radius, abs(height) - radius, FLAT, first_key + 3 * f + end)
            row += 1
    return row


@jit_inline
def _into_cone(
    directions: Array, start: int, stop: int, nx: float, ny: float, nz: float
) -> tuple[bool, int, tuple[float, float, float]]:
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
    _, cone, start = probe
    tries = 3 if cone.length > 0.0 else 1
    edge, index, distance = mesh.edge, candidates.edge, candidates.edge_distance
    parameter, end_distance = candidates.edge_parameter, candidates.edge_end
    slope = cone.drop * cone.inverse_length
    first_key = _first_key(mesh, probe.number) + 3 * mesh.face.shape[0]
    for i in range(start, start + candidates.measured[probe.number, 1]):
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
            _write(contacts, row, (x, y, z), normal, radius, away - radius, 0.0 if side < 0 else FLAT, key)
            if side < 0:
                contacts.straight[0, row] = wx
                contacts.straight[1, row] = wy
                contacts.straight[2, row] = wz
                contacts.slides[row] = 1 if which == 0 and 0.0 < s < cone.length else 0
            row += 1
    return row


@jit_inline
def _across(wx: float, wy: float, wz: float) -> tuple[float, float, float]:
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
    _, cone, start = probe
    vertex, index = mesh.vertex, candidates.vertex
    distance, parameter = candidates.vertex_distance, candidates.vertex_parameter
    slope = cone.drop * cone.inverse_length
    first_key = _first_key(mesh, probe.number) + 3 * (mesh.face.shape[0] + mesh.edge.shape[0])
    for i in range(start, start + candidates.measured[probe.number, 2]):
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
        _write(contacts, row, (x, y, z), normal, radius, away - radius, 0.0, first_key + 3 * v)
        if side < 0:
            contacts.slides[row] = 1 if 0.0 < s < cone.length else 0
        else:
            # There the object is the edge along that spoke.
            for j in range(3):
                contacts.straight[j, row] = mesh.spoke[side, j]
        row += 1
    return row


@record_pairs.of(MeshFeatures)
@jit_inline
def _record(
    mesh: MeshFeatures,
    hand: HandArrays,
    pose: Record,
    body: int,
    candidates: Record,
    limit: float,
    row: int,
    contacts: Record,
) -> int:
    first, last = _probes(hand, body)
    for which in range(first, last):
        if candidates.least[which] > limit:
            continue
        probe, begin = _probe(hand, pose, which), row
        row = _face_rows(mesh, candidates, probe, limit, row, contacts)
        if row >= 0:
            row = _edge_rows(mesh, candidates, probe, limit, row, contacts)
        if row >= 0:
            row = _vertex_rows(mesh, candidates, probe, limit, row, contacts)
        if row < 0:
            return -1
        if candidates.least[which] < 0.0 and probe.cone.radius == 0.0:
            row = _keep_way_out(contacts, begin, row)
        for i in range(begin, row):
            contacts.body[i] = body
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


@way_out.of(MeshFeatures)
@jit
def _way_out(mesh: MeshFeatures, x: float, y: float, z: float, stack: Indices) -> tuple[float, float, float, float]:
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
