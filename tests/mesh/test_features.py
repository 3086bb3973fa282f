"""Features of meshes: whose they are, which are left out and why, and meshes that are no neat surface."""

from collections import defaultdict
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from sampled import sampled

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.features import mesh_features

TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.03, 0.0]])


def bumpy() -> tuple[FloatArray, IntArray]:
    """A closed ball with peaks, pits and saddles."""
    ball = trimesh.creation.icosphere(2, 0.04)
    random = np.random.default_rng(3)
    return ball.vertices * random.uniform(0.8, 1.2, (len(ball.vertices), 1)), np.asarray(ball.faces, np.int64)


def catalogue(name: str) -> tuple[FloatArray, IntArray]:
    mesh = load_object(name).mesh
    return mesh.vertices, mesh.faces


def torus() -> tuple[FloatArray, IntArray]:
    shape = trimesh.creation.torus(0.04, 0.012, 12, 10)
    return np.asarray(shape.vertices), np.asarray(shape.faces, np.int64)


CLOSED: dict[str, Callable[[], tuple[FloatArray, IntArray]]] = {
    "bumpy": bumpy,
    "torus": torus,
    "bunny": lambda: catalogue("bunny"),
    "cup": lambda: catalogue("cup"),
    "cube": lambda: catalogue("cube"),
}


def edges_of(mesh: MeshFeatures) -> dict[tuple[tuple[float, ...], ...], list[int]]:
    """Faces at each edge, by the places of its ends, from the corners alone."""
    found: dict[tuple[tuple[float, ...], ...], list[int]] = defaultdict(list)
    for f, corner in enumerate(mesh.corner.reshape(-1, 3, 3)):
        for k in range(3):
            ends = sorted((tuple(corner[k].tolist()), tuple(corner[(k + 1) % 3].tolist())))
            found[tuple(ends)].append(f)
    return found


def owned(owner: IntArray) -> list[int]:
    return sorted(owner[owner >= 0].tolist())


@pytest.mark.parametrize(
    ("name", "closed"),
    sampled(
        [(name, closed) for name in CLOSED for closed in (True, False)],
        lambda _, case: case[0] != "cup" and case != ("bunny", False),
    ),
)
def test_edges_and_vertices_are_owned_once_by_a_face_that_has_them(name: str, closed: bool) -> None:
    mesh, repeated = mesh_features(*CLOSED[name](), closed=closed)
    assert repeated == 0
    assert len(mesh.pseudonormal) == len(mesh.multiplicity) == (len(mesh.face) if closed else 0)
    for owner in (mesh.face_edge, mesh.face_vertex):
        assert len(set(owned(owner))) == len(owned(owner))
    corners = mesh.corner.reshape(-1, 3, 3)
    for f, k in zip(*np.nonzero(mesh.face_edge >= 0)):
        start, end = edge_ends(mesh, f, k)
        for point in (start, end):
            assert np.linalg.norm(corners[f] - point, axis=1).min() < 1e-15
    for f, k in zip(*np.nonzero(mesh.face_vertex >= 0)):
        assert (corners[f] == mesh.vertex[mesh.face_vertex[f, k]]).all(axis=1).any()
    brute = edges_of(mesh)
    assert len(brute) == len(mesh.edge)
    wings = np.diff(mesh.wing_start)
    for e, (start, end) in enumerate(zip(mesh.edge[:, :3], mesh.edge[:, :3] + mesh.edge[:, 6:] * mesh.edge[:, 3:6])):
        # The other end by its direction and length is rounded: the nearest vertex is meant.
        other = mesh.vertex[np.linalg.norm(mesh.vertex - end, axis=1).argmin()]
        ends = tuple(sorted((tuple(start.tolist()), tuple(other.tolist()))))
        assert wings[e] == len(brute[ends])
        for w in mesh.wing[mesh.wing_start[e] : mesh.wing_start[e + 1]]:
            assert abs(w @ mesh.edge[e, 3:6]) < 1e-9
            third = [
                corners[f][~(corners[f] == start).all(axis=1) & ~(corners[f] == other).all(axis=1)][0]
                for f in brute[ends]
            ]
            assert max(w @ (t - start) / np.linalg.norm(t - start) for t in third) > 0.0


def edge_ends(mesh: MeshFeatures, f: int, k: int) -> tuple[FloatArray, FloatArray]:
    e = mesh.edge[mesh.face_edge[f, k]]
    return e[:3], e[:3] + e[6] * e[3:6]


@pytest.mark.parametrize("name", CLOSED)
def test_an_edge_is_one_where_the_middle_of_its_normal_cone_is_outside(name: str) -> None:
    vertices, faces = CLOSED[name]()
    mesh, _ = mesh_features(vertices, faces, closed=True)
    first = mesh.wing_start[:-1]
    assert (np.diff(mesh.wing_start) == 2).all()
    middle = -(mesh.wing[first] + mesh.wing[first + 1])
    bent = np.linalg.norm(middle, axis=1)
    sharp = bent > 1e-4
    at = mesh.edge[:, :3] + 0.5 * mesh.edge[:, 6:] * mesh.edge[:, 3:6]
    points = at + 1e-3 * mesh.edge[:, 6:] * middle / np.where(bent > 0.0, bent, 1.0)[:, None]
    outside = mesh_signed_distance(build_mesh_bvh(vertices, faces), points) > 0.0
    kept = np.isin(np.arange(len(mesh.edge)), owned(mesh.face_edge))
    np.testing.assert_array_equal(kept[sharp], outside[sharp])
    assert sharp.any() and kept.any() and (name == "cube" or not kept[sharp].all())
    if name == "cube":
        assert kept.sum() == 12 and len(kept) == 18
    # Seen from both sides every bent edge is one.
    sheet, _ = mesh_features(vertices, faces, closed=False)
    kept = np.isin(np.arange(len(sheet.edge)), owned(sheet.face_edge))
    assert kept[sharp].all()
    assert not kept[bent < 1e-9].any()


