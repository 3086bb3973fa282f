"""Sphere trees around triangles that enclose nothing: they cover, and every leaf lies in the spheres above it."""

import numpy as np
import pytest
import trimesh

from hhsim.arrays import FloatArray
from hhsim.mesh.mesh import Mesh
from hhsim.trees.contact_surface import encloses
from hhsim.trees.triangle_tree import tree_of_any, triangle_tree
from tools.tree_checks import sticking_out


def soup(count: int, seed: int = 3, size: float = 0.03) -> Mesh:
    """Loose triangles [m]."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-0.05, 0.05, (count, 1, 3))
    corners = middle + random.normal(size=(count, 3, 3)) * size
    return Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), name="soup")


def uncovered(mesh: Mesh, center: FloatArray, radius: FloatArray) -> float:
    """Farthest that a random point of the mesh is outside of all spheres [m]."""
    random = np.random.default_rng(1)
    share = random.dirichlet(np.full(3, 0.5), size=(len(mesh.faces), 40))
    points = np.einsum("fnk,fki->fni", share, mesh.triangles).reshape(-1, 3)
    points = np.concatenate([points, mesh.vertices])
    return max(float((np.linalg.norm(point - center, axis=1) - radius).min()) for point in points)


@pytest.mark.parametrize(("count", "level"), [(1, 2), (7, 3), (60, 2), (300, 2), (300, 3)])
def test_the_leaves_cover_every_triangle(count: int, level: int) -> None:
    mesh = soup(count)
    tree = triangle_tree(mesh, level)
    assert tree.depth == level and tree.leaf_count <= 8**level
    assert uncovered(mesh, tree.leaf_center, tree.leaf_radius) < 1e-12
    assert max(sticking_out(tree, above, leaves_only=True) for above in range(level)) < 1e-12


def test_only_what_encloses_something_gets_the_usual_tree() -> None:
    box = trimesh.creation.box((0.05, 0.06, 0.07))
    vertices, faces = np.array(box.vertices, np.float64), np.array(box.faces, np.int64)
    closed, opened, inward = Mesh(vertices, faces), Mesh(vertices, faces[1:]), Mesh(vertices, faces[:, ::-1])
    assert [encloses(mesh) for mesh in (closed, opened, inward)] == [True, False, False]
    assert "around" not in tree_of_any(closed, 2).options
    for mesh in (opened, inward):
        assert tree_of_any(mesh, 2).options == {"around": "triangles", "level": 2}
