"""Edges of two bodies against each other: what corners and faces leave of the contact of two polyhedra.

Two convex edges can touch at points inside of both only along n = ± a × b, a and b their directions, and only if n lies
between the outward normals of the one's faces and -n between those of the other's. Then d = n · (p - q) is their signed
distance, p and q the nearest points of their lines. Corners against faces are the surface's own pairs.

Near pairs are gathered with a skin and kept while the motion since then leaves it (`kernels.contact.detection`).
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.surface import write_contact
from hhsim.kernels.hand.kinematics import BOX_CORNERS, PALM_BODY, HandArrays
from hhsim.kernels.jit import Array, Record, Triple, as_int64, jit
from hhsim.kernels.rotation import turned

NEAR_EDGES = 2048
"""Room for near pairs of edges."""
DEEPEST = 5e-4
"""Depth [m] beyond which two edges are on opposite sides of a thin wall: no step leads so far in."""
PARALLEL_SINE = 1e-6
"""Edges with a smaller sine of their angle touch along their length, at corners."""
BEYOND_SINE = 0.02
"""Sine by which n may be beyond the normal of a face: where two faces lie on each other n is that of both, and a little
tilt says which of the crossings of their edges touch."""
EDGE_KEY = 1 << 30
"""Keys of pairs of edges begin here."""


@by_reference
class Edges(NamedTuple):
    """Convex edges of a body, about its centre of mass in the body's frame; none of a body of spheres."""

    start: Array  # first end [m], (E, 3)
    along: Array  # unit vector to the second one, (E, 3)
    length: Array  # [m], (E,)
    normal: Array  # outward, of both faces, (E, 2, 3)


EDGE_PAIRS = np.dtype(
    [
        ("count", np.int64),
        ("edge", np.int64, (NEAR_EDGES,)),  # edge of what moves
        ("other_edge", np.int64, (NEAR_EDGES,)),
        ("distance", np.float64, (NEAR_EDGES,)),  # [m], infinite where they cannot touch
        ("point", np.float64, (NEAR_EDGES, 3)),  # on the edge of what moves [m], frame of the body
        ("normal", np.float64, (NEAR_EDGES, 3)),  # from the body to what moves
        ("gathered_slack", np.float64),  # least distance of a pair that is not listed, when gathered [m]
        ("anchor", np.float64, (BOX_CORNERS, 3)),  # corners of the box around what moves then [m]
    ],
    align=True,
)
"""Near pairs of edges of two bodies."""


@jit
def _motion(mover: HandArrays, pose: Record, pairs: Record, keeps: bool) -> float:
    # The way of the farthest corner since the pairs were gathered; with `keeps` from now on.
    box, square = mover.palm_box, 0.0
    for i in range(BOX_CORNERS):
        x, y, z = turned(pose.rotation, box[i, 0], box[i, 1], box[i, 2])
        x, y, z = x + pose.position[0], y + pose.position[1], z + pose.position[2]
        anchor = pairs.anchor[i]
        square = max(square, (x - anchor[0]) ** 2 + (y - anchor[1]) ** 2 + (z - anchor[2]) ** 2)
        if keeps:
            anchor[0], anchor[1], anchor[2] = x, y, z
    return math.sqrt(square)


@jit
def _between(dx: float, dy: float, dz: float, e: Triple, g: Array, length: float, other_length: float) -> float:
    # Distance of two segments whose starts are (dx, dy, dz) apart, from the second one's to the first one's.
    ex, ey, ez = e
    b = ex * g[0] + ey * g[1] + ez * g[2]
    c, f = ex * dx + ey * dy + ez * dz, g[0] * dx + g[1] * dy + g[2] * dz
    denominator = 1.0 - b * b
    s = min(max((b * f - c) / denominator, 0.0), length) if denominator > PARALLEL_SINE * PARALLEL_SINE else 0.0
    t = b * s + f
    if t < 0.0 or t > other_length:
        t = min(max(t, 0.0), other_length)
        s = min(max(b * t - c, 0.0), length)
    x, y, z = dx + s * ex - t * g[0], dy + s * ey - t * g[1], dz + s * ez - t * g[2]
    return math.sqrt(x * x + y * y + z * z)


@jit
def _gather(edges: Edges, others: Edges, center: Array, pose: Record, far: float, pairs: Record) -> None:
    position, r = pose.position, pose.rotation
    found, beyond = as_int64(NEAR_EDGES + 1), np.inf
    while found > NEAR_EDGES:
        found, beyond = as_int64(0), np.inf
        for i in range(edges.length.shape[0]):
            x, y, z = turned(r, edges.start[i, 0], edges.start[i, 1], edges.start[i, 2])
            x, y, z = x + position[0] - center[0], y + position[1] - center[1], z + position[2] - center[2]
            e = turned(r, edges.along[i, 0], edges.along[i, 1], edges.along[i, 2])
            for j in range(others.length.shape[0]):
                q, g, length = others.start[j], others.along[j], others.length[j]
                # Balls around both first: most pairs are far.
                h, k = 0.5 * edges.length[i], 0.5 * length
                ux, uy = x + h * e[0] - q[0] - k * g[0], y + h * e[1] - q[1] - k * g[1]
                uz = z + h * e[2] - q[2] - k * g[2]
                bound = math.sqrt(ux * ux + uy * uy + uz * uz) - h - k
                if bound > far:
                    beyond = min(beyond, bound)
                    continue
                distance = _between(x - q[0], y - q[1], z - q[2], e, g, edges.length[i], length)
                if distance > far:
                    beyond = min(beyond, distance)
                else:
                    if found < NEAR_EDGES:
                        pairs.edge[found], pairs.other_edge[found] = i, j
                    found += 1
        if found > NEAR_EDGES:
            far *= 0.5
    pairs.count = found
    pairs.gathered_slack = beyond


