"""Distances of a round cone to features of a mesh, and how often closed triangles wind around a point.

Signed distances of a round cone to vertices, edges and faces of a mesh, in closed form.

A round cone is the union of the spheres with centre x(s) on its axis and radius r(s) = r_a - k s, 0 <= s <= l, here
with s in metres. Its distance to a convex piece of the mesh is convex in s, so that there is one minimum.

Vertex: as a sphere of radius 0 (`kernels.round_cone`). Edge: without the component along the edge the axis is
a straight line q(s) = q_0 + s q_1 in a plane, and |q(s)| + k s is least at

    s = s_0 - k h / sqrt(q (q - k²)),   s_0 = -q_0 · q_1 / q,   q = |q_1|²,   h = |q_0 + s_0 q_1|,

or, where q <= k², at the large end. The minimum counts where its foot lies on the edge; beyond it, it is a vertex's.
Face: along its normal the distance is linear in s, so that an end is nearest; it counts where the end lies above the
inside of the face. If a body's witness does not lie on the feature the distance is `ELSEWHERE`.

Winding number of closed triangles around a point, counted along rays.

It is the number of triangles that a ray leaves through less those it enters through. It is needed where the nearest
triangle says inside, which holds only if no triangles cut through each other (Bærentzen and Aanæs, 2005). A ray that
meets an edge may count wrong; so three of them vote.
"""

import math

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_inline
from hhsim.kernels.mesh.features import FACE_FIELDS, MeshFeatures
from hhsim.kernels.round_cone import RoundCone
from hhsim.kernels.sphere_tree import TreeArrays, node_distance
from hhsim.kernels.triangle import ray_crossing

ELSEWHERE = 1e300
"""Distance to a feature whose nearest point belongs to another one [m]."""
ON = 1e-9
"""Distance beyond the end of an edge, or at most the side of a face, at which a foot still lies on it [m]: there are
no gaps between features."""
PARALLEL = 1e-25
"""Squared sine of an angle under which axis and edge are parallel: the minimum on the axis is rounding, of 1e-14 m."""


@jit_inline
def vertex_witness(cone: RoundCone, dx: float, dy: float, dz: float) -> tuple[float, float]:
    """Compute (distance, s) [m] of a round cone and the vertex at a + (dx, dy, dz)."""
    if cone.length == 0.0:
        return math.sqrt(dx * dx + dy * dy + dz * dz) - cone.radius, 0.0
    t = dx * cone.ux + dy * cone.uy + dz * cone.uz
    px, py, pz = dx - t * cone.ux, dy - t * cone.uy, dz - t * cone.uz
    h2 = px * px + py * py + pz * pz
    s = t - math.sqrt(h2) * cone.tan_slope
    s = 0.0 if s < 0.0 else s
    s = cone.length if s > cone.length else s
    return math.sqrt(h2 + (t - s) * (t - s)) - cone.radius + cone.drop * cone.inverse_length * s, s


@jit_inline
def line_witness(
    cone: RoundCone, dx: float, dy: float, dz: float, wx: float, wy: float, wz: float
) -> tuple[float, float, float]:
    """Compute (distance, s, foot) [m] of a round cone and the line along w through a - (dx, dy, dz), the foot's 0."""
    dw = dx * wx + dy * wy + dz * wz
    px, py, pz = dx - dw * wx, dy - dw * wy, dz - dw * wz
    if cone.length == 0.0:
        return math.sqrt(px * px + py * py + pz * pz) - cone.radius, 0.0, dw
    slope = cone.drop * cone.inverse_length
    uw = cone.ux * wx + cone.uy * wy + cone.uz * wz
    qx, qy, qz = cone.ux - uw * wx, cone.uy - uw * wy, cone.uz - uw * wz
    q = qx * qx + qy * qy + qz * qz
    crossing = q > slope * slope and q > PARALLEL
    nearest = -(px * qx + py * qy + pz * qz) / (q if crossing else 1.0)
    hx, hy, hz = px + nearest * qx, py + nearest * qy, pz + nearest * qz
    h = math.sqrt(hx * hx + hy * hy + hz * hz)
    s = nearest - slope * h / math.sqrt(q * (q - slope * slope) if crossing else 1.0)
    s = s if crossing else 0.0
    s = 0.0 if s < 0.0 else s
    s = cone.length if s > cone.length else s
    x, y, z = px + s * qx, py + s * qy, pz + s * qz
    return math.sqrt(x * x + y * y + z * z) - cone.radius + slope * s, s, dw + s * uw


