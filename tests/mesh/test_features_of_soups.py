"""Features of meshes: whose they are, which are left out, and the distance to every triangle of any soup.

The distances that a tick's is held against are found by search, without code of the kernels.
"""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from conftest import sampled
from mesh_oracle import Cones, along_axes, by_arctangents, from_triangles, least_of_features
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.features import mesh_features
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import merged_vertices
from hhsim.trees.contact_surface import encloses

BOX = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]) - 0.5
BOX_FACES = np.array(
    [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4]]
    + [[1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]]
)


def unit(random: np.random.Generator, count: int | None = None) -> FloatArray:
    """A random direction, or so many."""
    vector = random.normal(size=3 if count is None else (count, 3))
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def _loose(random: np.random.Generator) -> FloatArray:
    count = random.integers(2, 12)
    size = 10.0 ** random.uniform(-3.0, -1.5)
    return np.asarray(random.normal(0.0, 0.02, (count, 1, 3)) + random.normal(0.0, size, (count, 3, 3)))


def _turned_over(random: np.random.Generator, triangles: FloatArray) -> FloatArray:
    flip = random.random(len(triangles)) < 0.5
    return np.where(flip[:, None, None], triangles[:, ::-1], triangles)


def _coincident(random: np.random.Generator) -> FloatArray:
    base = _loose(random)
    if random.random() < 0.5:
        extra = _turned_over(random, base[random.integers(0, len(base), random.integers(1, len(base) + 1))])
        return np.concatenate([base, [np.roll(triangle, random.integers(3), axis=0) for triangle in extra]])
    # Nearly so.
    extra = base[random.integers(0, len(base), random.integers(1, len(base) + 1))]
    away = (
        unit(random, len(extra))[:, None] if random.random() < 0.5 else unit(random, 3 * len(extra)).reshape(-1, 3, 3)
    )
    return np.concatenate([base, _turned_over(random, extra + 10.0 ** random.uniform(-9.0, -4.0) * away)])


def _folded(random: np.random.Generator) -> FloatArray:
    triangles = []
    for a, b, c in _loose(random):
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        other = (
            c if random.random() < 0.5 else a + random.uniform(0.1, 1.5) * (c - a) + random.uniform(0, 0.5) * (b - a)
        )
        rise = np.linalg.norm(c - a) * 10.0 ** random.uniform(-12.0, -1.0)
        triangles += [[a, b, c], [b, a, other + rise * normal]]
    return np.array(triangles)


def _t_junctions(random: np.random.Generator) -> FloatArray:
    triangles = []
    for a, b, c in _loose(random):
        middle = a + random.uniform(0.1, 0.9) * (b - a)
        if random.random() < 0.3:
            middle = middle + unit(random) * 10.0 ** random.uniform(-12.0, -5.0)
        across = a + b - c + unit(random) * 10.0 ** random.uniform(-12.0, -2.0)
        apex = across if random.random() < 0.7 else a + 0.02 * unit(random)
        triangles += [[a, b, c], [middle, a, apex], [b, middle, apex]]
        if random.random() < 0.4:
            triangles.append([a, middle, b])
    return np.array(triangles)


def _slivers(random: np.random.Generator) -> FloatArray:
    triangles = []
    for a, b, _ in _loose(random):
        off = 10.0 ** random.uniform(-17.0, -4.0) if random.random() < 0.8 else 0.0
        c = a + random.uniform(-0.2, 1.2) * (b - a) + off * unit(random)
        triangles.append([a, b, c])
        if random.random() < 0.5:
            beside = a + random.uniform(0.0, 1.0) * (b - a) + unit(random) * 10.0 ** random.uniform(-5.0, -2.0)
            triangles.append([b, a, beside])
        if random.random() < 0.5:
            triangles.append([c, a, a + 0.01 * unit(random)])
        if random.random() < 0.1:
            triangles.append([a, a, b])
    return np.array(triangles)


def _halved(triangles: FloatArray) -> FloatArray:
    a, b, c = triangles.transpose(1, 0, 2)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _bumpy(random: np.random.Generator) -> FloatArray:
    triangles = (BOX * random.uniform(0.005, 0.04, 3))[BOX_FACES]
    for _ in range(random.integers(0, 3)):
        triangles = _halved(triangles)
    vertices, faces = indexed(triangles)
    return np.asarray((vertices + random.normal(size=vertices.shape) * 10.0 ** random.uniform(-9.0, -2.3))[faces])


