"""The triangles of the object's mesh themselves: faces, edges and vertices, in closed form.

A row is kept where a feature's witness is a local minimum of the distance, in its normal cone: a row of a neighbour
would allow half of the way to it only, and lift a finger that slides over a fine mesh. What is left out is nearer to
nothing, its distance counts, and the true distances after the step decide. A phalanx that lies flat has a row at each
end: that of the nearer one says nothing of the other.
"""

import math

import numpy as np

from hhsim.kernels.contact.detection import COUNT_NODE_TESTS
from hhsim.kernels.contact.surface import (
    SHARED_CANDIDATES,
    ContactPoints,
    Surface,
    Walk,
    cone_contacts,
    cone_distance,
    gather_pairs,
    measure_pairs,
    pairs_within,
    record_pairs,
)
from hhsim.kernels.contact.tiers import TIERS, next_tier, start_tiers, tier_depth, tier_of
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline, jit_once, jit_vector
from hhsim.kernels.mesh.feature_distance import (
    ELSEWHERE,
    ON,
    above,
    edge_bound,
    edge_distances,
    face_bounds,
    face_distances,
    line_witness,
    triangle_distance,
    vertex_bound,
    vertex_distances,
)
from hhsim.kernels.mesh.features import (
    ALONG,
    BRANCHING,
    EDGE_FIELDS,
    FACE_FIELDS,
    NOWHERE,
    MeshFeatures,
    block_distance,
    gather_faces,
)
from hhsim.kernels.mesh.ray_winding import is_surrounded
from hhsim.kernels.prefetch import prefetch
from hhsim.kernels.round_cone_distance import RoundCone, sphere_cone
from hhsim.kernels.sphere_tree import STACK_SIZE
from hhsim.kernels.triangle import Triangle, closest_on_triangle

PALM_SPHERES = 1024
PARTS = PALM_BODY + PALM_SPHERES
"""What is walked for: the phalanges, then the palm's spheres."""
PHALANX_ROOM = 4088
PALM_ROOM = 32768
LINE = 8
"""Numbers in a cache line."""
BATCH = 32
OWNED = 3 * BATCH
"""Faces that are listed together, and their edges: memory for the next ones is on its way meanwhile."""
FACE_BYTES, EDGE_BYTES, VERTEX_BYTES, OWN_BYTES = 8 * FACE_FIELDS, 8 * EDGE_FIELDS, 24, 24
WING_BYTES, SPOKE_BYTES = 48, 128
"""Of a face, an edge, a vertex, what belongs to a face, the two wings of an edge and the first spokes of a vertex."""
FOUND_ROOM = 4 * PHALANX_ROOM
"""Faces whose spheres are near a part: more than those that are near themselves, where they are small."""
ROOM = PALM_BODY * PHALANX_ROOM + PALM_ROOM
"""Faces near a phalanx and near the palm, and in all; as many edges, as many vertices. Odd numbers of cache lines, see
`CONTACT_ROWS`."""
NEAR_CONE = 0.03
"""Sine of the angle by which a witness may lie outside of its feature's normal cone and still have a row, whose normal
is the cone's nearest.

Two edges of a face that a phalanx lies on take turns in being the nearest. With the witness's own normal a row would
hold back what slides towards it. The row is then one of the face or edge that the witness leans to, and there is none
where that does not reach so far, or where an edge is touched at another place of the axis.
"""
LOOK_OUT = 3.0
"""A part that is near nothing looks so many times as far as its reach, for a slack that lasts."""
FINDING, LISTING = 1, 2
"""Node tests that a face near a part counts as, and one of its features that is listed."""
SOON = 0.7
AHEAD_SPHERES = 2
"""In a tick that has nothing else to gather, up to so many of the palm's spheres are gathered ahead of need: of those
whose slack exceeds what is needed by less than this share of the way to the reach."""
PACE = 2.5
"""A list reaches at least so many times as far as what is needed: that of a fast hand must last for some ticks too."""
CROWD = 512
SHARES = (1.0, 0.3, 0.1, 0.03, 0.01)
"""Where more features than a crowd are within the reach of a part, the next share of the way from what is needed to
that reach is tried: a list must not take long to gather, however fine the mesh."""
CROWD_FACES = 2 * CROWD
"""Faces whose spheres are near are so many at most where their features are no crowd; beyond, the walk is left off."""
LAST_SHARES = (0.25, 0.06, 0.015)
"""Of what is needed, where even that is more than there is room for: the steps are as short then."""
KINDS = 3
"""Faces, edges, vertices."""
MOST_ACROSS = 64
"""Faces of one plane that are gone through, before a place is taken to be on one of them."""
FLAT = np.inf
"""Radius of curvature of a face [m]."""