@jit_inline
def edge_witness(
    cone: RoundCone, dx: float, dy: float, dz: float, wx: float, wy: float, wz: float, extent: float
) -> tuple[float, float]:
    """Compute (distance, s) [m] of a round cone and the edge along w whose first end is at a - (dx, dy, dz)."""
    distance, s, foot = line_witness(cone, dx, dy, dz, wx, wy, wz)
    return distance if foot >= -ON and foot <= extent + ON else ELSEWHERE, s


@jit_inline
def vertex_distance(vertex: Array, i: int, cone: RoundCone) -> tuple[float, float]:
    """Compute (distance, s) [m] of vertex i, shape (·, 3)."""
    return vertex_witness(cone, vertex[i, 0] - cone.x, vertex[i, 1] - cone.y, vertex[i, 2] - cone.z)


@jit_inline
def edge_distance(edge: Array, i: int, cone: RoundCone) -> tuple[float, float]:
    """Compute (distance, s) [m] of edge i, as of `EDGE_FIELDS`."""
    dx, dy, dz = cone.x - edge[i, 0], cone.y - edge[i, 1], cone.z - edge[i, 2]
    return edge_witness(cone, dx, dy, dz, edge[i, 3], edge[i, 4], edge[i, 5], edge[i, 6])


@jit_inline
def above(face: Array, i: int, x: float, y: float, z: float) -> bool:
    """Return True if a point lies above or below the inside of face i, as of `FACE_FIELDS`."""
    return bool(
        min(
            min(
                face[i, 4] * x + face[i, 5] * y + face[i, 6] * z - face[i, 7],
                face[i, 8] * x + face[i, 9] * y + face[i, 10] * z - face[i, 11],
            ),
            face[i, 12] * x + face[i, 13] * y + face[i, 14] * z - face[i, 15],
        )
        >= 0.0
    )


@jit_inline
def _height(face: Array, i: int, x: float, y: float, z: float) -> float:
    """Compute the distance [m] of a point from face i, `ELSEWHERE` unless it is above or below its inside."""
    height = abs(face[i, 0] * x + face[i, 1] * y + face[i, 2] * z - face[i, 3])
    return height if above(face, i, x, y, z) else ELSEWHERE


@jit_inline
def face_distance(face: Array, i: int, cone: RoundCone) -> float:
    """Compute the distance [m] of the inside of face i: of the nearer end of the axis that is above it."""
    ax, ay, az = cone.x, cone.y, cone.z
    bx, by, bz = ax + cone.length * cone.ux, ay + cone.length * cone.uy, az + cone.length * cone.uz
    first = _height(face, i, ax, ay, az) - cone.radius
    return min(first, _height(face, i, bx, by, bz) - cone.radius + cone.drop)


@jit
def triangle_distance(corner: Array, face: Array, i: int, cone: RoundCone) -> tuple[float, float]:
    """Compute the distance [m] of a round cone to triangle i with its sides and corners, and s [m] on the axis.

    Unsigned but for the radius: where the axis goes through the triangle, minus the radius there. Corners are a, b, c
    [m], shape (F, 9), faces as of `FACE_FIELDS`.
    """
    place, plane = corner[i], face[i]
    best, parameter = ELSEWHERE, 0.0
    for k in range(3):
        p, q = 3 * k, 3 * ((k + 1) % 3)
        dx, dy, dz = cone.x - place[p], cone.y - place[p + 1], cone.z - place[p + 2]
        distance, s = vertex_witness(cone, -dx, -dy, -dz)
        if distance < best:
            best, parameter = distance, s
        wx, wy, wz = place[q] - place[p], place[q + 1] - place[p + 1], place[q + 2] - place[p + 2]
        extent = math.sqrt(wx * wx + wy * wy + wz * wz)
        if extent == 0.0:
            continue
        scale = 1.0 / extent
        distance, s = edge_witness(cone, dx, dy, dz, wx * scale, wy * scale, wz * scale, extent)
        if distance < best:
            best, parameter = distance, s
    slope = cone.drop * cone.inverse_length
    rise = plane[0] * cone.ux + plane[1] * cone.uy + plane[2] * cone.uz
    height = plane[0] * cone.x + plane[1] * cone.y + plane[2] * cone.z - plane[3]
    # The two ends, and where the axis goes through.
    for which in range(3):
        s = cone.length if which == 1 else 0.0
        if which == 2:
            if not abs(rise) > slope:
                continue
            s = -height / rise
            if not 0.0 < s < cone.length:
                continue
        x, y, z = cone.x + s * cone.ux, cone.y + s * cone.uy, cone.z + s * cone.uz
        if above(face, i, x, y, z):
            distance = abs(height + s * rise) - cone.radius + slope * s
            if distance < best:
                best, parameter = distance, s
    return best, parameter


