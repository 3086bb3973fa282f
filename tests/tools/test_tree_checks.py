"""Meshes moved at random are judged alike."""

import pytest

from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions
from tools.tree_checks import Verdict, moved_at_random, referee


def judged(mesh: Mesh) -> tuple[Verdict, float]:
    """Verdict on a tree of 64 leaves, with fewer samples than usual, and its proved bound [m]."""
    tree = build_sphere_tree(mesh, TreeOptions(level=2))
    verdict = referee(mesh, tree, [2], mesh_points=20_000, sphere_points=40_000)[0]
    return verdict, tree.errors[2].bound


@pytest.mark.soak
@pytest.mark.parametrize("name", ["bunny", "cube"])
def test_a_motion_and_a_scale_change_the_errors_by_less_than_two_percent_and_hardly_the_bound(name: str) -> None:
    mesh = load_object(name).mesh
    mesh = mesh.scaled(0.1 / float(mesh.extent.max()))
    plain, bound = judged(mesh)
    there, scale = moved_at_random(mesh, 3)
    assert scale != pytest.approx(1.0, rel=0.1)
    found, bound_there = judged(there)
    assert bound_there == pytest.approx(scale * bound, rel=1e-5)
    assert found.protrusion == pytest.approx(scale * plain.protrusion, rel=0.02)
    assert found.protrusion_mean == pytest.approx(scale * plain.protrusion_mean, rel=0.02)
    assert found.gap <= 1e-9 * scale