CANDIDATES = np.dtype(
    [
        ("face", np.int64, (ROOM,)),
        ("edge", np.int64, (ROOM,)),
        ("vertex", np.int64, (ROOM,)),
        ("face_distance", np.float64, (ROOM,)),
        ("edge_distance", np.float64, (ROOM,)),
        ("vertex_distance", np.float64, (ROOM,)),
        ("face_plane", np.float64, (FACE_FIELDS, ROOM)),
        ("edge_line", np.float64, (EDGE_FIELDS, ROOM)),
        ("vertex_point", np.float64, (3, ROOM)),
        ("edge_end", np.float64, (ROOM,)),
        ("edge_parameter", np.float64, (ROOM,)),
        ("vertex_parameter", np.float64, (ROOM,)),
        ("faces", np.int64, (PARTS,)),
        ("edges", np.int64, (PARTS,)),
        ("vertices", np.int64, (PARTS,)),
        ("tier_end", np.int64, (PARTS, KINDS, TIERS)),
        ("tier_depth", np.float64, (PARTS,)),
        ("measured", np.int64, (PARTS, KINDS)),
        ("own", np.float64, (PARTS,)),
        ("spare", np.float64, (PARTS,)),
        ("least", np.float64, (PARTS,)),
        ("share", np.int64, (PARTS,)),
        ("near", np.float64, (PARTS, BRANCHING)),
        *SHARED_CANDIDATES,
        ("scratch", np.int64, (FOUND_ROOM + 2 * OWNED,)),
        ("stack", np.int64, (STACK_SIZE,)),
    ],
    align=True,
)
"""Gathered features and their distances; each part of the hand has its own stretch of the room.

| field | meaning |
|---|---|
| face, edge, vertex | features near the parts, by their place in `MeshFeatures` |
| face_distance, … | signed distances [m] |
| face_plane, edge_line, vertex_point | the features once more, field by field |
| edge_end | signed distance of the nearer end of a phalanx that is over the edge [m] |
| edge_parameter, vertex_parameter | s of the witness on the axis [m] |
| faces, edges, vertices | how many each part has |
| tier_end, tier_depth | how many of each kind the tiers hold up to each one's end, and how deep a tier is [m] |
| measured | how many of each kind have been measured: the first ones |
| own | slack of each part when it was gathered [m] |
| spare | slack of each of the palm's spheres beyond that of the palm [m] |
| least | least distance of each part [m] |
| share | which of `SHARES` each part was last gathered with |
| near, scratch, stack | of a walk |
"""


@jit_inline
def _start(hand: HandArrays, part: int) -> int:
    if part < PALM_BODY:
        return part * PHALANX_ROOM
    return PALM_BODY * PHALANX_ROOM + (part - PALM_BODY) * _palm_room(hand)