@jit_inline
def _beside(edge: Array, i: int, dx: float, dy: float, dz: float) -> float:
    """Compute the distance [m] of a point (dx, dy, dz) from the start of edge i, `ELSEWHERE` beyond its ends."""
    wx, wy, wz = edge[i, 3], edge[i, 4], edge[i, 5]
    foot = dx * wx + dy * wy + dz * wz
    px, py, pz = dx - foot * wx, dy - foot * wy, dz - foot * wz
    away = math.sqrt(px * px + py * py + pz * pz)
    return away if foot >= -ON and foot <= edge[i, 6] + ON else ELSEWHERE


@jit_inline
def edge_end_distance(edge: Array, i: int, cone: RoundCone) -> float:
    """Compute the distance [m] of edge i from the nearer end of a phalanx's axis that is over it."""
    dx, dy, dz = cone.x - edge[i, 0], cone.y - edge[i, 1], cone.z - edge[i, 2]
    first = _beside(edge, i, dx, dy, dz) - cone.radius
    dx, dy, dz = dx + cone.length * cone.ux, dy + cone.length * cone.uy, dz + cone.length * cone.uz
    return min(first, _beside(edge, i, dx, dy, dz) - cone.radius + cone.drop)


@jit_inline
def face_distances(face: Array, start: int, stop: int, cone: RoundCone, distance_out: Array) -> None:
    """Compute `face_distance` of faces start to stop - 1 on the vector unit: each field is contiguous."""
    # Signed indices would be checked for negative values, which keeps the loop off the vector unit.
    for i in range(np.uint64(start), np.uint64(stop)):
        distance_out[i] = face_distance(face, i, cone)


@jit_inline
def edge_distances(
    edge: Array, start: int, stop: int, cone: RoundCone, distance_out: Array, parameter_out: Array, end_out: Array
) -> None:
    """Compute `edge_distance` and `edge_end_distance` of edges start to stop - 1."""
    for i in range(np.uint64(start), np.uint64(stop)):
        distance_out[i], parameter_out[i] = edge_distance(edge, i, cone)
        end_out[i] = edge_end_distance(edge, i, cone)


@jit_inline
def vertex_distances(
    vertex: Array, start: int, stop: int, cone: RoundCone, distance_out: Array, parameter_out: Array
) -> None:
    """Compute `vertex_distance` of vertices start to stop - 1."""
    for i in range(np.uint64(start), np.uint64(stop)):
        distance_out[i], parameter_out[i] = vertex_distance(vertex, i, cone)


@jit_inline
def face_bounds(face: Array, i: int, cone: RoundCone, one_sided: bool) -> tuple[float, float]:
    """Compute the least motions [m] by which a round cone can touch triangle i, and the inside of its face.

    The first by plane and sides; for the second an end of the axis must also come above the face, and from outside if
    `one_sided`. (Sides and corners are met from behind too, through the faces that share them.)
    """
    nx, ny, nz, height = face[i, 0], face[i, 1], face[i, 2], face[i, 3]
    ax, ay, az, radius, drop = cone.x, cone.y, cone.z, cone.radius, cone.drop
    bx, by, bz = ax + cone.length * cone.ux, ay + cone.length * cone.uy, az + cone.length * cone.uz
    first = nx * ax + ny * ay + nz * az - height
    second = nx * bx + ny * by + nz * bz - height
    over = min(first - radius, second - radius + drop)
    under = min(-first - radius, -second - radius + drop)
    bound = max(over, under)
    behind = -max(first, second) if one_sided else -ELSEWHERE
    first_beside, second_beside = -ELSEWHERE, -ELSEWHERE
    for k in range(4, FACE_FIELDS, 4):
        mx, my, mz, side = face[i, k], face[i, k + 1], face[i, k + 2], face[i, k + 3]
        first_out, second_out = side - mx * ax - my * ay - mz * az, side - mx * bx - my * by - mz * bz
        bound = max(bound, min(first_out - radius, second_out - radius + drop))
        first_beside, second_beside = max(first_beside, first_out), max(second_beside, second_out)
    return bound, max(max(bound, behind), min(first_beside, second_beside))


