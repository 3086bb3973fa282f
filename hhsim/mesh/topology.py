"""Topology of triangles: shared vertices, edges, parts, boundary loops, winding."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, FloatArray, IntArray
from hhsim.reproducible import across, matmul, norm

if TYPE_CHECKING:
    from manifold3d import Manifold

FLAT = 1.0 - 1e-6
"""Cosine of the angle between the normals of two triangles from which on they lie in a plane."""
SHARP = 0.99
"""Negative cosine of the angle between the normals of two neighbours from which on one may be folded over the other."""


class Shell(NamedTuple):
    """Solid and sheets of a mesh whose triangles are covered as a skin, see `hhsim.mesh.own_triangles`."""

    vertices: FloatArray  # of the solid [m], shape (W, 3)
    faces: IntArray  # around the inside, outward, corner indices in these vertices, shape (K, 3), none for no inside
    sheets: IntArray  # triangles that both sides count of, corner indices in the mesh, shape (S, 3)


def distinct_rows(rows: AnyArray) -> tuple[IntArray, IntArray]:
    """Find equal rows of a table without NaN, shape (N, M); as `numpy.unique` along an axis, in a third of its time.

    Returns the first row of each kind, in the order of their values, and the kind of each row, shape (N,).
    """
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    kind = np.empty(len(rows), dtype=np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def merged_vertices(vertices: FloatArray, faces: IntArray, distance: float = 0.0) -> tuple[FloatArray, IntArray]:
    """Merge vertices (V, 3) [m] at most a distance apart, and chains of them; drop those that no face (F, 3) names.

    The vertices are in the order of their first use.
    """
    vertices = vertices + 0.0  # -0.0 and 0.0 are one place
    place: IntArray
    if distance > 0.0:
        from scipy.spatial import cKDTree

        pairs = cKDTree(vertices).query_pairs(distance, output_type="ndarray")
        place = _components(len(vertices), pairs[:, 0], pairs[:, 1])
    else:
        place = distinct_rows(vertices)[1]
    used = place[faces].ravel()
    _, first, index = np.unique(used, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    return vertices[faces.ravel()[first[order]]], np.argsort(order)[index].reshape(-1, 3)


def used_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Drop the vertices that no face names; the others keep their order."""
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int64)