@jit_inline
def _palm_room(hand: HandArrays) -> int:
    return LINE * ((min(PHALANX_ROOM, PALM_ROOM // hand.palm_radius.shape[0]) // LINE - 1) | 1)


@jit_inline
def _cone(hand: HandArrays, pose: Record, part: int) -> RoundCone:
    if part < PALM_BODY:
        f, k = part // PHALANX_COUNT, part % PHALANX_COUNT
        joint, direction = pose.joints[f, k], pose.direction[f, k]
        return RoundCone(
            joint[0],
            joint[1],
            joint[2],
            direction[0],
            direction[1],
            direction[2],
            hand.length[f, k] if hand.inverse_length[f, k] > 0.0 else 0.0,
            hand.tan_slope[f, k],
            hand.inverse_length[f, k],
            hand.radius[f, k],
            hand.radius[f, k] - hand.radius[f, k + 1] if hand.inverse_length[f, k] > 0.0 else 0.0,
        )
    i = part - PALM_BODY
    position, rotation = pose.position, pose.rotation
    x, y, z = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i]
    return sphere_cone(
        position[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        position[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        position[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        hand.palm_radius[i],
    )


@jit
def _pair_count(candidates: Record, part: int) -> int:
    return candidates.faces[part] + candidates.edges[part] + candidates.vertices[part]


@jit
def _measured_count(candidates: Record, part: int) -> int:
    measured = candidates.measured[part]
    return measured[0] + measured[1] + measured[2]


@jit
def _list_features(
    mesh: MeshFeatures,
    cone: RoundCone,
    part: int,
    start: int,
    room: int,
    most_faces: int,
    reach: float,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> float:
    # Returns the part's slack; a negative infinity where there is no room.
    far = _pair_count(candidates, part) == 0 and candidates.own[part] > reach
    look_out = LOOK_OUT * reach if far else reach
    found = walk.scratch[: walk.scratch.shape[0] - 2 * OWNED]
    batch_edges, batch_vertices = walk.scratch[-2 * OWNED : -OWNED], walk.scratch[-OWNED:]
    stack, block = walk.stack, candidates.near[part]
    count, slack, tests = gather_faces(mesh.spheres, cone, reach, look_out, stack, block, found[:most_faces])
    work[COUNT_NODE_TESTS] += tests + FINDING * max(count, 0)
    if count < 0:
        return -np.inf
    one_sided = mesh.pseudonormal.shape[0] > 0
    face_out, edge_out, vertex_out = candidates.face, candidates.edge, candidates.vertex
    # Until they are in order, the distances hold how far the part must move.
    face_near, edge_near, vertex_near = (
        candidates.face_distance,
        candidates.edge_distance,
        candidates.vertex_distance,
    )
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
        # What is kept of a batch, its edges and its vertices: which they are nobody can guess, and no branch tells.
        own_edges, own_vertices = 0, 0
        for i in range(first, stop):
            face = found[i]
            triangle, inside = face_bounds(mesh.face, face, cone, one_sided)
            if triangle > reach:
                slack = min(slack, triangle)
                continue
            if faces >= start + room:
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
            if edges >= start + room:
                return -np.inf
            edge = batch_edges[i]
            near = edge_bound(
                mesh.edge, edge, cone, mesh.wing, wing_start[edge], wing_start[edge + 1], tolerance, reach
            )
            listed = near <= reach
            edge_out[edges], edge_near[edges] = edge, near
            edges += 1 if listed else 0
            slack = min(slack, np.inf if listed else near)
        for i in range(own_vertices):
            if vertices >= start + room:
                return -np.inf
            vertex = batch_vertices[i]
            near = vertex_bound(
                mesh.vertex, vertex, cone, mesh.spoke, spoke_start[vertex], spoke_start[vertex + 1], tolerance
            )
            listed = near <= reach
            vertex_out[vertices], vertex_near[vertices] = vertex, near
            vertices += 1 if listed else 0
            slack = min(slack, np.inf if listed else near)
    depth = tier_depth(reach)
    ends = candidates.tier_end[part]
    _put_in_order(start, faces, depth, face_near[:], ends[0], found, mesh.face, face_out[:], candidates.face_plane[:].T)
    _put_in_order(start, edges, depth, edge_near[:], ends[1], found, mesh.edge, edge_out[:], candidates.edge_line[:].T)
    points = candidates.vertex_point[:].T
    _put_in_order(start, vertices, depth, vertex_near[:], ends[2], found, mesh.vertex, vertex_out[:], points)
    candidates.tier_depth[part] = depth
    candidates.faces[part] = faces - start
    candidates.edges[part] = edges - start
    candidates.vertices[part] = vertices - start
    work[COUNT_NODE_TESTS] += LISTING * _pair_count(candidates, part)
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
    # Sorts the features [start, stop) by tier, and copies their fields.
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


@jit
def _gather_part(
    mesh: MeshFeatures,
    hand: HandArrays,
    pose: Record,
    part: int,
    reach: float,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> float:
    # Returns the part's slack; a negative infinity where there is no room.
    cone, start = _cone(hand, pose, part), _start(hand, part)
    room = PHALANX_ROOM if part < PALM_BODY else _palm_room(hand)
    needed, last = candidates.needed, len(SHARES) - 1
    reach = max(reach, PACE * needed)
    slack = -np.inf
    for k in range(candidates.share[part], len(SHARES) + len(LAST_SHARES)):
        if k <= last:
            least = needed + SHARES[k] * max(reach - needed, 0.0)
        else:
            least = LAST_SHARES[k - len(SHARES)] * needed
        most, most_faces = (min(CROWD, room), CROWD_FACES) if k < last else (room, FOUND_ROOM)
        slack = _list_features(mesh, cone, part, start, most, most_faces, least, candidates, walk, work)
        if slack > -np.inf:
            # Where few are left, more may be looked for the next time.
            few = 8 * _pair_count(candidates, part) < CROWD
            candidates.share[part] = max(k - 1, 0) if few else k
            candidates.own[part] = slack
            break
    return slack


@jit_inline
def _group_cone(hand: HandArrays, pose: Record, group: int) -> RoundCone:
    position, rotation, sphere = pose.position, pose.rotation, hand.palm_group
    x, y, z = sphere[0, group], sphere[1, group], sphere[2, group]
    return sphere_cone(
        position[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        position[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        position[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        sphere[3, group],
    )


@jit
def _gather_palm_spheres(
    mesh: MeshFeatures, hand: HandArrays, pose: Record, reach: float, candidates: Record, walk: Walk, work: Indices
) -> bool:
    # Only the spheres whose own slack is used up, and a few that soon will be: the others' lists are as good as they
    # were, and all of them at once would take many times another tick.
    spheres = hand.palm_radius.shape[0]
    if spheres > PALM_SPHERES:
        return False
    spare, used = candidates.spare, candidates.slack[PALM_BODY]
    needed = candidates.needed
    must = needed - candidates.leeway
    soon = needed + SOON * (reach - needed)
    ahead = AHEAD_SPHERES if candidates.due[PALM_BODY] == 2 else 0
    total = 0
    slack = np.inf
    for group in range(hand.palm_group_start.shape[0] - 1):
        first, last = PALM_BODY + hand.palm_group_start[group], PALM_BODY + hand.palm_group_start[group + 1]
        due, listed = 0, 0
        for part in range(first, last):
            due += 0 if used + spare[part] > (soon if ahead > 0 else must) else 1
            listed += _pair_count(candidates, part)
        if due > 1 and listed == 0:
            # Where the sphere around a group is near nothing, nor is any of them.
            count, clearance, tests = gather_faces(
                mesh.spheres,
                _group_cone(hand, pose, group),
                reach,
                LOOK_OUT * reach,
                walk.stack,
                candidates.near[PALM_BODY],
                # Without room for a face the walk ends at the first one.
                walk.scratch[:0],
            )
            work[COUNT_NODE_TESTS] += tests
            if count == 0:
                for part in range(first, last):
                    spare[part] = max(used + spare[part], clearance) - used
        for part in range(first, last):
            own = used + spare[part]
            if not own > (soon if ahead > 0 else must):
                ahead -= 1 if own > must else 0
                own = _gather_part(mesh, hand, pose, part, reach, candidates, walk, work)
                if own == -np.inf:
                    # What has been gathered anew has no common measure with what has not.
                    candidates.slack[PALM_BODY] = -np.inf
                    return False
            spare[part] = own
            slack = min(slack, own)
            total += _pair_count(candidates, part)
    for part in range(PALM_BODY, PALM_BODY + spheres):
        spare[part] = spare[part] - slack if spare[part] < np.inf else np.inf
    candidates.count[PALM_BODY] = total
    candidates.slack[PALM_BODY] = slack
    return True


@gather_pairs.of(MeshFeatures)
@jit
def _gather(
    mesh: MeshFeatures,
    hand: HandArrays,
    pose: Record,
    body: int,
    reach: float,
    candidates: Record,
    walk: Walk,
    work: Indices,
) -> bool:
    if body < PALM_BODY:
        slack = _gather_part(mesh, hand, pose, body, reach, candidates, walk, work)
        if slack == -np.inf:
            return False
        candidates.count[body] = _pair_count(candidates, body)
        candidates.slack[body] = slack
        return True
    return _gather_palm_spheres(mesh, hand, pose, reach, candidates, walk, work)


@jit_vector
def _count_within(distance: Array, start: int, stop: int, limit: float) -> int:
    within = 0
    for i in range(np.uint64(start), np.uint64(stop)):
        within += 1 if distance[i] <= limit else 0
    return within


@jit_vector
def _least(distance: Array, start: int, stop: int) -> float:
    least = ELSEWHERE
    for i in range(np.uint64(start), np.uint64(stop)):
        least = distance[i] if distance[i] < least else least
    return least


@jit
def _measure_part(
    mesh: MeshFeatures, hand: HandArrays, pose: Record, part: int, candidates: Record, slack: float
) -> float:
    # Tier by tier: those that what is needed may reach, and on until nothing that is left can be nearer.
    start, cone = _start(hand, part), _cone(hand, pose, part)
    moved, needed, depth = candidates.own[part] - slack, candidates.needed, candidates.tier_depth[part]
    ends, measured = candidates.tier_end[part], candidates.measured[part]
    face_distance, edge_distance, vertex_distance = (
        candidates.face_distance,
        candidates.edge_distance,
        candidates.vertex_distance,
    )
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
            least = min(least, _least(face_distance[:], first, stop))
        first, stop = start + measured[1], start + ends[1, tier - 1]
        if first < stop:
            parameter, end = candidates.edge_parameter[:], candidates.edge_end[:]
            edge_distances(candidates.edge_line[:].T, first, stop, cone, edge_distance[:], parameter, end)
            least = min(least, _least(edge_distance[:], first, stop))
        first, stop = start + measured[2], start + ends[2, tier - 1]
        if first < stop:
            parameter = candidates.vertex_parameter[:]
            vertex_distances(candidates.vertex_point[:].T, first, stop, cone, vertex_distance[:], parameter)
            least = min(least, _least(vertex_distance[:], first, stop))
        for kind in range(KINDS):
            measured[kind] = ends[kind, tier - 1]
    return least


@measure_pairs.of(MeshFeatures)
@jit
def _measure(mesh: MeshFeatures, hand: HandArrays, pose: Record, body: int, candidates: Record) -> float:
    slack = candidates.slack[body]
    if body < PALM_BODY:
        candidates.least[body] = _measure_part(mesh, hand, pose, body, candidates, slack)
        candidates.count[body] = _measured_count(candidates, body)
        return float(candidates.least[body])
    least, count = np.inf, 0
    for part in range(PALM_BODY, PALM_BODY + hand.palm_radius.shape[0]):
        candidates.least[part] = np.inf
        if _pair_count(candidates, part) > 0:
            candidates.least[part] = _measure_part(mesh, hand, pose, part, candidates, slack + candidates.spare[part])
            count += _measured_count(candidates, part)
            least = min(least, candidates.least[part])
    candidates.count[PALM_BODY] = count
    return least


@jit
def _within_part(hand: HandArrays, candidates: Record, part: int, limit: float) -> int:
    start, measured = _start(hand, part), candidates.measured[part]
    within = _count_within(candidates.face_distance[:], start, start + measured[0], limit)
    within += _count_within(candidates.edge_distance[:], start, start + measured[1], limit)
    return within + _count_within(candidates.vertex_distance[:], start, start + measured[2], limit)


@pairs_within.of(MeshFeatures)
@jit
def _within(mesh: MeshFeatures, hand: HandArrays, candidates: Record, body: int, limit: float) -> int:
    if body < PALM_BODY:
        return _within_part(hand, candidates, body, limit)
    within = 0
    for part in range(PALM_BODY, PALM_BODY + hand.palm_radius.shape[0]):
        if candidates.least[part] <= limit:
            within += _within_part(hand, candidates, part, limit)
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
    # What all rows of a part share is written once, in `_record_part`.
    contacts.key[row] = key
    for j in range(3):
        contacts.normal[j, row] = normal[j]
        contacts.point[j, row] = place[j] - radius * normal[j]
        contacts.straight[j, row] = 0.0
    contacts.hand_radius[row] = radius
    contacts.distance[row] = distance
    contacts.object_radius[row] = object_radius
    contacts.slides[row] = 0


@jit_once
def _face_rows(
    mesh: MeshFeatures,
    candidates: Record,
    start: int,
    stop: int,
    cone: RoundCone,
    limit: float,
    first_key: int,
    row: int,
    contacts: Record,
) -> int:
    ends = 2 if cone.length > 0.0 else 1
    face, index, distance = mesh.face, candidates.face, candidates.face_distance
    for i in range(start, stop):
        if distance[i] > limit:
            continue
        f = index[i]
        nx, ny, nz = face[f, 0], face[f, 1], face[f, 2]
        for end in range(ends):
            s = end * cone.length
            x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
            radius = cone.radius - end * cone.drop
            height = nx * x + ny * y + nz * z - face[f, 3]
            if abs(height) - radius > limit:
                continue
            if not above(face, f, x, y, z):
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
    # Brings a unit vector that is a little beyond one side of a normal cone into it: whether it is in now, the side
    # that it was beyond, -1 for none, and the vector.
    side, over = -1, 0.0
    for w in range(start, stop):
        lean = nx * directions[w, 0] + ny * directions[w, 1] + nz * directions[w, 2]
        if lean > NEAR_CONE or (lean > ALONG and side >= 0):
            return False, side, (nx, ny, nz)
        # What was brought to the border by the last step stays there: rounding must not choose its curvature.
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


@jit
def _goes_on(mesh: MeshFeatures, first: int, x: float, y: float, z: float) -> bool:
    # Whether a place is above or below a face, or one of those that go on in its plane.
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


@jit_once
def _edge_rows(
    mesh: MeshFeatures,
    candidates: Record,
    start: int,
    stop: int,
    cone: RoundCone,
    limit: float,
    first_key: int,
    row: int,
    contacts: Record,
) -> int:
    tries = 3 if cone.length > 0.0 else 1
    edge, index, distance, parameter = (
        mesh.edge,
        candidates.edge,
        candidates.edge_distance,
        candidates.edge_parameter,
    )
    end_distance = candidates.edge_end
    slope = cone.drop * cone.inverse_length
    for i in range(start, stop):
        # Where the nearest point of the axis is beyond the edge, an end of it may still be over it.
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
            key = first_key + 3 * (mesh.face.shape[0] + e) + which
            _write(contacts, row, (x, y, z), normal, radius, away - radius, 0.0 if side < 0 else FLAT, key)
            if side < 0:
                contacts.straight[0, row] = wx
                contacts.straight[1, row] = wy
                contacts.straight[2, row] = wz
                contacts.slides[row] = 1 if which == 0 and 0.0 < s < cone.length else 0
            row += 1
    return row


@jit
def _across(wx: float, wy: float, wz: float) -> tuple[float, float, float]:
    # Some unit vector across w: where an axis meets an edge every direction is as good.
    if abs(wx) <= abs(wy):
        scale = 1.0 / math.sqrt(wy * wy + wz * wz)
        return (0.0, wz * scale, -wy * scale)
    scale = 1.0 / math.sqrt(wx * wx + wz * wz)
    return (-wz * scale, 0.0, wx * scale)


@jit
def _is_of_edge(mesh: MeshFeatures, e: int, cone: RoundCone, x: float, y: float, z: float) -> bool:
    # Whether a place of an axis is beside an edge, and no other place is nearest to it that lies between the ends of
    # both: the axis would touch there alone, and the edge has a row of its own for it.
    edge = mesh.edge
    wx, wy, wz, extent = edge[e, 3], edge[e, 4], edge[e, 5], edge[e, 6]
    bx, by, bz = edge[e, 0], edge[e, 1], edge[e, 2]
    if not -ON <= (x - bx) * wx + (y - by) * wy + (z - bz) * wz <= extent + ON:
        return False
    _, s, foot = line_witness(cone, cone.x - bx, cone.y - by, cone.z - bz, wx, wy, wz)
    return not (0.0 < s < cone.length and 0.0 < foot < extent)


@jit_once
def _vertex_rows(
    mesh: MeshFeatures,
    candidates: Record,
    start: int,
    stop: int,
    cone: RoundCone,
    limit: float,
    first_key: int,
    row: int,
    contacts: Record,
) -> int:
    vertex, index, distance, parameter = (
        mesh.vertex,
        candidates.vertex,
        candidates.vertex_distance,
        candidates.vertex_parameter,
    )
    slope = cone.drop * cone.inverse_length
    before = mesh.face.shape[0] + mesh.edge.shape[0]
    for i in range(start, stop):
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
        key = first_key + 3 * (before + v)
        _write(contacts, row, (x, y, z), normal, radius, away - radius, 0.0, key)
        if side < 0:
            contacts.slides[row] = 1 if 0.0 < s < cone.length else 0
        else:
            # There the object is the edge along that spoke.
            for j in range(3):
                contacts.straight[j, row] = mesh.spoke[side, j]
        row += 1
    return row


@jit
def _record_part(
    mesh: MeshFeatures,
    hand: HandArrays,
    pose: Record,
    part: int,
    candidates: Record,
    limit: float,
    row: int,
    contacts: Record,
) -> int:
    start, cone = _start(hand, part), _cone(hand, pose, part)
    features = mesh.face.shape[0] + mesh.edge.shape[0] + mesh.vertex.shape[0]
    key = 3 * features * part
    first, measured = row, candidates.measured[part]
    row = _face_rows(mesh, candidates, start, start + measured[0], cone, limit, key, row, contacts)
    if row >= 0:
        row = _edge_rows(mesh, candidates, start, start + measured[1], cone, limit, key, row, contacts)
    if row >= 0:
        row = _vertex_rows(mesh, candidates, start, start + measured[2], cone, limit, key, row, contacts)
    for i in range(first, row):
        contacts.body[i] = min(part, PALM_BODY)
    return row


@record_pairs.of(MeshFeatures)
@jit
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
    if body < PALM_BODY:
        return _record_part(mesh, hand, pose, body, candidates, limit, row, contacts)
    for part in range(PALM_BODY, PALM_BODY + hand.palm_radius.shape[0]):
        if candidates.least[part] <= limit:
            row = _record_part(mesh, hand, pose, part, candidates, limit, row, contacts)
            if row < 0:
                return -1
    return row


@jit
def _contact(triangle: Triangle, cone: RoundCone, s: float, limit: float, row: int, pairs_out: ContactPoints) -> int:
    # The pair of a triangle and the ball at s of the axis.
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
    # Of each triangle where it is nearest to the axis, and at the ends of a phalanx, which may lie flat on it.
    spheres, stack = mesh.spheres, walk.stack
    clearance = np.inf
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        for i in range(BRANCHING):
            child, away = spheres.child[node, i], block_distance(spheres.block, node, i, cone)
            if away > limit:
                clearance = min(clearance, away)
                continue
            if child >= 0:
                stack[top] = child
                top += 1
                continue
            face = -1 - child
            distance, s = triangle_distance(mesh.corner, mesh.face, face, cone)
            if distance > limit:
                clearance = min(clearance, distance)
                continue
            c = mesh.corner[face]
            triangle = Triangle(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8])
            row = _contact(triangle, cone, s, limit, row, pairs_out)
            for end in (0.0, cone.length):
                if row >= 0 and end != s and cone.length > 0.0:
                    row = _contact(triangle, cone, end, limit, row, pairs_out)
            if row < 0:
                return -1, 0.0
    return row, clearance


@cone_distance.of(MeshFeatures)
@jit
def _cone_distance(mesh: MeshFeatures, cone: RoundCone, limit: float, stack: Indices) -> float:
    # Where something can be inside the nearest triangle is looked for however far it is: its side decides.
    spheres, signed = mesh.spheres, mesh.multiplicity.shape[0] > 0
    best = np.inf if signed else limit
    found, parameter = -1, 0.0
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        nearest = np.inf
        for i in range(BRANCHING):
            child, away = spheres.child[node, i], block_distance(spheres.block, node, i, cone)
            if not away <= best or away > 0.1 * NOWHERE:
                continue
            if child < 0:
                distance, s = triangle_distance(mesh.corner, mesh.face, -1 - child, cone)
                if distance < best:
                    best, found, parameter = distance, -1 - child, s
                continue
            stack[top] = child
            if nearest < away:
                # The nearest stays on top and is looked at first: the others may then be too far.
                stack[top], stack[top - 1] = stack[top - 1], stack[top]
            else:
                nearest = away
            top += 1
    if signed and found >= 0:
        c = mesh.corner[found]
        x, y, z = cone.x + parameter * cone.ux, cone.y + parameter * cone.uy, cone.z + parameter * cone.uz
        triangle = Triangle(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8])
        px, py, pz, square, feature = closest_on_triangle(x, y, z, triangle)
        behind = True
        # Only of the boundary of a solid does the nearest triangle tell the side.
        if mesh.pseudonormal.shape[0] > 0:
            n = mesh.pseudonormal[found, feature]
            behind = n[0] * (x - px) + n[1] * (y - py) + n[2] * (z - pz) < 0.0
        if behind and is_surrounded(spheres, mesh.corner, mesh.multiplicity, x, y, z, stack):
            best -= 2.0 * math.sqrt(square)
    return min(best, limit)


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
