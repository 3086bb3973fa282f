"""Meshes that are no solids: their own triangles stay, what encloses something is inside, and a tree covers all."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hhsim.kernels.cover.cover_error import union_distance
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.mesh import Mesh, with_inside
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.error import sample_mesh
from hhsim.trees.options import TreeOptions

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
BALL = trimesh.creation.icosphere(2, 0.03)


def mesh_of(*shapes: trimesh.Trimesh, faces: object = None) -> Mesh:
    whole = trimesh.util.concatenate(list(shapes))
    return Mesh(np.asarray(whole.vertices), np.asarray(whole.faces if faces is None else faces), name="shape")


def at(shape: trimesh.Trimesh, x: float, y: float = 0.0, z: float = 0.0) -> trimesh.Trimesh:
    moved = shape.copy()
    moved.apply_translation((x, y, z))
    return moved


def inside_out(shape: trimesh.Trimesh) -> trimesh.Trimesh:
    turned = shape.copy()
    turned.invert()
    return turned


SHEET = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.08, 0.01], [0, 0.08, 0]], [[0, 1, 2], [0, 2, 3]])


FLAT = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.08, 0], [0, 0.08, 0]], [[0, 1, 2], [0, 2, 3]])


def kept(mesh: Mesh) -> Mesh:
    return with_inside(replace(mesh, source=mesh.name), solid=None)


def fanned_bracket(turn: float = 0.0, bend: float = 0.0) -> Mesh:
    """A U of 90 mm whose caps are fans about a corner, so that triangles fold over each other beside the solid."""
    ring = np.array([(0, 0), (9, 0), (9, 8), (6, 8), (6, 3), (3, 3), (3, 8), (0, 8)]) * 0.01
    points = np.concatenate([np.c_[ring, np.zeros(8)], np.c_[ring, np.full(8, 0.02)]])
    points += bend * np.random.default_rng(3).normal(size=points.shape)
    faces = [face for n in range(1, 7) for face in ((0, n + 1, n), (8, 8 + n, 9 + n))]
    faces += [face for n in range(8) for m in [(n + 1) % 8] for face in ((n, m, 8 + m), (n, 8 + m, 8 + n))]
    turned = trimesh.transformations.rotation_matrix(turn, [1, 2, 3])[:3, :3]
    # As a binary STL has them.
    return Mesh((points @ turned.T).astype(np.float32), np.array(faces), name="bracket")


CASES = {
    "folded caps": (fanned_bracket(), [0.015, 0.04, 0.01], True),
    "folded caps, turned": (fanned_bracket(turn=1.0), fanned_bracket(turn=1.0).triangles[0].mean(axis=0), False),
    "folded caps that are bent": (fanned_bracket(bend=1e-4), [0.015, 0.04, 0.01], True),
    "sheet": (mesh_of(SHEET), [0.05, 0.04, 0.02], False),
    "half a ball": (mesh_of(BALL, faces=BALL.faces[BALL.triangles_center[:, 2] > 0.0]), [0.0, 0.0, 0.005], False),
    "two boxes that cross, one inside out": (mesh_of(BOX, inside_out(at(BOX, 0.03, 0.02, 0.01))), [0.04, 0.0, 0], True),
    "ball with a hole": (mesh_of(BALL, faces=np.asarray(BALL.faces)[:-1]), [0.0, 0.0, 0.0], True),
    "boxes that touch, and a sheet": (mesh_of(BOX, at(BOX, 0.1), at(FLAT, 0.0, 0.0, 0.04)), [0.09, 0.0, 0.0], True),
    "box with a partition": (mesh_of(BOX, at(SHEET, -0.05, -0.04, 0.0)), [0.0, 0.02, 0.015], True),
    "three leaves on an edge": (
        Mesh(0.1 * np.eye(5, 3), np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]]), name="fan"),
        [0.03, 0.03, 0.03],
        False,
    ),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.quick(
    "sheet", "two boxes that cross, one inside out", "boxes that touch, and a sheet", "three leaves on an edge"
)
def test_a_tree_covers_the_triangles_of_a_mesh_that_is_no_solid(name: str) -> None:
    given, point, is_inside = CASES[name]
    mesh = kept(given)
    bvh = signed_bvh(mesh)
    assert (mesh_signed_distance(bvh, np.array([point]))[0] < 0.0) == is_inside
    # Nothing far away is inside, and the distance is that to the triangles there.
    far = np.random.default_rng(2).normal(size=(500, 3))
    away = mesh_signed_distance(bvh, far)
    assert np.allclose(away, np.abs(mesh_signed_distance(build_mesh_bvh(mesh.vertices, mesh.faces), far)))
    tree = build_sphere_tree(mesh, TreeOptions(level=2))
    assert tree.check(mesh) == ()
    points = sample_mesh(given, 4000, np.random.default_rng(1))
    gap = np.empty(len(points))
    x, y, z = (np.ascontiguousarray(tree.leaf_center[:, k]) for k in range(3))
    union_distance(points, x, y, z, tree.leaf_radius.copy(), gap)
    assert gap.max() == 0.0
    last = tree.errors[-1]
    assert last.protrusion_max <= last.bound * (1.0 + 1e-9)
    # Spheres of a sheet stand in it: sixty-four of them are well below its size.
    assert last.bound < 0.2 * given.extent.max()