def in_fixed_order(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Sort vertices by (z, y, x), start each face at its lowest index, sort the faces; the surface stays the same."""
    order = np.lexsort(vertices.T)
    faces = np.argsort(order)[faces]
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return vertices[order], faces[np.lexsort(faces.T[::-1])]


def directed_edges(faces: IntArray) -> IntArray:
    """Start and end of the three edges of each face, face by face, shape (3F, 2)."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def undirected_edges(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Group the directed edges by their pair of vertices.

    Returns the index of the undirected edge of each directed one, shape (3F,); the number of faces of each undirected
    edge, shape (E,); and its forward minus its backward directed edges, shape (E,): 0 where the surface is closed and
    wound alike.
    """
    edges = directed_edges(faces)
    forward = edges[:, 0] < edges[:, 1]
    index = distinct_rows(np.sort(edges, axis=1))[1]
    count = np.bincount(index)
    balance = np.bincount(index, weights=np.where(forward, 1.0, -1.0)).astype(np.int64)
    return index, count, balance


def is_closed(faces: IntArray) -> bool:
    """Return True if each edge occurs as often forward as backward: no boundary, all faces wound alike."""
    return bool(np.all(undirected_edges(faces)[2] == 0))


def part_labels(faces: IntArray) -> IntArray:
    """Return the connected part of each face, through edges that exactly two faces share, shape (F,)."""
    first, second, _ = _neighbours(faces)
    return _components(len(faces), first, second)


def _components(count: int, first: IntArray, second: IntArray) -> IntArray:
    """Return the connected component of each of `count` nodes, numbered by their first nodes, by links (L,), (L,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)


def _neighbours(faces: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Pairs of faces that share an edge that no third face has, and True where the two are wound alike."""
    index, count, balance = undirected_edges(faces)
    paired = np.flatnonzero(count[index] == 2)
    paired = paired[np.argsort(index[paired], kind="stable")]
    first, second = paired[0::2], paired[1::2]
    return first // 3, second // 3, balance[index[first]] == 0


def alike_wound(faces: IntArray) -> tuple[IntArray, int, bool]:
    """Turn faces (F, 3) until neighbours are wound alike, the minority of each part; a one-sided part stays as it is.

    Also returns how many were turned, and True if a part is one-sided.
    """
    first, second, alike = _neighbours(faces)
    if alike.all():
        return faces, 0, False
    count = len(faces)
    # Each face as it is, and turned, number i + F: what is joined is wound alike.
    other = np.where(alike, second, second + count)
    side = _components(
        2 * count, np.concatenate([first, first + count]), np.concatenate([other, (other + count) % (2 * count)])
    )
    part = _components(count, first, second)
    one_sided = side[:count] == side[count:]
    turned = side[:count] != side[np.unique(part, return_index=True)[1]][part]
    minority = np.bincount(part, weights=turned) * 2.0 > np.bincount(part)
    turned ^= minority[part]
    result = faces.copy()
    result[turned] = result[turned][:, ::-1]
    return result, int(turned.sum()), bool(one_sided.any())


def boundary_loops(faces: IntArray) -> list[IntArray]:
    """Return closed walks along the edges that only one face has, in the direction of that face.

    Two loops that touch in a vertex are separate. Edges that cannot be joined to a loop are left out.
    """
    index, count, _ = undirected_edges(faces)
    onward: dict[int, list[int]] = {}
    for start, end in directed_edges(faces)[count[index] == 1].tolist():
        onward.setdefault(start, []).append(end)
    loops: list[IntArray] = []
    for seed in sorted(onward):
        while onward[seed]:
            path = [seed]
            place = {seed: 0}
            while onward.get(path[-1]):
                step = onward[path[-1]].pop()
                if step in place:
                    at = place[step]
                    loops.append(np.array(path[at:], dtype=np.int64))
                    for vertex in path[at + 1 :]:
                        del place[vertex]
                    del path[at + 1 :]
                    if not onward.get(path[-1]):
                        break
                else:
                    place[step] = len(path)
                    path.append(step)
    return loops


class HoleCaps(NamedTuple):
    """Triangles that close every boundary loop of a surface."""

    vertices: FloatArray  # the surface's vertices, then the centres of fans, shape (V + fans, 3)
    faces: IntArray  # the caps alone, wound as the faces around them, shape (C, 3)
    width: FloatArray  # longest extent of each hole in its plane, shape (H,)
    bend: FloatArray  # largest distance of each hole's edge from its plane, shape (H,)


def hole_caps(vertices: FloatArray, faces: IntArray) -> HoleCaps:
    """Cap each boundary loop of vertices (V, 3) and faces (F, 3).

    A cap is a fan about the loop's centroid where that folds nowhere in the loop's plane, else it is cut into ears.
    """
    caps, centers, widths, bends = list[IntArray](), list[FloatArray](), list[float](), list[float]()
    for loop in boundary_loops(faces):
        ring = vertices[loop]
        center = ring.mean(axis=0)
        offset = ring - center
        # The plane of least squares: the first two right singular vectors span it, the third is its normal.
        axes = np.linalg.svd(offset, full_matrices=False)[2]
        flat = offset @ axes[:2].T
        following = np.roll(flat, -1, axis=0)
        turn = flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]
        widths.append(float(np.ptp(flat[:, 0])))
        bends.append(float(np.abs(offset @ axes[2]).max()))
        if len(loop) == 3:
            caps.append(loop[::-1][None])
        elif (turn > 0.0).all() or (turn < 0.0).all():
            # The centroid sees each edge from the same side.
            index = len(vertices) + len(centers)
            caps.append(np.stack([np.full(len(loop), index), np.roll(loop, -1), loop], axis=1))
            centers.append(center)
        else:
            caps.append(_ears(loop, flat, float(turn.sum()) > 0.0))
    return HoleCaps(
        np.concatenate([vertices, np.array(centers).reshape(-1, 3)]),
        np.concatenate([np.empty((0, 3), dtype=np.int64), *caps]),
        np.array(widths),
        np.array(bends),
    )


def _ears(loop: IntArray, flat: FloatArray, forward: bool) -> IntArray:
    """Triangles between a loop's own vertices, wound against the loop, which turns forward in its plane or not."""
    from manifold3d import triangulate

    order = np.arange(len(loop)) if forward else np.arange(len(loop))[::-1]
    triangles = loop[order][np.asarray(triangulate([np.ascontiguousarray(flat[order])]), dtype=np.int64)]
    return triangles[:, ::-1] if forward else triangles


def polygon_triangles(vertices: FloatArray, corners: IntArray, sizes: IntArray) -> IntArray:
    """Cut polygons into triangles, shape (F, 3), in their order and wound alike, `size` − 2 of each.

    A polygon becomes a fan about its first corner where that folds nowhere, else it is cut into ears. The corners
    (sum of sizes,) of all polygons (P,) are indices of vertices (V, 3), one polygon after the other.
    """
    begin = np.cumsum(sizes) - sizes
    found, owner = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        rings = corners[begin[which][:, None] + np.arange(size)]
        first = np.broadcast_to(rings[:, :1], (len(which), size - 2))
        fans = np.stack([first, rings[:, 1:-1], rings[:, 2:]], axis=2)
        if size > 3:
            a, b, c = (vertices[fans[:, :, k]] for k in range(3))
            normal = np.cross(b - a, c - a)
            whole = normal.sum(axis=1, keepdims=True)
            for polygon in np.flatnonzero(((normal * whole).sum(axis=2) < 0.0).any(axis=1)):
                cut = _cut(vertices, [rings[polygon]], whole[polygon])
                if len(cut) == size - 2:
                    fans[polygon] = cut
        found.append(fans.reshape(-1, 3))
        owner.append(np.repeat(which, size - 2))
    return np.concatenate(found)[np.argsort(np.concatenate(owner), kind="stable")]


def unfolded(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int, bool]:
    """Cut flat polygons anew whose triangles fold over each other, as a fan about a corner of a concave one does.

    Returns the faces, as many or fewer, the number of polygons, and True if others fold, or nearly, over a neighbour.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    size = np.linalg.norm(area, axis=1)
    normal = area / np.maximum(size, np.finfo(np.float64).tiny)[:, None]
    first, second, _ = _neighbours(faces)
    along = (normal[first] * normal[second]).sum(axis=1)
    flat, folds = np.abs(along) > FLAT, np.flatnonzero(along < -FLAT)
    patch = _components(len(faces), first[flat], second[flat]) if len(folds) else np.zeros(len(faces), np.int64)
    kept, new = np.ones(len(faces), np.bool_), list[IntArray]()
    for each in np.unique(patch[first[folds]]):
        own = patch == each
        whole, loops = area[own].sum(axis=0), boundary_loops(faces[own])
        if not loops or not norm(whole) > (1.0 - FLAT) * size[own].sum():
            continue
        cut = _cut(vertices, loops, whole)
        # Of a polygon that crosses itself the parts have more area than the whole.
        a, b, c = vertices[cut].transpose(1, 0, 2)
        if np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() < (2.0 - FLAT) * norm(whole):
            kept &= ~own
            new.append(cut)
    return np.concatenate([faces[kept], *new]), len(new), bool((along[kept[first]] < -SHARP).any())


def _cut(vertices: FloatArray, loops: list[IntArray], area: FloatArray) -> IntArray:
    """Triangles between the own vertices of loops around a polygon and its holes, wound alike; `area` is its vector."""
    from manifold3d import triangulate

    plane = across(area / norm(area))
    flat = [matmul(vertices[loop] - vertices[loops[0][0]], plane.T) for loop in loops]
    return np.concatenate(loops)[np.asarray(triangulate(flat), dtype=np.int64).reshape(-1, 3)]


def manifold_of(vertices: FloatArray, faces: IntArray) -> "Manifold | None":
    """Return vertices (V, 3) [m] and faces (F, 3) as a solid of manifold3d; None where they are no manifold."""
    from manifold3d import Error, Manifold, Mesh64

    solid = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
    return solid if solid.status() == Error.NoError else None


def triangles_of(solid: "Manifold") -> tuple[FloatArray, IntArray]:
    """Return the vertices (V, 3) [m] and faces (F, 3) of a solid of manifold3d."""
    mesh = solid.to_mesh64()
    vertices = np.ascontiguousarray(np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3])
    return vertices, np.asarray(mesh.tri_verts).astype(np.int64)


def face_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Area of each face [m²], shape (F,)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)


def signed_volume(vertices: FloatArray, faces: IntArray) -> float:
    """Volume [m³] that closed faces enclose, negative when they are wound inside out."""
    a, b, c = (vertices[faces] - vertices[faces].reshape(-1, 3).mean(axis=0)).transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def face_samples(
    vertices: FloatArray, faces: IntArray, count: int, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sample points on faces (F, 3) of vertices (V, 3), about `count` by area, and one more on each face with an area.

    Returns points, shape (n, 3), the face of each, shape (n,), in order, and the area that each stands for, shape (n,).
    """
    area = face_areas(vertices, faces)
    each = np.where(area > 0.0, 1 + np.floor(count * area / max(area.sum(), np.finfo(np.float64).tiny)), 0)
    face = np.repeat(np.arange(len(faces)), each.astype(np.int64))
    return random_points(vertices[faces[face]], rng), face, (area / np.maximum(each, 1))[face]


def random_points(triangles: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw a point on each triangle, shape (n, 3, 3), uniform by area; shape (n, 3)."""
    u, v = rng.random((2, len(triangles)))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    a, b, c = triangles.transpose(1, 0, 2)
    return np.ascontiguousarray(a + u[:, None] * (b - a) + v[:, None] * (c - a))
