"""The builders that the literature compares with: their trees cover and enclose, and come out the same each time."""

from collections.abc import Callable

import numpy as np
import pytest

from hhsim.errors import InputError, MeshError
from hhsim.kernels.mesh.bvh import build_mesh_bvh, mesh_signed_distance
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.generators import cube, cylinder, hexagonal_prism, sphere
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import TreeOptions, build_sphere_tree
from hhsim.trees.error import uncovered_faces
from hhsim.trees.hierarchy import at_level
from hhsim.trees.methods import METHODS
from hhsim.trees.octree import build_octree, root_cell
from hhsim.trees.sphere_tree import SphereTree

NAMES = [name for name, method in METHODS.items() if method.grow is not None]


def grown(name: str, mesh: Mesh, level: int = 2, branching: int = 8, leaves: int | None = None) -> SphereTree:
    grow = METHODS[name].grow
    assert grow is not None
    return grow(mesh, level, branching, leaves, None)


def test_the_table_names_them() -> None:
    assert NAMES == ["medial", "octree", "octree-fitted"]


@pytest.mark.parametrize("make", [lambda: cube(0.1), lambda: cylinder(0.06, 0.12, 24), lambda: sphere(0.08, 2)])
@pytest.mark.parametrize("name", NAMES)
def test_leaves_cover_and_nodes_enclose(name: str, make: Callable[[], Mesh]) -> None:
    mesh = make()
    tree = grown(name, mesh)
    assert tree.depth == 2 and tree.leaf_count <= 64
    assert tree.check(mesh) == ()
    assert len(tree.covers) == 3
    for level, cover in enumerate(tree.covers):
        assert len(cover.radius) == (tree.level == level).sum()
        assert uncovered_faces(mesh.vertices, mesh.faces, cover.center, cover.radius).size == 0
    # What an inner node encloses is measured here again, from the arrays alone.
    ancestor = np.arange(tree.leaf_start, len(tree.radius))
    while ancestor[0] > 0:
        ancestor = tree.parent[ancestor]
        reach = np.linalg.norm(tree.leaf_center - tree.center[ancestor], axis=1) + tree.leaf_radius
        assert (reach <= tree.radius[ancestor] * (1.0 + 1e-9)).all()
    again = grown(name, make())
    assert again.center.tobytes() == tree.center.tobytes() and again.radius.tobytes() == tree.radius.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_they_are_built_measured_and_kept_as_any_tree(name: str) -> None:
    mesh = cube(0.1)
    calls: list[tuple[str, int, int]] = []
    tree = build_sphere_tree(mesh, TreeOptions(level=2, method=name), lambda *call: calls.append(call))
    assert tree.options["method"] == name and tree.mesh_sha256 == mesh.sha256
    last = tree.errors[-1]
    assert last.gap_max == 0.0 and 0.0 < last.protrusion_max <= last.bound
    assert {stage for stage, _, _ in calls} == {"cover", "tree", "measure"}
    assert at_level(tree, 1).leaf_count == len(tree.covers[1].radius)


def test_an_octree_of_a_cube_is_its_grid() -> None:
    mesh = cube(0.1)
    tree = build_octree(mesh, 2, 8)
    # 4 × 4 × 4 cells less the 2 × 2 × 2 in the middle, which the surface does not touch.
    assert tree.leaf_count == 56
    assert tree.leaf_radius == pytest.approx(0.0125 * np.sqrt(3.0))
    assert np.abs(tree.leaf_center) == pytest.approx(np.where(np.abs(tree.leaf_center) > 0.025, 0.0375, 0.0125))
    assert (np.abs(tree.leaf_center).max(axis=1) > 0.03).all()
    # A ball around a cell reaches so far out of the face that it lies under.
    assert tree.covers[2].bound == pytest.approx(0.0125 * (np.sqrt(3.0) - 1.0))
    low, size = root_cell(mesh)
    assert low == pytest.approx([-0.05] * 3) and size == pytest.approx(0.1)


def test_a_surface_through_corners_of_cells_is_proved_to_be_covered() -> None:
    mesh = hexagonal_prism(0.05, 0.1)
    tree = build_octree(mesh, 2, 8)
    assert tree.check(mesh) == ()
    assert tree.leaf_radius == pytest.approx(0.0125 * np.sqrt(3.0), rel=2e-4)


def test_fitted_balls_are_no_larger_than_those_around_the_cells() -> None:
    mesh = sphere(0.08, 3)
    whole, fitted = grown("octree", mesh, 3), grown("octree-fitted", mesh, 3)
    assert whole.leaf_count == fitted.leaf_count
    assert (fitted.leaf_radius <= whole.leaf_radius * (1.0 + 1e-4)).all()
    assert fitted.leaf_radius.mean() < 0.8 * whole.leaf_radius.mean()


def test_an_octree_ends_above_the_level_that_has_too_many_cells() -> None:
    mesh = cube(0.1)
    assert build_octree(mesh, 5, 8, leaves=56).leaf_count == 56
    assert build_octree(mesh, 5, 8, leaves=55).leaf_count == 8
    with pytest.raises(InputError, match="branching 4: an octree has 8"):
        build_octree(mesh, 2, 4)


def test_the_toolkits_octree_of_the_bunny() -> None:
    # Bradshaw's toolkit, measured in the same way: 20.7 mm at most and 11.8 mm on average at level 3.
    mesh = load_object("bunny").mesh
    tree = build_sphere_tree(mesh.scaled(0.1 / mesh.extent.max()), TreeOptions(level=3, method="octree"))
    assert tree.errors[-1].protrusion_max == pytest.approx(20.7e-3, rel=0.05)
    assert tree.errors[-1].protrusion_mean == pytest.approx(11.8e-3, rel=0.02)


def test_medial_balls_of_the_bunny_do_better_than_the_toolkits() -> None:
    mesh = load_object("bunny").mesh
    tree = build_sphere_tree(mesh.scaled(0.1 / mesh.extent.max()), TreeOptions(level=3, method="medial"))
    last = tree.errors[-1]
    assert last.spheres <= 512
    # The toolkit's adaptive medial axis: 2.97 mm at most, 0.545 mm on average, and a gap of 0.55 mm.
    assert last.protrusion_max < 2.2e-3 and last.protrusion_mean < 0.5e-3 and last.gap_max == 0.0


@pytest.mark.parametrize(("level", "branching", "leaves"), [(3, 2, None), (2, 5, 20), (3, 4, 9), (1, 8, 3)])
def test_medial_trees_of_any_branching_and_number(level: int, branching: int, leaves: int | None) -> None:
    mesh = cylinder(0.06, 0.12, 16)
    tree = grown("medial", mesh, level, branching, leaves)
    assert tree.depth == level
    assert tree.leaf_count <= min(branching**level, leaves or branching**level)
    assert tree.leaf_count >= int(0.8 * min(branching**level, leaves or branching**level))
    assert np.bincount(tree.parent[1:]).max() <= branching
    assert uncovered_faces(mesh.vertices, mesh.faces, tree.leaf_center, tree.leaf_radius).size == 0
    assert (mesh_signed_distance(build_mesh_bvh(mesh.vertices, mesh.faces), tree.leaf_center) < 0.0).all()


def test_a_medial_tree_needs_an_inside() -> None:
    mesh = cube(0.1)
    with pytest.raises(MeshError, match="no inside"):
        grown("medial", Mesh(mesh.vertices, mesh.faces[:, ::-1]))