def sheet(n: int, fold: float = 0.0) -> tuple[FloatArray, IntArray]:
    """A square of n by n squares of 10 mm, every other row of corners raised by a fold [m]."""
    grid = np.array([[0.01 * i, 0.01 * j, fold * (i % 2)] for i in range(n + 1) for j in range(n + 1)])
    corner = np.array([(n + 1) * i + j for i in range(n) for j in range(n)])
    halves = (corner, corner + n + 1, corner + 1), (corner + 1, corner + n + 1, corner + n + 2)
    return grid, np.concatenate([np.stack(half, 1) for half in halves])


def test_a_sheet_has_no_edges_within_but_those_around_it() -> None:
    n = 4
    grid, faces = sheet(n)
    mesh, _ = mesh_features(grid, faces, closed=False)
    kept = mesh.edge[owned(mesh.face_edge)]
    assert len(kept) == 4 * n
    middle = kept[:, :2] + 0.5 * kept[:, 6:] * kept[:, 3:5]
    assert (np.abs(middle - 0.005 * n).max(axis=1) > 0.0049 * n).all()
    # Both corners of the same sheet turned over have the same features, whichever way its faces look.
    turned, _ = mesh_features(grid, faces[:, ::-1], closed=False)
    assert owned(turned.face_edge) == owned(mesh.face_edge)
    assert owned(turned.face_vertex) == owned(mesh.face_vertex)


def test_of_triangles_on_the_same_corners_one_is_kept() -> None:
    place = np.concatenate([TRIANGLE, [[-0.0, 0.0, -0.0], [0.0, 0.0, 1.0]]])
    # The last names its corners by other vertices at the same places, one of them with zeros below zero.
    mesh, repeated = mesh_features(place, np.array([[0, 1, 2], [2, 0, 1], [1, 0, 2], [3, 1, 2]]), closed=False)
    assert repeated == 3
    alone, _ = mesh_features(TRIANGLE, np.array([[0, 1, 2]]), closed=False)
    np.testing.assert_array_equal(mesh.corner, alone.corner)
    np.testing.assert_array_equal(mesh.face, alone.face)
    assert len(owned(mesh.face_edge)) == len(owned(mesh.face_vertex)) == 3
    # What no face uses is nowhere to be touched.
    assert not (mesh.vertex[owned(mesh.face_vertex)] == [0.0, 0.0, 1.0]).all(axis=1).any()


def test_triangles_without_area_alone_are_refused() -> None:
    place = np.concatenate([TRIANGLE, [[0.02, 0.0, 0.0]]])
    with pytest.raises(MeshError, match="none of 2 triangles has an area"):
        mesh_features(place, np.array([[0, 3, 1], [2, 2, 1]]), closed=False)


def box(size: float = 0.04, away: float = 0.0) -> tuple[FloatArray, IntArray]:
    shape = trimesh.creation.box((size, size, size))
    return np.asarray(shape.vertices, np.float64) + [away, 0.0, 0.0], np.asarray(shape.faces, np.int64)


def joined(*parts: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [faces + start for (_, faces), start in zip(parts, first)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def inside_out(part: tuple[FloatArray, IntArray]) -> tuple[FloatArray, IntArray]:
    return part[0], part[1][:, ::-1]


FLAP = np.array([[0.02, 0.02, 0.02], [0.02, -0.02, 0.02], [0.05, 0.0, 0.03]]), np.array([[0, 1, 2], [2, 1, 0]])
BOUNDARIES: dict[str, tuple[tuple[FloatArray, IntArray], bool]] = {
    "a box": (box(), True),
    "two boxes": (joined(box(), box(away=0.1)), True),
    "a box in a box": (joined(box(), box(0.01)), True),
    "a box with a cavity": (joined(box(), inside_out(box(0.01))), True),
    "a box inside out beside a larger one": (joined(box(), inside_out(box(0.01, 0.1))), False),
    "boxes through each other": (joined(box(), box(away=0.01)), False),
    "boxes that share a face": (joined(box(), box(away=0.04)), False),
    "a box and one nearly on it": (joined(box(), box(0.04 + 1e-11)), False),
    "a box with a flap of no thickness": (joined(box(), FLAP), False),
    "a box with a box inside out on a corner of it": (joined(box(), inside_out(box(0.04, 0.02))), False),
}


@pytest.mark.parametrize("name", BOUNDARIES)
def test_only_the_boundary_of_a_solid_is_touched_from_one_side_alone(name: str) -> None:
    (vertices, faces), one_sided = BOUNDARIES[name]
    mesh, repeated = mesh_features(vertices, faces, closed=True)
    assert (len(mesh.pseudonormal) > 0) == one_sided
    # A pair that is wound both ways goes around nothing.
    assert mesh.multiplicity.tolist().count(0) == repeated


def test_copies_that_rounding_has_torn_apart_are_one() -> None:
    grid, faces = sheet(3, 0.002)
    whole, _ = mesh_features(grid, faces, closed=False)
    corners = np.repeat(grid[faces], 8, axis=0)
    for apart, once in ((3e-13, True), (1e-9, False)):
        shaken = corners + np.random.default_rng(0).uniform(-apart, apart, corners.shape)
        mesh, repeated = mesh_features(shaken.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), closed=False)
        assert (repeated == 7 * len(faces)) == once
        assert (len(owned(mesh.face_edge)) == len(owned(whole.face_edge))) == once
        assert (len(owned(mesh.face_vertex)) == len(owned(whole.face_vertex))) == once
        assert (len(mesh.wing) == len(whole.wing)) == once