SOUPS: dict[str, Callable[[np.random.Generator], FloatArray]] = {
    "coincident": _coincident,
    "folded": _folded,
    "T-junctions": _t_junctions,
    "slivers": _slivers,
    "closed": _bumpy,
}


def soup(kind: str, seed: int) -> tuple[FloatArray, np.random.Generator]:
    """Triangles of a kind, shape (F, 3, 3) [m], turned anyhow; and what more is drawn for them."""
    random = np.random.default_rng([seed, list(SOUPS).index(kind)])
    triangles = SOUPS[kind](random)
    return triangles @ Rotation.random(rng=random).as_matrix().T, random


def indexed(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """The same as vertices and faces."""
    return merged_vertices(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def least_distance(cones: Cones, triangles: FloatArray) -> float:
    """Least distance [m] of one round cone to triangles; negative through one."""
    middle = 0.5 * (cones.a + cones.b)
    about = from_triangles(triangles)(middle) - 0.5 * (cones.radius_a + cones.radius_b)
    half = 0.5 * (np.linalg.norm(cones.b - cones.a) + cones.radius_a - cones.radius_b)
    # From the middle of the axis a distance changes by no more than half its length and half the drop of the radius.
    near = triangles[about - half <= about.min()]
    each = Cones(*(np.repeat(values, len(near), axis=0) for values in cones))
    return float(along_axes(each, from_triangles(near)).min())


def touching_cone(random: np.random.Generator, triangles: FloatArray) -> Cones:
    """A round cone near triangles, from 0.1 µm to 10 mm off one of them."""
    i = random.integers(len(triangles))
    share = random.dirichlet([0.5, 0.5, 0.5])
    if random.random() < 0.5:
        # On a side, or at a corner.
        share[random.integers(3)] = 0.0
        share = np.roll([1.0, 0.0, 0.0], random.integers(3)) if random.random() < 0.4 else share / share.sum()
    large = random.uniform(2e-3, 0.012)
    length = 0.0 if random.random() < 0.15 else random.uniform(2e-3, 0.05)
    small = max(1e-4, large - random.choice([0.0, 0.1, 0.5, 0.9]) * min(large, length))
    a, b, c = triangles[i]
    normal = np.cross(b - a, c - a)
    away = unit(random)
    if random.random() > 0.7 and normal.any():
        away = normal / np.linalg.norm(normal) * random.choice([-1.0, 1.0])
    place = share @ triangles[i] + away * (large + 10.0 ** random.uniform(-7.0, -2.0))
    along = unit(random)
    if random.random() < 0.5:
        along = np.cross(away, along) / np.linalg.norm(np.cross(away, along))
    start = place - random.uniform() * length * along
    return Cones(start[None], (start + length * along)[None], np.array([large]), np.array([small]))


SAME = 2e-10
"""Two distances of one body [m]: a triangle lower than a billionth of its length is a line in one of them."""
POSES, TRIES = 10, 20


@pytest.mark.parametrize(
    ("kind", "first"), sampled([(kind, first) for first in range(0, 80, 2) for kind in SOUPS], lambda i, _: i in (0, 3))
)
def test_the_least_over_features_is_the_least_over_triangles(kind: str, first: int) -> None:
    judged = 0
    for seed in range(first, first + 2):
        triangles, random = soup(kind, seed)
        vertices, faces = indexed(triangles)
        closed = encloses(Mesh(vertices, faces))
        mesh, _ = mesh_features(vertices, faces, closed=closed)
        wanted = judged + POSES
        for _ in range(TRIES * POSES):
            cones = touching_cone(random, triangles)
            if closed and by_arctangents(triangles, cones.a)[0] > 0.5:
                continue
            distance = least_distance(cones, triangles)
            if distance > 0.0:
                assert least_of_features(mesh, cones.kernel(0)) == pytest.approx(distance, abs=SAME), seed
                judged += 1
                if judged == wanted:
                    break
    assert judged > POSES


TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.03, 0.0]])


def owned(owner: IntArray) -> list[int]:
    return sorted(owner[owner >= 0].tolist())


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
