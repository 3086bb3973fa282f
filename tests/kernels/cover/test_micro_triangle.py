"""Micro-triangles tile their faces, are as small as asked, and lie in the spheres of their nodes."""

import numpy as np
import pytest
import trimesh

from hhsim.arrays import FloatArray
from hhsim.kernels.cover.micro_triangle import MicroTriangles, cut_faces, cut_mesh, edges_for, halve
from hhsim.kernels.jit import as_argument
from hhsim.kernels.mesh.bvh import face_normals


def areas(corner: FloatArray) -> FloatArray:
    a, b, c = corner[:, :3], corner[:, 3:6], corner[:, 6:]
    return 0.5 * np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1))


def edges(corner: FloatArray) -> FloatArray:
    points = corner.reshape(-1, 3, 3)
    return np.asarray(np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2))


def test_cut_keeps_area_and_plane_of_each_face() -> None:
    shape = trimesh.creation.box((0.1, 0.05, 0.001))
    corner = as_argument(shape.triangles).reshape(-1, 9)
    edge = np.linspace(0.005, 0.02, len(corner))
    count = cut_faces(corner, edge, np.empty((0, 9)), np.empty(0, np.int64))
    micro, face = np.empty((count, 9)), np.empty(count, np.int64)
    assert cut_faces(corner, edge, micro, face) == count
    points = micro.reshape(-1, 3, 3)
    assert (edges(micro).max(axis=1) <= edge[face] * (1.0 + 1e-12)).all()
    assert np.bincount(face, weights=areas(micro)) == pytest.approx(areas(corner))
    plane = np.einsum("nij,nj->ni", points - corner[face, None, :3], np.asarray(shape.face_normals)[face])
    assert np.abs(plane).max() < 1e-15


CYLINDER = trimesh.creation.cylinder(0.03, 0.1, sections=40)


def cut_cylinder(target: int) -> MicroTriangles:
    vertices, faces = np.array(CYLINDER.vertices, float), np.array(CYLINDER.faces, np.int64)
    corner = vertices[faces].reshape(-1, 9)
    return cut_mesh(corner, face_normals(vertices, faces), edges_for(corner, np.ones(len(corner)), target))


@pytest.mark.parametrize("target", [1, 50, 5000])
def test_cut_mesh_meets_the_target(target: int) -> None:
    micro, faces = cut_cylinder(target), len(CYLINDER.faces)
    assert max(faces, 0.6 * target) <= len(micro.corner) <= max(faces, 1.6 * target)
    assert areas(micro.corner).sum() == pytest.approx(CYLINDER.area)
    for node in range(len(micro.start)):
        inside = micro.corner[micro.start[node] : micro.end[node]].reshape(-1, 3)
        assert np.linalg.norm(inside - micro.center[node], axis=1).max() <= micro.radius[node]
    assert np.allclose(np.linalg.norm(micro.normal, axis=1), 1.0)


def test_halves_tile_what_was_halved_and_stay_in_the_nodes() -> None:
    micro = cut_cylinder(2000)
    chosen = np.random.default_rng(0).random(len(micro.corner)) < 0.3
    finer, source = halve(micro, chosen)
    assert np.array_equal(np.bincount(source), 1 + chosen)
    assert np.bincount(source, weights=areas(finer.corner)) == pytest.approx(areas(micro.corner), rel=1e-12)
    assert np.array_equal(finer.corner[~chosen[source]], micro.corner[~chosen])
    assert np.array_equal(finer.normal, micro.normal[source])
    # The halves have equal areas, and each keeps the corner opposite the longest edge.
    halves = areas(finer.corner)[chosen[source]].reshape(-1, 2)
    assert halves[:, 0] == pytest.approx(halves[:, 1], rel=1e-9)
    before = edges(micro.corner[chosen]).max(axis=1)[:, None]
    after = edges(finer.corner[chosen[source]]).reshape(-1, 2, 3).min(axis=2)
    assert (after <= 0.5 * before * (1.0 + 1e-9)).all()
    assert np.array_equal(finer.right, micro.right)
    assert (finer.start[0], finer.end[0]) == (0, len(finer.corner))
    for node in range(len(finer.start)):
        inside = finer.corner[finer.start[node] : finer.end[node]].reshape(-1, 3)
        assert np.linalg.norm(inside - finer.center[node], axis=1).max() <= finer.radius[node]
        assert set(source[finer.start[node] : finer.end[node]]) == set(range(micro.start[node], micro.end[node]))


def test_halving_again_and_again_is_cutting() -> None:
    # The certificate halves the faces anew: it must meet the same micro-triangles, also where edges are equally long.
    shape = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices, faces = np.array(shape.vertices, float), np.array(shape.faces, np.int64)
    corner, normal = vertices[faces].reshape(-1, 9), face_normals(vertices, faces)
    halved = cut_mesh(corner, normal, np.full(12, 1.0))
    for _ in range(6):
        halved, _ = halve(halved, np.ones(len(halved.corner), np.bool_))
    cut = cut_mesh(corner, normal, np.full(12, 0.0177))
    assert len(cut.corner) == len(halved.corner) == 12 * 2**6
    assert np.array_equal(np.unique(cut.corner, axis=0), np.unique(halved.corner, axis=0))
