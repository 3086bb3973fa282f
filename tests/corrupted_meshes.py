"""Meshes of our own shapes, corrupted at random as meshes of others are found to be."""

from collections.abc import Callable
from functools import partial

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from tools.shapes.generators import cube, cup, cylinder, hexagonal_prism, rock, shamrock, sphere

Triangles = tuple[FloatArray, IntArray]
Corruption = Callable[[FloatArray, IntArray, np.random.Generator], Triangles]


LONGEST = 0.02
"""Longest edge of a shape [m]."""


def _subdivided(mesh: Mesh) -> Triangles:
    """The mesh with edges no longer than `LONGEST`, so that a corruption can hit a part of a face."""
    vertices, faces = mesh.vertices, mesh.faces
    while True:
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        if np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).max() <= LONGEST:
            return vertices, faces
        pairs, middle = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (middle.reshape(-1, 3) + len(vertices)).T
        vertices = np.concatenate([vertices, vertices[pairs].mean(axis=1)])
        a, b, c = faces.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])


SHAPES: tuple[Callable[[], Mesh], ...] = (
    *(cube, partial(sphere, subdivisions=3), partial(cylinder, segments=32)),
    *(hexagonal_prism, rock, shamrock, cup),
)


def _some(rng: np.random.Generator, count: int, least: float, most: float) -> IntArray:
    """Numbers below `count`, a share of them between `least` and `most`, at least one."""
    return rng.choice(count, max(1, int(count * rng.uniform(least, most))), replace=False)


def faces_deleted(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    return vertices, np.delete(faces, _some(rng, len(faces), 0.0, 0.1), axis=0)


def faces_duplicated(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    again = faces[_some(rng, len(faces), 0.0, 0.2)]
    turned = rng.random(len(again)) < 0.3
    again[turned] = again[turned][:, ::-1]
    return vertices, np.concatenate([faces, again])


def faces_flipped(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    faces = faces.copy()
    some = _some(rng, len(faces), 0.0, 0.5)
    faces[some] = faces[some][:, ::-1]
    return vertices, faces


def vertices_jittered(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    size = np.ptp(vertices, axis=0).max() * 10.0 ** rng.uniform(-6.0, -2.0)
    with np.errstate(invalid="ignore"):  # where another corruption has left infinite ones
        return vertices + rng.normal(size=vertices.shape) * size, faces


def vertices_unmerged(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    loose = vertices[faces].reshape(-1, 3)
    size = np.ptp(vertices, axis=0).max() * 10.0 ** rng.uniform(-8.0, -3.0)
    return loose + rng.normal(size=loose.shape) * size, np.arange(len(loose)).reshape(-1, 3)


def vertices_not_finite(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    vertices = vertices.copy()
    vertices[_some(rng, len(vertices), 0.0, 0.02), rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf])
    return vertices, faces


def parts_overlapped(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    other = vertices @ turn.T + rng.uniform(-0.5, 0.5, 3) * np.ptp(vertices, axis=0)
    return np.concatenate([vertices, other]), np.concatenate([faces, faces + len(vertices)])


def hole_cut(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    for _ in range(int(rng.integers(1, 4))):
        place = vertices[rng.choice(faces.ravel())]
        reach = np.ptp(vertices, axis=0).max() * rng.uniform(0.05, 0.25)
        keep = np.linalg.norm(vertices[faces].mean(axis=1) - place, axis=1) > reach
        faces = faces[keep] if keep.any() else faces
    return vertices, faces


def parts_scattered(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    some = faces[_some(rng, len(faces), 0.0, 0.05)]
    moved = vertices[some] + rng.normal(size=(len(some), 1, 3)) * 0.3 * np.ptp(vertices, axis=0).max()
    new = np.arange(3 * len(some)).reshape(-1, 3) + len(vertices)
    return np.concatenate([vertices, moved.reshape(-1, 3)]), np.concatenate([faces, new])


def slivers_added(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    some = _some(rng, len(faces), 0.0, 0.1)
    a, b = vertices[faces[some, 0]], vertices[faces[some, 1]]
    middle = 0.5 * (a + b) + rng.normal(size=a.shape) * 1e-9
    number = len(vertices) + np.arange(len(some))
    kind = rng.integers(3)
    if kind == 0:
        # The edge of one of its two faces gets a vertex: a T-junction.
        halves = [(faces[some, 0], number, faces[some, 2]), (number, faces[some, 1], faces[some, 2])]
        faces = np.concatenate([np.delete(faces, some, axis=0), *(np.stack(half, axis=1) for half in halves)])
    elif kind == 1:
        faces = np.concatenate([faces, np.stack([faces[some, 0], faces[some, 1], number], axis=1)])
    else:
        faces = np.concatenate([faces, np.stack([faces[some, 0], faces[some, 1], faces[some, 1]], axis=1)])
    return np.concatenate([vertices, middle]), faces


def inner_shell(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    middle = vertices[rng.choice(faces.ravel())] * rng.uniform(0.0, 0.6)
    inner = middle + (vertices - vertices.mean(axis=0)) * rng.uniform(0.05, 0.5)
    turned = faces[:, ::-1] if rng.random() < 0.5 else faces
    return np.concatenate([vertices, inner]), np.concatenate([faces, turned + len(vertices)])


def fins_added(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    some = _some(rng, len(faces), 0.0, 0.01)
    tip = vertices[faces[some]].mean(axis=1) + rng.normal(size=(len(some), 3)) * 0.01
    fins = np.stack([faces[some, 0], faces[some, 1], len(vertices) + np.arange(len(some))], axis=1)
    return np.concatenate([vertices, tip]), np.concatenate([faces, fins])


def pushed_through(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    along = vertices @ way
    over = np.maximum(along - np.quantile(along, rng.uniform(0.5, 0.95)), 0.0)
    return vertices - rng.uniform(1.5, 4.0) * over[:, None] * way, faces


def scaled_far_away(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> Triangles:
    # The coordinates lose digits there, as those of a file of single precision do.
    far = (vertices + rng.normal(size=3) * 10.0 ** rng.uniform(0.0, 3.0)).astype(np.float32)
    return far.astype(np.float64) * 10.0 ** rng.uniform(-2.0, 2.0), faces


CORRUPTIONS: tuple[Corruption, ...] = (
    *(faces_deleted, faces_duplicated, faces_flipped, vertices_jittered, vertices_unmerged, vertices_not_finite),
    *(parts_overlapped, hole_cut, parts_scattered, slivers_added, inner_shell, fins_added, pushed_through),
    scaled_far_away,
)


def corrupted(seed: int) -> tuple[FloatArray, IntArray, str]:
    """Triangles with one to three corruptions of a shape, and what they are."""
    rng = np.random.default_rng(seed)
    shape = seed % len(SHAPES)
    vertices, faces = _subdivided(SHAPES[shape]())
    first = seed // len(SHAPES) % len(CORRUPTIONS)
    more = rng.choice(len(CORRUPTIONS), int(rng.integers(0, 3)))
    names = []
    for which in [first, *more.tolist()]:
        vertices, faces = CORRUPTIONS[which](vertices, faces, rng)
        names.append(CORRUPTIONS[which].__name__)
    return vertices, faces, f"shape {shape}: {', '.join(names)}"