@jit
def _is_between(nx: float, ny: float, nz: float, e: Triple, first: Triple, second: Triple) -> bool:
    # Whether n, at right angles to e, lies between two other such vectors, or hardly beyond one.
    ex, ey, ez = e
    (ax, ay, az), (bx, by, bz) = first, second
    volume = ex * (ay * bz - az * by) + ey * (az * bx - ax * bz) + ez * (ax * by - ay * bx)
    past_first = ex * (ay * nz - az * ny) + ey * (az * nx - ax * nz) + ez * (ax * ny - ay * nx)
    before_second = ex * (ny * bz - nz * by) + ey * (nz * bx - nx * bz) + ez * (nx * by - ny * bx)
    # More than half a turn away both have the right sign too, but n is on the other side.
    side = nx * (ax + bx) + ny * (ay + by) + nz * (az + bz)
    sign = 1.0 if volume >= 0.0 else -1.0
    return sign * past_first >= -BEYOND_SINE and sign * before_second >= -BEYOND_SINE and side > 0.0


@jit
def _measure(edges: Edges, others: Edges, center: Array, pose: Record, pair: int, pairs: Record) -> float:
    i, j, r = pairs.edge[pair], pairs.other_edge[pair], pose.rotation
    ex, ey, ez = turned(r, edges.along[i, 0], edges.along[i, 1], edges.along[i, 2])
    gx, gy, gz = others.along[j, 0], others.along[j, 1], others.along[j, 2]
    nx, ny, nz = ey * gz - ez * gy, ez * gx - ex * gz, ex * gy - ey * gx
    sine = math.sqrt(nx * nx + ny * ny + nz * nz)
    if sine < PARALLEL_SINE:
        return np.inf
    n, scale = others.normal[j], 1.0 / sine
    if nx * (n[0, 0] + n[1, 0]) + ny * (n[0, 1] + n[1, 1]) + nz * (n[0, 2] + n[1, 2]) < 0.0:
        scale = -scale
    nx, ny, nz = scale * nx, scale * ny, scale * nz
    if not _is_between(nx, ny, nz, (gx, gy, gz), (n[0, 0], n[0, 1], n[0, 2]), (n[1, 0], n[1, 1], n[1, 2])):
        return np.inf
    n = edges.normal[i]
    first, second = turned(r, n[0, 0], n[0, 1], n[0, 2]), turned(r, n[1, 0], n[1, 1], n[1, 2])
    if not _is_between(-nx, -ny, -nz, (ex, ey, ez), first, second):
        return np.inf
    x, y, z = turned(r, edges.start[i, 0], edges.start[i, 1], edges.start[i, 2])
    x, y, z = x + pose.position[0], y + pose.position[1], z + pose.position[2]
    q = others.start[j]
    dx, dy, dz = x - center[0] - q[0], y - center[1] - q[1], z - center[2] - q[2]
    b = ex * gx + ey * gy + ez * gz
    c, f = ex * dx + ey * dy + ez * dz, gx * dx + gy * dy + gz * dz
    s = (b * f - c) / (sine * sine)
    t = b * s + f
    if not (0.0 <= s <= edges.length[i] and 0.0 <= t <= others.length[j]):
        return np.inf
    distance = nx * dx + ny * dy + nz * dz
    if distance < -DEEPEST:
        return np.inf
    point, normal = pairs.point[pair], pairs.normal[pair]
    point[0], point[1], point[2] = x + s * ex, y + s * ey, z + s * ez
    normal[0], normal[1], normal[2] = nx, ny, nz
    return distance


@jit
def measure_edges(
    mover: HandArrays, edges: Edges, others: Edges, center: Array, far: float, state: Record, pairs: Record
) -> None:
    """Compute the signed distances of the near pairs of edges, and take them into those of the state's candidates.

    `edges` are those of what moves, as a palm, at a pose at which these were measured; `others` those of the body whose
    frame it is in, with its centre of mass there [m]. Pairs up to what its candidates need are to be listed, and up to
    `far` [m] are gathered.
    """
    pose, candidates = state.pose, state.candidates
    if edges.length.shape[0] == 0 or others.length.shape[0] == 0:
        return
    slack = pairs.gathered_slack - _motion(mover, pose, pairs, False)
    if not slack >= candidates.needed:
        _motion(mover, pose, pairs, True)
        _gather(edges, others, center, pose, far, pairs)
        slack = pairs.gathered_slack
    least = np.inf
    for i in range(pairs.count):
        pairs.distance[i] = _measure(edges, others, center, pose, i, pairs)
        least = min(least, pairs.distance[i])
    candidates.nearest[PALM_BODY] = min(candidates.nearest[PALM_BODY], least)
    candidates.slack[PALM_BODY] = min(candidates.slack[PALM_BODY], slack)


@jit
def record_edges(others: Edges, margin: float, pairs: Record, contacts: Record) -> None:
    """Add the pairs of edges up to `margin` [m] to the contact records, as far as there is room."""
    row = contacts.start[1]
    for i in range(pairs.count):
        if pairs.distance[i] <= margin and row < contacts.key.shape[0]:
            p, n, key = pairs.point[i], pairs.normal[i], pairs.edge[i] * others.length.shape[0] + pairs.other_edge[i]
            point, normal = (p[0], p[1], p[2]), (n[0], n[1], n[2])
            write_contact(contacts, row, point, normal, pairs.distance[i], (0.0, 0.0), EDGE_KEY + key)
            contacts.body[row] = PALM_BODY
            row += 1
    for owner in range(1, contacts.start.shape[0]):
        contacts.start[owner] = row