@jit_inline
def _outside_normals(
    directions: Array, start: int, stop: int, cone: RoundCone, dx: float, dy: float, dz: float
) -> float:
    """Compute the least motion [m] that brings a point of an axis into the normal cone of an edge or vertex.

    `directions[start:stop]` lead from the feature into its faces or along its edges; the axis begins at (dx, dy, dz)
    from it.
    """
    most = -ELSEWHERE
    for w in range(start, stop):
        first = dx * directions[w, 0] + dy * directions[w, 1] + dz * directions[w, 2]
        rise = cone.length * (cone.ux * directions[w, 0] + cone.uy * directions[w, 1] + cone.uz * directions[w, 2])
        most = max(most, first + min(0.0, rise))
    return most


@jit_inline
def edge_bound(mesh: MeshFeatures, i: int, cone: RoundCone, tolerance: float, reach: float) -> float:
    """Compute the least motion [m] by which a round cone can touch the inside of edge i.

    By its normal cone, widened by `tolerance` [m], and, unless that is beyond `reach` [m], by its line and its ends.
    """
    edge, start, stop = mesh.edge, mesh.wing_start[i], mesh.wing_start[i + 1]
    dx, dy, dz = cone.x - edge[i, 0], cone.y - edge[i, 1], cone.z - edge[i, 2]
    out = _outside_normals(mesh.wing, start, stop, cone, dx, dy, dz) - tolerance
    if out > reach:
        return out
    wx, wy, wz, extent = edge[i, 3], edge[i, 4], edge[i, 5], edge[i, 6]
    line, _, _ = line_witness(cone, dx, dy, dz, wx, wy, wz)
    dw = dx * wx + dy * wy + dz * wz
    uw = cone.length * (cone.ux * wx + cone.uy * wy + cone.uz * wz)
    beyond = max(-max(dw, dw + uw), min(dw, dw + uw) - extent)
    return max(max(line, beyond - ON), out)


@jit_inline
def vertex_bound(mesh: MeshFeatures, i: int, cone: RoundCone, tolerance: float) -> float:
    """Compute the least motion [m] to touch vertex i by distance, and by its normal cone widened by `tolerance` [m]."""
    vertex, start, stop = mesh.vertex, mesh.spoke_start[i], mesh.spoke_start[i + 1]
    distance, _ = vertex_distance(vertex, i, cone)
    dx, dy, dz = cone.x - vertex[i, 0], cone.y - vertex[i, 1], cone.z - vertex[i, 2]
    return max(distance, _outside_normals(mesh.spoke, start, stop, cone, dx, dy, dz) - tolerance)


DIRECTIONS = ((9 / 25, 12 / 25, 20 / 25), (-96 / 125, 75 / 125, 28 / 125), (2 / 7, -6 / 7, -3 / 7))
"""Unit vectors, none along an axis or in a coordinate plane."""


@jit
def is_surrounded(
    tree: TreeArrays, corner: Array, multiplicity: Indices, x: float, y: float, z: float, stack: Indices
) -> bool:
    """Return True if closed triangles of `MeshFeatures` surround a point [m]; `stack` has shape (STACK_SIZE,)."""
    away = math.sqrt((tree.x[0] - x) ** 2 + (tree.y[0] - y) ** 2 + (tree.z[0] - z) ** 2)
    length = 2.0 * (away + tree.radius[0])
    votes = 0
    for dx, dy, dz in DIRECTIONS:
        ray = RoundCone(x, y, z, dx, dy, dz, length, 0.0, 1.0 / length, 0.0, 0.0)
        times = 0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not node_distance(tree, ray, node) <= 0.0:
                continue
            below = tree.first_child[node]
            for child in range(below, below + tree.child_count[node]):
                stack[top] = child
                top += 1
            if below < 0:
                along, facing = ray_crossing(corner[-1 - below], x, y, z, dx, dy, dz)
                if along > 0.0:
                    times += multiplicity[-1 - below] * (-1 if facing > 0.0 else 1)
        votes += 1 if times > 0 else 0
    return votes >= 2
